"""The command `insenv bench`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from insenv.cli.options import Json, command


@command
def bench(
    only: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="PREFIX", help="Only the figures whose names start with this."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure speed and accuracy on this machine, each figure beside its floor."""
    from insenv.bench import document, figures
    from insenv.cli.output import print_blocks, print_json, working

    measured = []
    with working("measuring") as progress:
        for figure in figures(only):
            measured.append(figure)
            progress.describe(f"measuring: {figure.name} done")
    shown = document(measured)
    if as_json:
        print_json(shown.as_json())
        return
    print_blocks(shown.blocks())
