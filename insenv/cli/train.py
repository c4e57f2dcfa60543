"""The command `insenv train`: simulated runs, cross-validation, the trained file."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Optional

import typer

from insenv.base.errors import InputError, nearest
from insenv.base.output import check_output_file
from insenv.cli.options import Duration, Json, deferred, given_path

LEARNERS = ("lssvm",)
MOST_SEEDS = 10_000


@deferred
def train(
    estimator: Annotated[str, typer.Argument(metavar="ESTIMATOR", help="Estimator to train: lssvm.")],
    scenarios: Annotated[list[str], typer.Argument(metavar="SCENARIO...", help="Scenarios to train on.")],
    seeds: Annotated[str, typer.Option(metavar="A-B", help="Seeds of the runs, first to last.")] = "9001-9080",
    duration: Duration = None,
    support: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(metavar="N", help="Number of support vectors; the default is the largest that the estimator holds."),
    ] = None,
    as_printed: Annotated[
        bool,
        typer.Option("--as-printed", help="Raw differences as inputs, c = 15 and delta^2 = 0.2, as in the paper."),
    ] = False,
    out: Annotated[Path, typer.Option("--out", "-o", parser=given_path, metavar="FILE", help="File to write.")] = Path(
        "lssvm.json"
    ),
    as_json: Json = False,
) -> None:
    """Train an estimator on simulated runs of a filter and write it to a file (docs/estimators/lssvm.md)."""
    from insenv.cli.output import print_json, print_line, print_table, working
    from insenv.studies.learning.training import PRINTED, Choice, need_packages
    from insenv.studies.learning.training import train as learn

    if estimator not in LEARNERS:
        raise InputError(f"estimator {estimator!r} cannot be trained{nearest(estimator, LEARNERS)}")
    chosen = seed_range(seeds)
    check_output_file(out)
    need_packages()
    choice = PRINTED if as_printed else Choice()
    choice = choice if support is None else replace(choice, support=support)
    with working("simulating") as progress:

        def show(work: str, done: int, total: int) -> None:
            progress.describe(work)
            progress(done, total)

        machine = learn(scenarios, chosen, duration_s=duration, choice=choice, progress=show)
        machine.save(out)
    training = machine.training
    if as_json:
        print_json({"file": str(out), "insenv": machine.insenv, **training})
        return
    scores, parameters = training["scores"], training["parameters"]
    rows = [
        ("runs", f"{training['runs_used']}; {training['runs_astray']} more left out because {training['filter']} diverged"),
        ("samples", str(training["samples"])),
        ("gamma, sigma", f"{parameters['gamma']:g}, {parameters['sigma']:g}, by {scores['folds']}-fold cross-validation"),
        ("support vectors", str(parameters["support"])),
        ("held-out error", f"{scores['relative_error']:.2g} of the misalignment, RMS"),
        (
            "residual, deg",
            ", ".join(f"{v:.2g}" for v in scores["residual_deg"]) + " about north, east, down, small misalignments",
        ),
    ]
    print_table(("trained", estimator), rows)
    print_line()
    print_line(f"written to {out}; a scenario uses it with [estimator.lssvm] file = {str(out)!r}")


def seed_range(text: str) -> range:
    """Seeds from ``A-B``, or the single seed ``A``.  Raises `InputError`."""
    found = re.fullmatch(r"(\d{1,16})(?:-(\d{1,16}))?", text.strip())
    first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
    if not 0 <= first <= last <= 2**53 or last - first >= MOST_SEEDS:
        raise InputError(f"seeds {text!r}: allowed is FIRST-LAST, such as 1-100, of at most {MOST_SEEDS} seeds")
    return range(first, last + 1)
