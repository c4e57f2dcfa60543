"""Results in the hand of a user: figures, files, HTML for notebooks, pandas DataFrames."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InsenvError
from insenv.base.installing import is_installed, need
from insenv.base.style import save
from insenv.report.console import as_text
from insenv.report.document import Document, Page, Table
from insenv.report.figures import draw
from insenv.report.files import FilesWritten, OutputFolder, write_document

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


class Shown:
    """A result with a `Document`: how it is drawn, saved and shown in a notebook."""

    def document(self) -> Document:
        """What is printed and kept of it."""
        raise NotImplementedError

    def plot(self) -> Figure:
        """The figure.  Raises `InsenvError` if matplotlib is missing or there is nothing to draw."""
        need("a figure", "matplotlib", extra="plot")
        document = self.document()
        if document.figure is None:
            raise InsenvError(document.undrawn)
        return draw(document.figure())

    def save(self, folder: str | Path, figure: bool = True) -> FilesWritten:
        """Write the files, as ``--out`` does: JSON, arrays and, if `figure`, the page and (with matplotlib) the figure.

        Raises `InputError` if the folder cannot be written to, `InsenvError` if writing fails.
        """
        return write_document(self.document(), OutputFolder(folder), figure)

    def __str__(self) -> str:
        """The tables that the command prints, at most 80 columns wide where that is possible."""
        return as_text(self.document().blocks())

    def _repr_html_(self) -> str | None:
        document = self.document()
        return None if document.page is None else notebook_html(document, document.page())


def notebook_html(document: Document, page: Page) -> str:
    """Title, tables and notes of a page, and the figure as a PNG in a data URI if matplotlib is installed."""
    title = f"{page.name}: {page.title}"
    parts = [f"<p><b>{escape(title)}</b><br>{escape(', '.join(page.facts))}</p>", *map(_table, page.tables)]
    parts += [f"<p>note: {escape(note)}</p>" for note in page.notes]
    if document.figure is not None and is_installed("matplotlib"):
        stream = io.BytesIO()
        save(draw(document.figure()), {"png": stream})
        image = base64.b64encode(stream.getvalue()).decode("ascii")
        parts.append(f'<img src="data:image/png;base64,{image}" style="max-width: 100%" alt="{escape(title)}">')
    return "\n".join(parts)


def _table(table: Table) -> str:
    def line(tag: str, cells: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    lines = [line("th", table.heads or table.columns), *(line("td", row) for row in table.texts)]
    below = "".join(f"<p>{escape(sentence)}</p>" for sentence in table.below)
    return f"<table><caption>{escape(table.caption)}</caption>{''.join(lines)}</table>{below}"


def data_frame(index: NDArray[Any], columns: Mapping[str, NDArray[Any]], name: str = "time") -> DataFrame:
    """A DataFrame indexed by time (s), or by what `name` says; a column of an array (n, k) becomes ``NAME_0``, ``NAME_1``, ...

    Raises `InputError` if pandas is not installed.
    """
    need("a DataFrame", "pandas")
    import pandas

    flat: dict[str, NDArray[Any]] = {}
    for column, values in columns.items():
        if values.ndim == 1:
            flat[column] = values
        else:
            flat |= {"_".join(map(str, (column, *at))): values[(..., *at)] for at in np.ndindex(values.shape[1:])}
    return pandas.DataFrame(flat, index=pandas.Index(index, name=name))
