"""A car that leaves with a heading of two sigmas: what `fusion` and `fusion-smoother` state, on the page of `fusion`.

python tools/departure.py [first seed]      a minute
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

FIRST_SEED, FILTERED, SMOOTHED = 995500, 64, 16
"""First seed, and numbers of runs of the filter and of the smoother."""
CASES: dict[str, dict[str, Any]] = {
    "fixes each 5 s": {"interval_s": 5.0, "outages_s": []},
    "centimetre fixes, none while it departs": {"grade": "rtk", "interval_s": 1.0, "outages_s": [[20.0, 45.0], [60.0, 80.0]]},
}
HEADER = "| case | estimator | runs | most beyond 3 sigma | largest error over sigma |\n|---|---|---|---|---|"


def departing(gnss: dict[str, Any]) -> Scenario:
    """`car-city-drive` for 100 s with a heading that is 5.4 deg off at a stated 2.84, and other fixes."""
    values = load("car-city-drive").model_dump(mode="json", warnings=False)
    values["gnss"] |= gnss
    values["knowledge"] |= {"heading_sigma_deg": 2.84, "heading_error_deg": 5.4}
    return parse({**values, "duration_s": 100.0, "estimator": {}}, "departure", "departure")


def filtered(scenario: Scenario, first_seed: int) -> Array:
    """Errors over stated sigmas (runs, times, channels) of `fusion`."""
    plan = make_plan(scenario, "fusion", FILTERED, first_seed=first_seed)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    return np.concatenate([block["error"] / block["sigma"] for block in blocks])


def smoothed(scenario: Scenario, first_seed: int) -> Array:
    """The same of `fusion-smoother`."""
    runs = (insenv.run(scenario, "fusion-smoother", seed=first_seed + k).results[0] for k in range(SMOOTHED))
    return np.array([np.stack([run.errors[name] / run.sigma[name] for name in CHANNELS], axis=1) for run in runs])


if __name__ == "__main__":
    first = int(sys.argv[1]) if len(sys.argv) > 1 else FIRST_SEED
    print(HEADER)
    for name, gnss in CASES.items():
        for id, measured in (("fusion", filtered), ("fusion-smoother", smoothed)):
            size = np.abs(measured(departing(gnss), first))
            beyond = 100 * (size > 3.0).mean(axis=(0, 1))
            most, largest = int(np.argmax(beyond)), np.unravel_index(int(np.argmax(size)), size.shape)[2]
            cells = f"{len(size)} | {beyond[most]:.2g} % ({CHANNELS[most]}) | {size.max():.1f} ({CHANNELS[largest]})"
            print(f"| {name} | `{id}` | {cells} |", flush=True)
