"""What a command shows and keeps of its result, before anything renders it.

A result gives its `Document`: lines and tables, the documented JSON values, arrays, a page, a figure.  The terminal
(`insenv.report.console`) and the files (`insenv.report.files`) are made from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from insenv.base.output import finite

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Style = Literal["", "bold", "dim", "yellow"]


@dataclass(frozen=True)
class Line:
    """A line of text, or a cell of a table.  rest: text behind it without the style."""

    text: str = ""
    style: Style = ""
    rest: str = ""


@dataclass(frozen=True)
class Grid:
    """A table of texts: a column of labels, and columns of numbers of at least `least` characters, `gap` + 1 apart.

    rule: the row above which a rule is drawn; None: none.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str | Line]]
    rule: int | None = None
    least: int = 7
    gap: int = 2


Block = Line | Grid


@dataclass(frozen=True, eq=False)
class Document:
    """The parts of a result; those that take time are made when they are asked for.

    name: stem of its files.  values: the documented JSON form.  blocks: what is printed, top to bottom.  texts: contents of
    files by name, which come first.  arrays: of the file NAME.npz.  page: the HTML.  further: files that come last, by name,
    each written by a function of its path.
    """

    name: str
    values: Mapping[str, Any]
    blocks: Callable[[], Iterable[Block]]
    texts: Mapping[str, str] = field(default_factory=dict)
    arrays: Callable[[], Mapping[str, Any]] | None = None
    page: Callable[[], str] | None = None
    figure: Callable[[], Figure] | None = None
    further: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)

    def as_json(self, files: Sequence[str] = ()) -> dict[str, Any]:
        """The JSON document; with `files` (paths written) if there are any."""
        return dict(finite({**self.values, **({"files": list(files)} if files else {})}))
