"""The command `insenv tune`: how a filter should be tuned."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from insenv.cli.options import Duration, Estimator, FirstSeed, Json, NoFigure, Out, Settings, deferred, one


@deferred
def tune(
    source: Annotated[str, typer.Argument(metavar="SCENARIO|LOG", help="A scenario, or a recorded log as of `insenv replay`.")],
    estimator: Estimator,
    keys: Annotated[
        Optional[list[str]],  # noqa: UP045
        typer.Option("--key", "-k", metavar="KEY", help="Parameter to tune, by its key; may be given more than once."),
    ] = None,
    runs: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option("--runs", "-n", metavar="N", help="Of a scenario: seeds on which to search; 8 by default."),
    ] = None,
    held_out: Annotated[
        Optional[int],  # noqa: UP045
        typer.Option(metavar="N", help="Of a scenario: further seeds on which to judge; 32 by default."),
    ] = None,
    evaluations: Annotated[int, typer.Option(metavar="N", help="About how many sets of factors to try.")] = 200,
    seed: FirstSeed = None,
    duration: Duration = None,
    settings: Settings = None,
    out: Out = None,
    no_figure: NoFigure = False,
    as_json: Json = False,
) -> None:
    """Tune the noises and gates of a filter, and judge the result on data that the search has not seen."""
    from insenv.cli.output import print_result, working
    from insenv.estimators.settings import parsed_settings
    from insenv.report import OutputFolder, write_document
    from insenv.studies.tune import tune as search

    id, given = one(estimator) or "", parsed_settings(settings or [])
    folder = None if out is None else OutputFolder(out)
    with working(f"{source}, {id}") as progress:
        found = search(
            source, id, runs=runs, held_out=held_out, keys=keys, evaluations=evaluations, seed=seed,
            duration_s=duration, settings=given, progress=progress,
        )  # fmt: skip
        written = None if folder is None else write_document(found.document(), folder, not no_figure)
    lines = [found.toml()] if found.is_better else []
    unwritten = f"--out DIR writes {'this section' if found.is_better else 'what was found'}, the page and the figure"
    print_result(found.document(), written, as_json, unwritten, lines)
