"""What verdicts and doubts are worth: how often they are raised of runs whose errors are as stated, and missing where not.

python tools/alarms.py [--seeds 64] [--first 640000] [SCENARIO ...]      an hour for all scenarios

Every scenario with fixes and each estimator below that takes it, as a log would be judged: by what `insenv replay` asks of
innovations and outputs, but for what needs a reference.  The truth then says whether the doubt was due: an angle, or a
component of velocity or position, is beyond three stated sigmas for more than 5 % of the time.  Errors last, so that this
happens to some runs of a filter that is right.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence

from insenv.base.errors import InputError
from insenv.evaluation.contradiction import contradiction_notes, sideways_notes
from insenv.evaluation.errors import BEYOND_SHARE, Result
from insenv.evaluation.health import WRONG, health, models_slow_errors
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.runs.simulated import result_of, track_of
from insenv.scenario import load, names
from insenv.scenario.inputs import RECORDS
from insenv.vehicles.registry import traits_of

ESTIMATORS = ("loosely-coupled", "fusion")
AT_ONCE = 16
HEADER = (
    "| scenario | estimator | runs | doubted | without cause | errors beyond | of these without a word | by |\n"
    "| --- | --- | --- | --- | --- | --- | --- | --- |"
)


def judged(made: Ensemble, estimator: str) -> Iterator[Result]:
    """The result of each run, with the notes that a log of it would have."""
    for row, plant in enumerate(made.plants):
        chosen = plant.adapted(estimator, offline=False)
        outputs = {name: values[row] for name, values in made.outputs[chosen.id].items()}
        truth = {name: values[row] for name, values in made.truth.items()}
        parameters = chosen.model.parameters.unpack(chosen.model.parameters.pack(plant.parameters_of(chosen, offline=False)))
        found = health(outputs)
        notes = (
            *chosen.shown(parameters, made.time, outputs),
            *(found.notes(models_slow_errors(parameters), chosen.causes) if found else ()),
            *contradiction_notes(made.time, outputs),
            *sideways_notes(made.time, outputs, traits_of(plant.scenario.vehicle.kind).wheels),
        )
        track = track_of(made.time, truth)
        yield result_of(chosen, outputs, track, None, us_per_sample=0.0, notes=notes, health=found)


def doubts(result: Result) -> tuple[str, ...]:
    """Why the run is doubted: its verdict, codes of notes; nothing of a consistent one."""
    verdict = () if result.health is None or result.health.gnss.verdict not in WRONG else (result.health.gnss.verdict,)
    return (*verdict, *result.doubts)


def row(scenario: str, estimator: str, seeds: Sequence[int]) -> str:
    """The line of a scenario and an estimator."""
    why: Counter[str] = Counter()
    doubted = needless = wrong = silent = 0
    for begin in range(0, len(seeds), AT_ONCE):
        made = ensemble(scenario, estimator, seeds[begin : begin + AT_ONCE], records=RECORDS)
        for result in judged(made, estimator):
            said = doubts(result)
            due = any(result.beyond(name) > BEYOND_SHARE for name in result.errors if name in result.sigma)
            doubted, wrong = doubted + bool(said), wrong + due
            needless, silent = needless + (bool(said) and not due), silent + (due and not said)
            why.update(said)
    by = ", ".join(f"{code} {count}" for code, count in why.most_common()) or "-"
    return f"| `{scenario}` | `{estimator}` | {len(seeds)} | {doubted} | {needless} | {wrong} | {silent} | {by} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scenario", nargs="*")
    parser.add_argument("--seeds", type=int, default=64)
    parser.add_argument("--first", type=int, default=640000)
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    print(HEADER)
    for scenario in options.scenario or sorted(names()):
        if load(scenario).gnss is None:
            continue
        for estimator in ESTIMATORS:
            try:
                print(row(scenario, estimator, seeds), flush=True)
            except InputError as error:
                print(f"| `{scenario}` | `{estimator}` | - | - | - | - | - | {' '.join(str(error).split())[:80]} |", flush=True)


if __name__ == "__main__":
    main()
