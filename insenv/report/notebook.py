"""Results in a notebook: HTML with the figure inside, and pandas DataFrames."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.installing import is_installed, need
from insenv.base.style import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

HtmlTable = tuple[str, Sequence[str], Iterable[Sequence[str]]]
"""Caption, names of the columns, rows."""


def require_matplotlib() -> None:
    """Raise `InputError` if matplotlib is not installed."""
    need("a figure", "matplotlib", extra="plot")


def html_document(
    title: str, facts: str, tables: Iterable[HtmlTable], notes: Sequence[str] = (), plot: Callable[[], Figure] | None = None
) -> str:
    """A title, tables, notes and, if `plot` is given and matplotlib is installed, the figure as a PNG in a data URI."""
    parts = [f"<p><b>{escape(title)}</b><br>{escape(facts)}</p>", *(_table(*table) for table in tables)]
    parts += [f"<p>note: {escape(note)}</p>" for note in notes]
    if plot is not None and is_installed("matplotlib"):
        stream = io.BytesIO()
        save(plot(), {"png": stream})
        image = base64.b64encode(stream.getvalue()).decode("ascii")
        parts.append(f'<img src="data:image/png;base64,{image}" style="max-width: 100%" alt="{escape(title)}">')
    return "\n".join(parts)


def _table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    def line(tag: str, cells: Sequence[str]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    lines = [line("th", columns), *(line("td", row) for row in rows)]
    return f"<table><caption>{escape(caption)}</caption>{''.join(lines)}</table>"


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
