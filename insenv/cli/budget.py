"""The command `insenv budget`: which source of error dominates."""

from __future__ import annotations

from typing import Annotated

import typer

from insenv.cli.options import Duration, Estimator, FirstSeed, Json, NoFigure, Out, Scenario, Settings, deferred, one


@deferred
def budget(
    scenario: Scenario,
    estimator: Estimator,
    runs: Annotated[int, typer.Option("--runs", "-n", metavar="N", help="Number of seeds.")] = 64,
    seed: FirstSeed = None,
    duration: Duration = None,
    settings: Settings = None,
    out: Out = None,
    no_figure: NoFigure = False,
    as_json: Json = False,
) -> None:
    """Say which source of error dominates: each alone, and all but it, on the same seeds."""
    from insenv.cli.output import print_result, working
    from insenv.estimators.settings import parsed_settings
    from insenv.report import OutputFolder, write_document
    from insenv.report.tables import runs_of
    from insenv.scenario import load
    from insenv.studies.budget import budget as share_out

    id, given = one(estimator) or "", parsed_settings(settings or [])
    folder = None if out is None else OutputFolder(out)
    loaded = load(scenario)
    with working(f"{loaded.name}, {runs_of(runs)}") as progress:
        found = share_out(loaded, id, runs, seed=seed, duration_s=duration, settings=given, progress=progress)
        written = None if folder is None else write_document(found.document(), folder, not no_figure)
    unwritten = "--out DIR writes the page, the figure and the contributions over time"
    print_result(found.document(), written, as_json, unwritten)
