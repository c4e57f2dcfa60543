"""Attitude and NEES of `fusion` on a multirotor that turns (docs/estimators/fusion.md).

python tools/turns.py [--seeds 192] [--first 995000] [--duration 600]      some minutes

The vehicle of `multirotor-hover` with other legs.  NEES and shares count from `FROM_S` on, over all runs and records.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from insenv.evaluation.errors import ATTITUDE, CHANNELS
from insenv.scenario import load, parse
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

FROM_S = 20.0
CORNER, WHOLE = {"turn_deg": 90.0}, {"turn_deg": 360.0, "duration_s": 4.0}
FLIGHTS = {
    "hover": [{"hover_s": 20.0}],
    "corners at 15 deg/s": [{"fly_s": 20.0, "forward_mps": 5.0}, {**CORNER, "duration_s": 6.0}],
    "corners at 90 deg/s": [{"fly_s": 20.0, "forward_mps": 5.0}, {**CORNER, "duration_s": 1.0}],
    "whole turns, one side": [{"hover_s": 20.0}, WHOLE],
    "whole turns, both sides": [{"hover_s": 10.0}, WHOLE, {"hover_s": 10.0}, {**WHOLE, "turn_deg": -360.0}],
    "turning all the time": [{"turn_deg": 3600.0, "duration_s": 40.0}],
}


def row(flight: str, seeds: int, first: int, duration_s: float) -> str:
    """A row of the table: NEES, rms error (stated) and share beyond 3 sigma of roll, pitch and heading."""
    values: dict[str, Any] = load("multirotor-hover").model_dump(mode="json", warnings=False, exclude_none=True)
    values["vehicle"] |= {"legs": FLIGHTS[flight], "repeat_legs": True}
    plan = make_plan(parse(values | {"duration_s": duration_s}, flight, flight), "fusion", seeds, first_seed=first)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    late = plan.times >= FROM_S
    error, sigma, nees = (np.concatenate([block[name] for block in blocks])[:, late] for name in ("error", "sigma", "nees"))
    cells = [flight, f"{nees.mean():.1f}"]
    for channel in ATTITUDE:
        e, s = (part[:, :, CHANNELS.index(channel)] for part in (error, sigma))
        rms, stated = (float(np.sqrt(np.mean(part**2))) for part in (e, s))
        cells.append(f"{rms:.2f} ({stated:.2f}), {100 * np.mean(np.abs(e) > 3 * s):.1f} %")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=192)
    parser.add_argument("--first", type=int, default=995000)
    parser.add_argument("--duration", type=float, default=600.0)
    chosen = parser.parse_args()
    print("| flight | NEES, 9 states | roll [deg] (stated), beyond 3 sigma | pitch | heading |\n|---|---|---|---|---|")
    for flight in FLIGHTS:
        print(row(flight, chosen.seeds, chosen.first, chosen.duration), flush=True)


if __name__ == "__main__":
    main()
