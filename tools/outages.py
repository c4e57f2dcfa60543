"""Largest errors in the outages of a drive, by filter: the table on the page of `fusion`.

    python tools/outages.py                      prints it, some minutes
    python tools/outages.py --write              and into docs/estimators/fusion.md
    python tools/outages.py car-odometer -n 4    fewer

By filter: the root mean square, over runs and outages, of the largest horizontal error of an outage, and the root mean square
heading error from 300 s on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import insenv
from insenv.estimators.contract import Estimator
from insenv.scenario import load

FIRST_SEED, RUNS = 30000, 16
"""No filter was tuned on these seeds."""
SETTLED = 300.0
"""s, from which the heading counts."""
PAGE = Path(__file__).parents[1] / "docs" / "estimators" / "fusion.md"
BEGIN, END = "<!-- begin outages -->\n", "<!-- end outages -->"


@dataclass(frozen=True)
class Case:
    """A filter on a scenario with outages; what: how the table names it."""

    scenario: str
    what: str
    estimator: str | Estimator


def cases() -> tuple[Case, ...]:
    """The rows of the table."""
    unit = ("gyro_scale", "gyro_misalignment", "accel_scale", "accel_misalignment", "gnss_wander")
    held = insenv.fusion(unit, ["gnss", "zero_velocity", "non_holonomic"], id="wheels")
    free = insenv.fusion(unit, ["gnss", "zero_velocity"], id="no-wheels")
    return (
        *(Case("car-survey", f"`{id}`", id) for id in ("loosely-coupled", "fusion", "fusion-smoother")),
        *(Case("car-odometer", f"`{id}`, odometer and wheels", id) for id in ("fusion", "fusion-smoother")),
        Case("car-odometer", "aids gnss, zero_velocity, non_holonomic", held),
        Case("car-odometer", "aids gnss, zero_velocity", free),
    )


def rows(scenario: str, runs: int) -> Iterator[str]:
    """Lines of the table in Markdown."""
    chosen = [case for case in cases() if case.scenario == scenario]
    gnss = load(scenario).gnss
    assert gnss is not None
    worst: list[list[float]] = [[] for _ in chosen]
    heading: list[list[float]] = [[] for _ in chosen]
    for seed in range(FIRST_SEED, FIRST_SEED + runs):
        results = insenv.run(scenario, [case.estimator for case in chosen], seed=seed).results
        for k, found in enumerate(results):
            error = np.hypot(found.errors["north_m"], found.errors["east_m"])
            for begin, end in gnss.outages_s:
                worst[k].append(float(error[(found.time >= begin) & (found.time <= end)].max()))
            heading[k].append(float(np.mean(found.errors["heading_deg"][found.time >= SETTLED] ** 2)))
    for k, case in enumerate(chosen):
        yield f"| {scenario} | {case.what} | {np.sqrt(np.mean(np.square(worst[k]))):.3g} | {np.sqrt(np.mean(heading[k])):.2g} |"


HEADER = f"| scenario | filter | outages, m | heading from {SETTLED:g} s, deg |\n|---|---|---|---|"


def main(arguments: list[str] | None = None) -> None:
    """Measure the cases of these scenarios and print their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scenarios", nargs="*", help="all, if none is named")
    parser.add_argument("-n", "--runs", type=int, default=RUNS)
    parser.add_argument("--write", action="store_true", help="write the table into docs/estimators/fusion.md")
    given = parser.parse_args(arguments)
    if given.write and (given.runs != RUNS or given.scenarios):
        parser.error(f"--write: the table has all scenarios and {RUNS} seeds")
    print(HEADER)
    lines = []
    for scenario in given.scenarios or dict.fromkeys(case.scenario for case in cases()):
        for line in rows(scenario, given.runs):
            print(line, flush=True)
            lines.append(line)
    if given.write:
        before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        said = f"{RUNS} runs, seeds {FIRST_SEED} to {FIRST_SEED + RUNS - 1} (`python tools/outages.py --write`):"
        after = END + rest.split(END)[1]
        PAGE.write_text("\n".join([before + BEGIN.rstrip(), "", said, "", HEADER, *lines, "", after]), encoding="utf-8")


if __name__ == "__main__":
    main()
