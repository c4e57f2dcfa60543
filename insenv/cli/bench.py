"""The command `insenv bench`."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from insenv.cli.options import Json, command

if TYPE_CHECKING:
    from insenv.bench import Figure


@command
def bench(
    only: Annotated[
        Optional[str],  # noqa: UP045
        typer.Option(metavar="PREFIX", help="Only the figures whose names start with this."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure speed and accuracy on this machine, each figure beside its floor."""
    from insenv.base.output import WIDTH
    from insenv.bench import figures, machine, machine_line
    from insenv.cli.output import print_json, print_line, print_table, working
    from insenv.report.tables import number

    measured = []
    with working("measuring") as progress:
        for figure in figures(only):
            measured.append(figure)
            progress.describe(f"measuring: {figure.name} done")
    if as_json:
        print_json({"machine": machine(), "figures": [_row(figure) for figure in measured]})
        return
    print_table(
        ("figure", "value", "floor", "unit", "n", "what"),
        [(f.name, number(f.value), number(f.floor), f.unit, str(f.n), _what(f)) for f in measured],
        right=(1, 2, 4),
    )
    print_line()
    print_line("floor: the same without the work itself (an empty model, a warm start)")
    for line in textwrap.wrap(f"machine: {machine_line(machine())}", WIDTH, subsequent_indent="  "):
        print_line(line)


def _row(figure: Figure) -> dict[str, Any]:
    row = {name: getattr(figure, name) for name in ("name", "value", "unit", "floor", "n", "note")}
    return row if figure.peer is None else {**row, "peer": dict(zip(("name", "value"), figure.peer, strict=True))}


def _what(figure: Figure) -> str:
    from insenv.report.tables import number

    peer = "" if figure.peer is None else f"; {figure.peer[0]}: {number(figure.peer[1])} {figure.unit}"
    return figure.note + peer
