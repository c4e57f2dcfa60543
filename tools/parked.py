"""Parked cars by grade of the unit: `fusion` that knows that they stay, beside one that detects rest.

python tools/parked.py [first seed]      the table of docs/estimators/fusion.md, a minute
"""

from __future__ import annotations

import sys

import insenv
from insenv.scenario import load
from insenv.studies.campaign.summary import Summary

GRADES = ("navigation", "tactical", "consumer", "industrial")
CHANNELS = ("vn_mps", "heading_deg")
RUNS, FIRST_SEED = 64, 7000
HEADER = "\n".join((
    "| grade of the unit | velocity by detection, m/s | velocity, m/s | heading by detection, deg | heading, deg |",
    "|---" * 5 + "|",
))  # fmt: skip


def row(grade: str, first_seed: int) -> str:
    """A line of the table: rms over stated standard deviation, of `CHANNELS`, by detection and without."""
    scenario = load("car-parked")
    scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": grade})})
    found = []
    for settings in ({"fusion": {"aids": ["zero_velocity"]}}, None):
        summary = insenv.campaign(scenario, "fusion", RUNS, seed=first_seed, settings=settings)
        assert isinstance(summary, Summary)
        found.append(summary.figures())
    cells = [" / ".join(shown(one[name][kind]) for kind in ("rms", "stated")) for name in CHANNELS for one in found]
    return f"| `{grade}` | {' | '.join(cells)} |"


def shown(value: float | None) -> str:
    """Two digits, and no exponent."""
    return "-" if value is None else f"{float(f'{value:.2g}'):g}"


if __name__ == "__main__":
    print(HEADER)
    for grade in GRADES:
        print(row(grade, int(sys.argv[1]) if len(sys.argv) > 1 else FIRST_SEED), flush=True)
