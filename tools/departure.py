"""Starts that are degrees off: what `fusion` and `fusion-smoother` state then, for the pages of `fusion` and `smoother`.

python tools/departure.py [first seed]      five minutes
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import insenv
from insenv.core.tables import Array
from insenv.evaluation.errors import CHANNELS
from insenv.scenario import Scenario, load, parse
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

FIRST_SEED, RUNS = 995500, 64
HEADING_OFF = {"heading_sigma_deg": 2.84, "heading_error_deg": 5.4}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "car, fixes each 5 s": ("car-city-drive", {"knowledge": HEADING_OFF, "gnss": {"interval_s": 5.0, "outages_s": []}}),
    "car, centimetre fixes, none while it departs": (
        "car-city-drive",
        {"knowledge": HEADING_OFF, "gnss": {"grade": "rtk", "interval_s": 1.0, "outages_s": [[20.0, 45.0], [60.0, 80.0]]}},
    ),
    "survey flight from its own start": ("aircraft-survey", {}),
}
"""By name: a scenario, and what is changed of it."""
HEADER = "| case | estimator | most beyond 3 sigma | largest error over sigma |\n|---|---|---|---|"


def departing(name: str, changes: dict[str, Any]) -> Scenario:
    """100 s of a scenario with other keys of its sections."""
    values = load(name).model_dump(mode="json", warnings=False)
    for section, keys in changes.items():
        values[section] |= keys
    return parse({**values, "duration_s": 100.0, "estimator": {}}, "departure", "departure")


def filtered(scenario: Scenario, first_seed: int) -> Array:
    """Errors over stated sigmas (runs, times, channels) of `fusion`."""
    plan = make_plan(scenario, "fusion", RUNS, first_seed=first_seed)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    return np.concatenate([block["error"] / block["sigma"] for block in blocks])


def smoothed(scenario: Scenario, first_seed: int) -> Array:
    """The same of `fusion-smoother`."""
    runs = (insenv.run(scenario, "fusion-smoother", seed=first_seed + k).results[0] for k in range(RUNS))
    return np.array([np.stack([run.errors[name] / run.sigma[name] for name in CHANNELS], axis=1) for run in runs])


if __name__ == "__main__":
    first = int(sys.argv[1]) if len(sys.argv) > 1 else FIRST_SEED
    print(HEADER)
    for name, (scenario, changes) in CASES.items():
        for id, measured in (("fusion", filtered), ("fusion-smoother", smoothed)):
            size = np.abs(measured(departing(scenario, changes), first))
            beyond = 100 * (size > 3.0).mean(axis=(0, 1))
            most, largest = int(np.argmax(beyond)), np.unravel_index(int(np.argmax(size)), size.shape)[2]
            cells = f"{beyond[most]:.2g} % ({CHANNELS[most]}) | {size.max():.1f} ({CHANNELS[largest]})"
            print(f"| {name} | `{id}` | {cells} |", flush=True)
