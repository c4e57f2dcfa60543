"""The command `insenv campaign`: Monte Carlo over seeds and ranges of a scenario's keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import Duration, FirstSeed, Json, NoFigure, Out, Scenario, Settings, deferred

if TYPE_CHECKING:
    from insenv.studies.campaign.running import Workers


@deferred
def campaign(
    scenario: Scenario,
    estimator: Annotated[
        list[str], typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run; several are compared.")
    ],
    runs: Annotated[int, typer.Option("--runs", "-n", metavar="N", help="Number of runs.")],
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
    workers: Annotated[Optional[int], typer.Option(metavar="N", help="Use N processes instead of threads.")] = None,  # noqa: UP045
    scheduler: Annotated[Optional[str], typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT.")] = None,  # noqa: UP045
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the results in the folder of --out.")] = False,
    table: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="FORMAT", help="With --out: write a table of the runs, csv or parquet."),
    ] = None,
    no_figure: NoFigure = False,
    as_json: Json = False,
) -> None:
    """Run a scenario many times (Monte Carlo); print the statistics of the errors beside their theoretical limit."""
    from insenv.cli.output import print_result, working
    from insenv.estimators.settings import parsed_settings
    from insenv.report import OutputFolder, write_document
    from insenv.report.tables import runs_of
    from insenv.studies.campaign import compare, make_plans, parse_variation, run_campaigns, stores_of
    from insenv.studies.campaign.comparison import write_comparison
    from insenv.studies.campaign.presentation import check_format

    if resume and out is None:
        raise InputError("--resume continues from a folder: name it with --out DIR")
    if table is not None and out is None:
        raise InputError("--table writes to a folder: name it with --out DIR")
    if table is not None:
        check_format(table)
    pool = _workers(workers, scheduler)
    variations = [parse_variation(text) for text in vary or []]
    plans = make_plans(
        scenario, estimator, runs, first_seed=seed, duration_s=duration, variations=variations, design=design,
        settings=parsed_settings(settings or []),
    )  # fmt: skip
    folder = None if out is None else OutputFolder(out)
    stores = stores_of(None if folder is None else folder.path, plans, resume)
    with working(f"{plans[0].name}, {runs_of(runs)}") as progress:
        summaries = run_campaigns(plans, stores, pool, progress)
        compared = compare(summaries) if len(summaries) > 1 else None
        written = None
        if folder is not None:
            kind = table or ""
            written = (
                write_document(summaries[0].document(kind), folder, not no_figure)
                if compared is None
                else write_comparison(compared, folder, not no_figure, kind)
            )
    unwritten = "--out DIR keeps the page, every run, and the blocks from which --resume continues"
    document = summaries[0].document() if compared is None else compared.document()
    print_result(document, written, as_json, unwritten, further=["blocks/" if compared is None else "*/blocks/"])


def _workers(workers: int | None, scheduler: str | None) -> Workers | None:
    from insenv.studies.campaign import cluster, processes

    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler: allowed is one of them")
    if scheduler is not None:
        return cluster(scheduler)
    return None if workers is None else processes(workers)
