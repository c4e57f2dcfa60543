"""The command `insenv campaign`: Monte Carlo over seeds and ranges of a scenario's keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Optional

import typer

from insenv.base.errors import InputError
from insenv.cli.options import Duration, FirstSeed, Output, Scenario, Settings, changed_scenario, command, each_once

if TYPE_CHECKING:
    from insenv.studies.campaign.running import Workers


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
    unwritten = "--out DIR keeps the page, every run, and the blocks from which --resume continues"
    document = summaries[0].document() if compared is None else compared.document()
    output.show(document, unwritten, further=["blocks/" if compared is None else "*/blocks/"])


def _workers(workers: int | None, scheduler: str | None) -> Workers | None:
    from insenv.studies.campaign import cluster, processes

    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler: allowed is one of them")
    if scheduler is not None:
        return cluster(scheduler)
    return None if workers is None else processes(workers)
