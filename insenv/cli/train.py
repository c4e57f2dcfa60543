"""What `insenv train` does: runs to learn from, cross-validation, the file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from insenv.errors import InputError, nearest
from insenv.files.output import check_output_file

LEARNERS = ("lssvm",)
MOST_SEEDS = 10_000


def train(
    estimator: str,
    scenarios: Sequence[str],
    *,
    seeds: str,
    duration_s: float | None,
    support: int | None,
    out: Path,
    as_json: bool,
) -> None:
    """Train `estimator` on the scenarios and write the file; print what was learnt."""
    from insenv.cli.output import print_json, print_line, print_table, quiet_warnings, working
    from insenv.learning.training import Choice, need_packages
    from insenv.learning.training import train as learn

    if estimator not in LEARNERS:
        raise InputError(f"estimator {estimator!r} does not learn{nearest(estimator, LEARNERS)}")
    chosen = seed_range(seeds)
    check_output_file(out)
    need_packages()
    choice = Choice() if support is None else Choice(support=support)
    with quiet_warnings(), working("simulating") as progress:

        def tell(work: str, done: int, total: int) -> None:
            progress.describe(work)
            progress(done, total)

        machine = learn(scenarios, chosen, duration_s=duration_s, choice=choice, progress=tell)
        machine.save(out)
    training = machine.training
    if as_json:
        print_json({"file": str(out), "insenv": machine.insenv, **training})
        return
    scores, parameters = training["scores"], training["parameters"]
    rows = [
        ("runs", f"{training['runs_used']}, {training['runs_astray']} left out in which {training['filter']} went astray"),
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
    print_line(f"written to {out}; a scenario takes it by [estimator.lssvm] file = {str(out)!r}")


def seed_range(text: str) -> range:
    """Seeds from ``A-B``, or the one of ``A``.  Raises `InputError`."""
    found = re.fullmatch(r"(\d{1,16})(?:-(\d{1,16}))?", text.strip())
    first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
    if not 0 <= first <= last <= 2**53 or last - first >= MOST_SEEDS:
        raise InputError(f"seeds {text!r}: allowed is FIRST-LAST, such as 1-100, of at most {MOST_SEEDS} seeds")
    return range(first, last + 1)
