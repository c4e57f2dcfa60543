"""The command `insenv campaign`: Monte Carlo over seeds and ranges of a scenario's keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Optional

import typer

from insenv.cli.options import Duration, Json, NoFigure, Out, Scenario, deferred
from insenv.errors import InputError

if TYPE_CHECKING:
    from insenv.campaigns.executors import Workers


@deferred
def campaign(
    scenario: Scenario,
    estimator: Annotated[list[str], typer.Option("--estimator", "-e", metavar="ID", help="Estimator to run.")],
    runs: Annotated[int, typer.Option("--runs", "-n", metavar="N", help="Number of runs.")],
    seed: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(
            metavar="FIRST", help="Seed of the first run, which replaces the scenario's; later runs count up from it."
        ),
    ] = None,
    duration: Duration = None,
    vary: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option(metavar="KEY=LOW:HIGH", help="Draw a key of the scenario for each run; may be given more than once."),
    ] = None,
    workers: Annotated[Optional[int], typer.Option(metavar="N", help="Use N processes instead of threads.")] = None,  # noqa: UP045
    scheduler: Annotated[Optional[str], typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT.")] = None,  # noqa: UP045
    out: Out = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the results in the folder of --out.")] = False,
    no_figure: NoFigure = False,
    as_json: Json = False,
) -> None:
    """Run a scenario many times (Monte Carlo); print the statistics of the errors beside their theoretical limit."""
    from insenv.campaigns import Folder, make_plan, parse_variation, run_campaign
    from insenv.campaigns.presentation import campaign_document, campaign_tables, write_campaign
    from insenv.cli.output import print_json, print_line, print_parts, working
    from insenv.report import OutputFolder
    from insenv.scenario import load

    if len(estimator) != 1:
        raise InputError(
            f"--estimator: {' and '.join(estimator)} are given: a campaign runs one; run one campaign for each, with the same "
            "--seed and another --out"
        )
    if resume and out is None:
        raise InputError("--resume continues from a folder: name it with --out DIR")
    pool = _workers(workers, scheduler)
    variations = [parse_variation(text) for text in vary or []]
    plan = make_plan(load(scenario), estimator[0], runs, first_seed=seed, duration_s=duration, variations=variations)
    folder = None if out is None else OutputFolder(out)
    store = None if folder is None else Folder(folder.path, plan, resume)
    with working(f"{plan.name}, {plan.runs} runs") as progress:
        found = run_campaign(plan, store=store, workers=pool, progress=progress)
        written = None if folder is None else write_campaign(found, folder, not no_figure)
    paths = [str(path) for path in written.paths] if written else []
    if written and written.note:
        print_line(f"insenv: {written.note}", stderr=True)
    if as_json:
        print_json(campaign_document(found, paths))
        return
    print_parts(campaign_tables(found))
    print_line()
    if written:
        print_line(f"written to {written.paths[0].parent}: {', '.join(path.name for path in written.paths)}, blocks/")
    else:
        print_line("--out DIR keeps the figure, every run, and the blocks from which --resume continues")


def _workers(workers: int | None, scheduler: str | None) -> Workers | None:
    from insenv.campaigns import cluster, processes

    if workers is not None and scheduler is not None:
        raise InputError("--workers and --scheduler: allowed is one of them")
    if scheduler is not None:
        return cluster(scheduler)
    return None if workers is None else processes(workers)
