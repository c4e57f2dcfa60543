"""The commands that study a filter or a unit: `insenv tune`, `train`, `budget`, `allan`, `campaign`."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from insenv.base.errors import InputError, nearest
from insenv.base.output import check_output_file
from insenv.cli.options import (
    Duration,
    Estimator,
    FirstSeed,
    Json,
    Log,
    Output,
    Scenario,
    Settings,
    changed_log,
    changed_scenario,
    command,
    each_once,
    nonempty_path,
    one,
    out_option,
    renamed,
)

if TYPE_CHECKING:
    from insenv.studies.campaign.running import Workers


@command
def tune(
    source: Annotated[str, typer.Argument(metavar="SCENARIO|LOG", help="A scenario, or a log that `insenv replay` reads.")],
    estimator: Estimator,
    output: Output,
    keys: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--key", "-k", metavar="KEY", help="Parameter to tune, by its key; may be given more than once."),
    ] = None,
    runs: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option("--runs", "-n", metavar="N", help="Of a scenario: number of seeds to tune on; 8 by default."),
    ] = None,
    held_out: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(metavar="N", help="Of a scenario: number of further seeds to evaluate on; 32 by default."),
    ] = None,
    evaluations: Annotated[int, typer.Option(metavar="N", help="Approximate number of parameter sets to try.")] = 200,
    seed: FirstSeed = None,
    duration: Duration = None,
    settings: Settings = None,
) -> None:
    """Tune the noises and gates of a filter, and evaluate the result on held-out data."""
    from insenv.logs.loading import is_log
    from insenv.studies.tune import tune as search

    id = one(estimator) or ""
    taken, values = changed_log(Path(source), settings) if is_log(source) else changed_scenario(source, settings)
    with output.working(f"{source}, {id}") as progress:
        tuning = search(
            taken, id, runs=runs, held_out=held_out, keys=keys, evaluations=evaluations, seed=seed,
            duration_s=duration, settings=values, progress=progress,
        )  # fmt: skip
        output.keep(tuning.document())
    lines = [tuning.toml()] if tuning.is_better else []
    unwritten = f"--out DIR writes {'this section' if tuning.is_better else 'the result'}, the page and the figure"
    output.show(tuning.document(), unwritten, lines)


# The command `insenv train`: simulated runs, cross-validation, the trained file.

LEARNERS = ("lssvm",)
MAX_SEEDS = 10_000


@command
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
    out: Annotated[Path, out_option("FILE", "File to write.")] = Path("lssvm.json"),
    as_json: Json = False,
) -> None:
    """Train an estimator on simulated runs of a filter and write it to a file (docs/estimators/lssvm.md)."""
    from insenv.cli.output import print_json, print_line, print_table, working
    from insenv.studies.learning.training import PRINTED, Choice, need_packages
    from insenv.studies.learning.training import train as learn

    if estimator not in LEARNERS:
        raise InputError(f"estimator {estimator!r} cannot be trained{nearest(estimator, LEARNERS)}")
    seed_numbers = seed_range(seeds)
    check_output_file(out)
    need_packages()
    choice = PRINTED if as_printed else Choice()
    choice = choice if support is None else replace(choice, support=support)
    with working("simulating") as progress:

        def show(work: str, done: int, total: int) -> None:
            progress.describe(work)
            progress(done, total)

        machine = learn(scenarios, seed_numbers, duration_s=duration, choice=choice, progress=show)
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
    match = re.fullmatch(r"(\d{1,16})(?:-(\d{1,16}))?", text.strip())
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if not 0 <= first <= last <= 2**53 or last - first >= MAX_SEEDS:
        raise InputError(f"seeds {text!r}: allowed is FIRST-LAST, such as 1-100, of at most {MAX_SEEDS} seeds")
    return range(first, last + 1)


# The command `insenv budget`: which source of error dominates.


@command
def budget(
    scenario: Scenario,
    estimator: Estimator,
    output: Output,
    runs: Annotated[int, typer.Option("--runs", "-n", metavar="N", help="Number of seeds.")] = 64,
    seed: FirstSeed = None,
    duration: Duration = None,
    settings: Settings = None,
) -> None:
    """Print how much each source of error contributes: the error with it alone and without it, on the same seeds."""
    from insenv.report.tables import runs_of
    from insenv.studies.budget import budget as share_out

    id = one(estimator) or ""
    loaded, values = changed_scenario(scenario, settings)
    with output.working(f"{loaded.name}, {runs_of(runs)}") as progress:
        shares = share_out(loaded, id, runs, seed=seed, duration_s=duration, settings=values, progress=progress)
        output.keep(shares.document())
    output.show(shares.document(), "--out DIR writes the page, the figure and the contributions over time")


# The command `insenv allan`: what is my unit?


@command
def allan(
    log: Log,
    output: Output,
    begin: Annotated[
        Optional[float],  # noqa: UP045
        typer.Option("--from", metavar="S", help="Start of the part to use; without --from and --to the longest rest."),
    ] = None,
    end: Annotated[Optional[float], typer.Option("--to", metavar="S", help="End of the part to use.")] = None,  # noqa: UP045
    grade: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option("--grade-out", parser=nonempty_path, metavar="FILE.toml", help='Write a file for grade = "FILE.toml".'),
    ] = None,
    old_grade: Annotated[Optional[Path], typer.Option("--grade", parser=nonempty_path, hidden=True)] = None,  # noqa: UP045
) -> None:
    """Measure the noise of a log's inertial unit by its Allan deviation; write a grade file."""
    from insenv.studies.allan import allan as measure
    from insenv.studies.allan_result import GRADE_FILE, assumed, check_grade, document, write_grade

    if old_grade is not None:
        if grade is not None:
            raise InputError("--grade is the former name of --grade-out: allowed is one of them")
        grade = renamed("--grade", "--grade-out", old_grade)
    check_grade(grade)
    with output.working(log.name) as progress:
        deviation = measure(log, from_s=begin, to_s=end, progress=progress)
        if grade is not None:
            write_grade(deviation, grade)
        at = grade if grade is not None or output.folder is None else output.folder.path / GRADE_FILE
        made = document(deviation, None if at is None else str(at))
        output.keep(made)
    lines = [f'written to {grade}: grade = "{grade.name}" in [imu] of a scenario or a log is this unit'] if grade else []
    lines += [assumed(deviation)] if at is not None else []
    unwritten = "" if grade is not None else "--grade-out FILE.toml writes the grade of this unit, --out DIR the figure too"
    output.show(made, unwritten, lines)


