"""Lines and tables of a `Document` for a terminal: the one place where they become Rich's."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from insenv.base.output import WIDTH
from insenv.report.document import Block, Grid, Line, Listing, Sentences

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table
    from rich.text import Text

LABEL = 13
"""Characters that the column of labels has at least."""


NARROWEST = 24
"""Columns that the last column of a listing has at least."""
MAX_WIDTH = 1000
"""More columns than any table needs."""
GAP = 2
"""Columns between those of a listing."""


def fitted(console: Console, blocks: Iterable[Block]) -> Iterator[RenderableType]:
    """What a console prints for blocks, top to bottom; as wide as it must be: a terminal breaks the lines itself."""
    width = console.width
    for block, part in zip(blocks := list(_lines(blocks)), rendered(blocks), strict=True):
        if isinstance(block, Listing):
            needed = _fixed_width(block) + NARROWEST
        else:
            measured = console.measure(part, options=console.options.update(width=MAX_WIDTH))
            needed = measured.maximum if isinstance(block, Grid) else measured.minimum
        console.width = max(width, needed)
        yield part


def as_text(blocks: Iterable[Block]) -> str:
    """The lines of blocks as in a file or pipe, `insenv.base.output.WIDTH` columns wide."""
    from rich.console import Console

    console = Console(width=WIDTH, file=io.StringIO(), markup=False, highlight=False, emoji=False, color_system=None)
    with console.capture() as captured:
        for part in fitted(console, blocks):
            console.print(part)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())


def rendered(blocks: Iterable[Block]) -> Iterator[RenderableType]:
    """What Rich prints for blocks, top to bottom."""
    for block in _lines(blocks):
        yield _table(block) if isinstance(block, Grid) else _listing(block) if isinstance(block, Listing) else _text(block)


def _lines(blocks: Iterable[Block]) -> Iterator[Line | Grid | Listing]:
    for block in blocks:
        yield from block.lines if isinstance(block, Sentences) else [block]


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
        table.add_row(*(_text(cell) if isinstance(cell, Line) else cell for cell in row[: len(grid.columns)]))
    return table


def _listing(listing: Listing) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_header=listing.head, show_edge=False, pad_edge=False, padding=(0, GAP, 0, 0))
    for place, name in enumerate(listing.columns):
        last, justify = place == len(listing.columns) - 1, "right" if place in listing.right else "left"
        table.add_column(name, no_wrap=not last, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for row in listing.rows:
        table.add_row(*row)
    return table


def _fixed_width(listing: Listing) -> int:
    """Width of the columns that do not wrap."""
    from rich.cells import cell_len

    *fixed, _ = zip(listing.columns, *listing.rows, strict=True)
    return sum(max(map(cell_len, column)) + GAP for column in fixed)
