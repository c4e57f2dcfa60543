"""What a command shows and keeps of its result, before anything renders it.

A result gives its `Document`: lines and tables, the documented JSON values, arrays, a page, a figure, all of them data.  The
terminal (`insenv.report.console`), the files (`insenv.report.files`), the page (`insenv.report.page`) and the figure
(`insenv.report.figures`) are made from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from insenv.base.output import finite
from insenv.report.panels import Picture, Section

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


@dataclass(frozen=True)
class Table(Grid):
    """A grid that stands on the page too, where its first column names the row.

    caption: on the page.  heads: names of its columns there, where they are others or more than on a terminal, which then
    leaves out the last cells of each row.  group: entry in the legend.  below: sentences on the page.  state: a word on the
    health of what the table shows (`insenv.evaluation.nis.VERDICTS`).  wide: no table stands beside it.
    """

    caption: str = ""
    heads: Sequence[str] = ()
    group: int | None = None
    below: Sequence[str] = ()
    state: str = ""
    wide: bool = False

    @property
    def texts(self) -> list[list[str]]:
        """The cells by row, without their styles."""
        return [[cell.text if isinstance(cell, Line) else cell for cell in row] for row in self.rows]

    @property
    def marked(self) -> list[tuple[int, int]]:
        """Row and column of the cells in yellow."""
        cells = [(cell, row, column) for row, line in enumerate(self.rows) for column, cell in enumerate(line)]
        return [(row, column) for cell, row, column in cells if isinstance(cell, Line) and cell.style == "yellow"]


@dataclass(frozen=True)
class Sentences:
    """Sentences, each a line of its own.  place: where the page has them.  head: what precedes each on a terminal."""

    place: Literal["facts", "explained", "notes"]
    texts: Sequence[str]
    style: Style = ""
    head: str = ""

    @property
    def lines(self) -> list[Line]:
        """As a terminal shows them."""
        return [Line(f"{self.head}{text}", self.style) for text in self.texts]


@dataclass(frozen=True)
class Listing:
    """A table of texts as wide as the terminal, whose last column wraps.

    right: places of the columns that are aligned right.  head: whether the names of the columns are shown.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    right: Sequence[int] = ()
    head: bool = True


Block = Line | Grid | Listing | Sentences


@dataclass(frozen=True)
class Page:
    """A page: what the front end calls a report (web/README.md).

    tab: title of the file.  truth: how `TRUTH_GROUP` is called.  legend: entries by group, of which those without a name are
    not listed.  explained: what the columns of the tables mean.  more: as the axis that is not time.  further: other
    documents of the page by kind, as "live".
    """

    tab: str
    name: str
    title: str
    facts: Sequence[str]
    legend: Sequence[Mapping[str, Any]]
    tables: Sequence[Table]
    sections: Sequence[Section]
    explained: Sequence[str] = ()
    notes: Sequence[str] = ()
    truth: str = "truth"
    more: Mapping[str, Any] = field(default_factory=dict)
    further: Mapping[str, Any] = field(default_factory=dict)


def page_of(blocks: Iterable[Block], **parts: Any) -> Page:
    """The page of what is printed, which its first line names.

    parts: of the page; facts, tables, explanations and notes follow those of the blocks.
    """
    heading, *blocks = blocks
    named = {"tab": heading.text, "name": heading.text} if isinstance(heading, Line) else {}
    printed: dict[str, list[Any]] = {
        name: [text for block in blocks if isinstance(block, Sentences) and block.place == name for text in block.texts]
        for name in ("facts", "explained", "notes")
    }
    printed["explained"] = [f"{text}." for text in printed["explained"]]
    printed["tables"] = [block for block in blocks if isinstance(block, Table)]
    return Page(**named | parts | {name: [*own, *parts.get(name, ())] for name, own in printed.items()})


Part = Literal["texts", "npz", "json", "html", "png", "svg", "further"]


@dataclass(frozen=True, eq=False)
class Document:
    """The parts of a result; those that take time are made when they are asked for.

    name: stem of its files.  values: the documented JSON form.  blocks: what is printed, top to bottom.  texts: contents of
    files by name.  arrays: of the file NAME.npz.  further: files by name, each written by a function of its path.  undrawn: why
    there is no figure.  order: of the files.  located: whether the JSON names them with their folder; without it equal results
    are equal files.
    """

    name: str
    values: Mapping[str, Any]
    blocks: Callable[[], Iterable[Block]]
    texts: Mapping[str, str] = field(default_factory=dict)
    arrays: Callable[[], Mapping[str, Any]] | None = None
    page: Callable[[], Page] | None = None
    figure: Callable[[], Picture] | None = None
    further: Mapping[str, Callable[[Path], None]] = field(default_factory=dict)
    undrawn: str = ""
    order: Sequence[Part] = ("texts", "npz", "json", "html", "png", "svg", "further")
    located: bool = False

    def as_json(self, files: Sequence[str] = ()) -> dict[str, Any]:
        """The JSON document; with `files` (paths written) if there are any."""
        return dict(finite({**self.values, **({"files": list(files)} if files else {})}))