# The command `insenv campaign`: Monte Carlo over seeds and ranges of a scenario's keys.


@command
def campaign(
    scenario: Scenario,
    estimator: Annotated[
        list[str], typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; several are compared.")
    ],
    runs: Annotated[int, typer.Option("--runs", "-n", metavar="N", help="Number of runs.")],
    output: Output,
    seed: FirstSeed = None,
    duration: Duration = None,
    vary: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(
            metavar="KEY=LOW:HIGH",
            help="Draw a key of the scenario for each run; also KEY=normal(a,b), lognormal, loguniform, choice(a,b).",
        ),
    ] = None,
    design: Annotated[
        str, typer.Option(metavar="NAME", help="Spread varied keys over the runs: random, latin, sobol or saltelli.")
    ] = "random",
    settings: Settings = None,
    workers: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option("--workers", "--jobs", "-j", metavar="N", help="Use N processes instead of threads."),
    ] = None,
    scheduler: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="ADDRESS", help="Run on this Dask scheduler, tcp://HOST:PORT."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the results in the folder of --out.")] = False,
    table: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="FORMAT", help="With --out: write a table of the runs, csv or parquet."),
    ] = None,
) -> None:
    """Run a scenario many times (Monte Carlo); print the statistics of the errors beside their theoretical limit."""
    from insenv.report.tables import runs_of
    from insenv.studies.campaign import compare, make_plans, parse_variation, run_campaigns, stores_of
    from insenv.studies.campaign.comparison import write_comparison
    from insenv.studies.campaign.presentation import check_format

    folder = output.folder
    if resume and folder is None:
        raise InputError("--resume continues from a folder: name it with --out DIR")
    if table is not None and folder is None:
        raise InputError("--table writes to a folder: name it with --out DIR")
    if table is not None:
        check_format(table)
    pool = _workers(workers, scheduler)
    variations = [parse_variation(text) for text in vary or []]
    loaded, values = changed_scenario(scenario, settings)
    plans = make_plans(
        loaded, each_once(estimator), runs, first_seed=seed, duration_s=duration, variations=variations, design=design,
        settings=values,
    )  # fmt: skip
    stores = stores_of(None if folder is None else folder.path, plans, resume)
    with output.working(f"{plans[0].name}, {runs_of(runs)}") as progress:
        summaries = run_campaigns(plans, stores, pool, progress)
        compared = compare(summaries) if len(summaries) > 1 else None
        if compared is None:
            output.keep(summaries[0].document(table or ""))
        elif folder is not None:
            output.written = write_comparison(compared, folder, output.figure, table or "")
    unwritten = "--out DIR keeps the page, every run and the blocks that --resume goes on from"
    document = summaries[0].document() if compared is None else compared.document()
    output.show(document, unwritten, further=["blocks/" if compared is None else "*/blocks/"])


def _workers(workers: int | None, scheduler: str | None) -> Workers | None:
    from insenv.studies.campaign import cluster, processes

    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler: allowed is one of them")
    if scheduler is not None:
        return cluster(scheduler)
    return None if workers is None else processes(workers)
