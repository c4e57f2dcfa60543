"""Run every estimator on every scenario that it accepts, over many seeds, and judge its errors and its stated sigmas.

    python tools/matrix.py                                       the whole table, printed row by row (half an hour)
    python tools/matrix.py car-parked -e qakf -n 512 --first-seed 20000
    python tools/matrix.py --write                               and into docs/consistency.md; other rows there are kept

By pair: the share of the recorded errors, over all runs and times, beyond three stated standard deviations, of attitude,
position and velocity (of the three components the largest), and the root mean square error of the last record against the
limit there.  A Gaussian error with the stated sigma gives 0.3 %.  The errors of a run are correlated (a bias lasts as long as
the run), so the share comes with its standard error, from the scatter of the runs' own shares.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insenv
from insenv import estimators
from insenv.base.errors import InputError
from insenv.evaluation.errors import ATTITUDE, CHANNELS
from insenv.evaluation.limits import ratio
from insenv.scenario import build, load
from insenv.scenario.files import names
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

Array = NDArray[np.float64]

RUNS = 64
FIRST_SEED = 7000
"""No estimator was tuned on seeds 7000 to 7063."""
BEYOND = 3.0


@dataclass(frozen=True)
class Judged:
    """One estimator on one scenario.

    time (records,) s.  error, sigma: (runs, records, channels), channels as `CHANNELS`.  limit: at the last record, by channel.
    notes: on where it may not be trusted, before it runs.
    unjudged: channels that are left out (`insenv.evaluation.limits.Limit.unjudged`).
    """

    scenario: str
    estimator: str
    time: Array
    error: Array
    sigma: Array
    limit: dict[str, float]
    notes: tuple[str, ...]
    unjudged: tuple[str, ...] = ()

    def beyond(self, begin: int) -> tuple[float, float] | None:
        """Share of errors beyond `BEYOND` stated sigmas of that of three channels from `begin` on which has most, and its
        standard error; None without these channels.
        """
        if self.error.shape[2] <= begin:
            return None
        part = [place for place in range(begin, begin + 3) if CHANNELS[place] not in self.unjudged]
        shares = np.mean(np.abs(self.error[:, :, part]) > BEYOND * self.sigma[:, :, part], axis=1)
        worst = shares[:, np.argmax(shares.mean(axis=0))]
        return float(worst.mean()), float(worst.std(ddof=1) / np.sqrt(len(worst)))

    @property
    def ratios(self) -> list[float | None]:
        """Root mean square over the runs of the error at the last record over the limit, by channel."""
        last = np.sqrt(np.mean(self.error[:, -1] ** 2, axis=0))
        return [ratio(float(rms), self.limit.get(name), name) for name, rms in zip(ATTITUDE, last, strict=False)]


def judge(scenario: str, estimator: str, runs: int = RUNS, first_seed: int = FIRST_SEED) -> Judged | None:
    """Run one pair; None for an estimator that states no sigmas.  Raises `InputError` where it refuses the scenario."""
    if "attitude_sigma" not in estimators.get(estimator).model.outputs:
        return None
    if estimators.get(estimator).smooths:
        return _smoothed(scenario, estimator, range(first_seed, first_seed + runs))
    limit = insenv.limit(scenario)
    plan = make_plan(scenario, estimator, runs, first_seed=first_seed)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    error, sigma = (np.concatenate([block[name] for block in blocks]) for name in ("error", "sigma"))
    at_end = {name: float(values[-1]) for name, values in limit.at(plan.times[-1:]).items()}
    notes = tuple(note for note in plan.notes if note not in plan.plant.scenario.notes)
    return Judged(scenario, estimator, plan.times, error, sigma, at_end, notes, limit.unjudged)


def _smoothed(scenario: str, estimator: str, seeds: Sequence[int]) -> Judged:
    """A smoother, seed by seed: campaigns refuse it, and it has no limit."""
    results = [insenv.run(scenario, estimator, seed=seed).results[0] for seed in seeds]
    error, sigma = (
        np.array([np.stack([found[name] for name in CHANNELS], axis=1) for found in each])
        for each in ([r.errors for r in results], [r.sigma for r in results])
    )
    plant = build(load(scenario))
    chosen = plant.adapted(estimator)
    notes = chosen.notes(plant.parameters_of(chosen), plant.duration_s)
    return Judged(scenario, estimator, results[0].time, error, sigma, {}, notes, results[0].unjudged)


HEADER = "\n".join((
    "| scenario | estimator | attitude beyond 3 sigma, % | position, % | velocity, % | rms/limit at the end | noted |",
    "|---" * 7 + "|",
))  # fmt: skip


def row(found: Judged) -> str:
    """A line of the table in Markdown."""
    shares = (found.beyond(begin) for begin in (0, 3, 6))
    cells = ["" if share is None else f"{100 * share[0]:.1f} +- {100 * share[1]:.1f}" for share in shares]
    ratios = ", ".join("-" if value is None else f"{value:.3g}" for value in found.ratios)
    return f"| {found.scenario} | {found.estimator} | {' | '.join(cells)} | {ratios} | {'yes' if found.notes else ''} |"


PAGE = Path(__file__).parents[1] / "docs" / "consistency.md"
BEGIN, END = "<!-- begin matrix -->\n", "<!-- end matrix -->"


def write(rows: Sequence[str], day: date, page: Path = PAGE) -> None:
    """Put rows into the table of the page, in the place of those of the same pair, in the order of scenarios and estimators."""
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    old, after = rest.split(END)
    table = {_pair(line): line for line in (*old.splitlines(), *rows) if line.count("|") == 8 and _pair(line)[0] in names()}
    lines = [table[pair] for pair in ((s, e) for s in names() for e in estimators.registered()) if pair in table]
    said = f"{RUNS} seeds from {FIRST_SEED}, last written on {day.isoformat()}."
    page.write_text("\n".join([before + BEGIN.rstrip(), "", said, "", HEADER, *lines, "", END + after]), encoding="utf-8")


def _pair(line: str) -> tuple[str, str]:
    scenario, estimator = (cell.strip() for cell in line.split("|")[1:3])
    return scenario, estimator


def main(arguments: list[str] | None = None) -> None:
    """Run the pairs that are asked for, and print their rows as they come."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("scenarios", nargs="*", help="all, if none is named")
    parser.add_argument("-e", "--estimator", action="append", help="all, if none is named")
    parser.add_argument("-n", "--runs", type=int, default=RUNS)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--write", action="store_true", help="write the rows into docs/consistency.md")
    given = parser.parse_args(arguments)
    if given.write and (given.runs, given.first_seed) != (RUNS, FIRST_SEED):
        parser.error(f"--write: the table has {RUNS} seeds from {FIRST_SEED}")
    print(HEADER)
    for scenario in given.scenarios or names():
        for id in given.estimator or estimators.registered():
            try:
                found = judge(scenario, id, given.runs, given.first_seed)
            except InputError:  # it refuses this scenario
                continue
            if found is not None:
                print(row(found), flush=True)
                if given.write:
                    write([row(found)], date.today())


if __name__ == "__main__":
    main()
