"""What a precision of `insenv export c` costs: the largest differences from double precision over seeds and scenarios.

    python tools/precision.py float32 --seeds 64
    python tools/precision.py mixed fusion car-odometer ship-underway --seeds 8

The filter is exported with the first seed and runs the samples of all of them.  For each scenario it prints the largest share
of the stated sigma over all seeds, the median of the seeds, and the quantities with the largest shares.
"""

from __future__ import annotations

import argparse
import math
import statistics

import numpy as np

from insenv.base.errors import InputError
from insenv.core.portable import Portable, c_files, identifier
from insenv.export.board.exporter import in_one
from insenv.export.board.precision import NEEDED, Compiled, largest_shares, single_elements, tolerance
from insenv.export.board.tuned import tuned

SCENARIOS = ("car-city-drive", "car-odometer", "ship-underway", "multirotor-hover", "aircraft-survey")
SHOWN = 4


def main() -> None:
    parser = argparse.ArgumentParser(description="What a precision of insenv export c costs, over seeds.")
    parser.add_argument("precision", choices=[name for name in NEEDED if name != "double"])
    parser.add_argument("estimator", nargs="?", default="loosely-coupled")
    parser.add_argument("scenarios", nargs="*")
    parser.add_argument("--seeds", type=int, default=4, help="seeds 1 to N")
    parser.add_argument("--duration", type=float, default=300.0, help="s of each run")
    given = parser.parse_args()
    for scenario in given.scenarios or SCENARIOS:
        shares = of_scenario(given.precision, given.estimator, scenario, given.seeds, given.duration)
        worst = [max(each.values()) for each in shares]
        names = {name for each in shares for name in each}
        largest = {name: max(each.get(name, 0.0) for each in shares) for name in names}
        listed = sorted(largest, key=lambda name: -largest[name])[:SHOWN]
        told = ", ".join(f"{name} {largest[name]:.2g}" for name in listed)
        print(f"{scenario}: {max(worst):.2g} (median {statistics.median(worst):.2g}; {len(worst)} seeds): {told}", flush=True)


def of_scenario(precision: str, estimator: str, scenario: str, seeds: int, duration: float) -> list[dict[str, float]]:
    """The shares of each seed, by quantity."""
    source, shares = "", []
    for seed in range(1, seeds + 1):
        ready = tuned(estimator, scenario, seed=seed, duration_s=duration)
        model, name = ready.estimator.model, identifier(estimator)
        if not source:
            rows = single_elements(precision, model)
            portable = Portable(name, ready.parameters, ready.dt, ready.values_from, rows, tolerance(precision, ready))
            source = in_one(c_files(model, portable), name)
        runners = Compiled(source, model, ready.parameters), ready.runner()
        try:
            outputs = [[runner.run(len(part), part, ready.every) for runner in runners] for part in ready.inputs()]
        except InputError:
            shares.append({"diverged": math.inf})
            continue
        shares.append(largest_shares(model, *(np.vstack(each) for each in zip(*outputs, strict=True))))
    return shares


if __name__ == "__main__":
    main()
