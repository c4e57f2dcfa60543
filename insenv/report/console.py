"""Lines and tables of a `Document` for a terminal: the one place where they become Rich's."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from insenv.report.document import Block, Grid, Line

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table
    from rich.text import Text

LABEL = 13
"""Characters that the column of labels has at least."""


def rendered(blocks: Iterable[Block]) -> Iterator[RenderableType]:
    """What Rich prints for blocks, top to bottom."""
    for block in blocks:
        yield _table(block) if isinstance(block, Grid) else _text(block)


def _text(line: Line) -> Text:
    from rich.text import Text

    text = Text(line.text, line.style)
    if line.rest:
        text.append(line.rest, "not bold")
    return text


def _table(grid: Grid) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, grid.gap, 0, 0))
    first, *others = grid.columns
    table.add_column(first, no_wrap=True, min_width=LABEL)
    for name in others:
        table.add_column(name, justify="right", min_width=grid.least, no_wrap=True)
    for place, row in enumerate(grid.rows):
        if place == grid.rule:
            table.add_section()
        table.add_row(*(_text(cell) if isinstance(cell, Line) else cell for cell in row))
    return table
