"""The one style of all figures of insenv: colours, fonts, shading of outages, legends beside the curves, saving.

A figure is drawn inside `page`, which needs no display and leaves the settings of matplotlib as they were::

    with style.page(7.5, 5.0) as figure:
        axes = figure.subplots()
        axes.plot(time, error, color=style.COLOURS[0], label="q-method")
        style.legend(figure, axes)
        style.save(figure, {"png": path})
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's colours without yellow: distinguishable by colour-blind readers, and legible on white
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LIMIT, TRUTH, PALE = "#555555", "#bbbbbb", "#888888"
OUTAGE, STATISTICS, LINEAR = "#ece5e0", "#f4f4f4", "#f1f0e6"
"""Backgrounds: of a time without fixes, of the time of the statistics, of the linear part of a logarithmic scale."""
DASHED = (0, (4, 2))
TITLE = 10.5
"""Size of the title of a figure, points."""
STYLE: Any = {
    "font.family": "DejaVu Sans",  # part of matplotlib: the same everywhere
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "legend.frameon": False,
    "path.simplify": True,
    "path.simplify_threshold": 0.5,
    "svg.hashsalt": "insenv",  # makes the ids in an SVG reproducible
}


def styled() -> AbstractContextManager[None]:
    """The style, on the defaults of matplotlib whatever the user's settings are."""
    from matplotlib import rc_context, rcParamsDefault

    of_user = ("backend", "date.", "toolbar")
    defaults = {name: value for name, value in rcParamsDefault.items() if not name.startswith(of_user)}
    return rc_context({**defaults, **STYLE})


@contextmanager
def page(width: float = 7.5, height: float = 5.0, dpi: float = 100.0) -> Iterator[Figure]:
    """An empty figure of this size (inches) in the style."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with styled():
        figure = Figure(figsize=(width, height), dpi=dpi, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


def save(figure: Figure, paths: Mapping[str, Path | BinaryIO]) -> None:
    """Save to each path or stream, by kind ("png", "svg"); the same figure gives the same bytes."""
    metadata: dict[str, dict[str, Any]] = {"svg": {"Date": None, "Creator": "insenv"}, "png": {"Software": "insenv"}}
    with styled():
        for kind, path in paths.items():
            figure.savefig(path, format=kind, dpi=150, metadata=metadata.get(kind, {}))


def title(figure: Figure, text: str) -> None:
    """The title of a figure, as plain text."""
    figure.suptitle(text.replace("$", r"\$"), fontsize=TITLE)


def legend(figure: Figure, drawn: Axes | Mapping[str, Any] | Iterable[Axes], columns: int = 4) -> None:
    """The legend below the panels, where it hides no curve: of handles by text, or of what the axes have labelled."""
    from matplotlib.axes import Axes as AnyAxes

    handles: dict[str, Any] = dict(drawn) if isinstance(drawn, Mapping) else {}
    for axes in () if handles else (drawn,) if isinstance(drawn, AnyAxes) else drawn:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):  # type: ignore[union-attr]
            handles.setdefault(label, handle)
    if handles:
        figure.legend(
            handles=list(handles.values()), labels=list(handles), loc="outside lower center", ncols=min(columns, len(handles))
        )


def shade(axes: Axes, intervals: Iterable[tuple[float, float]]) -> dict[str, Any]:
    """Shade intervals of time without GNSS; return the legend's handle by its text."""
    handles: dict[str, Any] = {}
    text = "no GNSS"
    for begin, end in intervals:
        span = axes.axvspan(begin, end, color=OUTAGE, linewidth=0, zorder=0.5, label="" if handles else text)
        handles.setdefault(text, span)
    return handles


def unwrapped(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (n,), deg, with a gap where they wrap from 180 to -180, so that no line is drawn across."""
    return np.where(np.abs(np.diff(angle, prepend=angle[:1])) > 180.0, np.nan, angle)


def mark_scale(axes: Axes, threshold: float) -> None:
    """Say at the right edge of a symmetric logarithmic scale, linear up to `threshold`, where it is which."""
    small: dict[str, Any] = {"fontsize": 6.5, "color": PALE, "annotation_clip": False, "textcoords": "offset points"}
    for place, text, above in ((threshold, "log", "bottom"), (0.0, "linear", "center"), (-threshold, "log", "top")):
        axes.annotate(
            text,
            (1.0, place),
            (3, 0),
            xycoords=("axes fraction", "data"),
            va=above,
            rotation=0 if text == "log" else 90,
            **small,
        )


def symlog(axes: Axes, threshold: float) -> None:
    """A symmetric logarithmic scale, linear up to `threshold`, with plain numbers at the ticks."""
    axes.set_yscale("symlog", linthresh=threshold)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}"))
    mark_scale(axes, threshold)


def log(axes: Axes) -> None:
    """A logarithmic scale with plain numbers at the ticks."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 100 * low else (1.0,)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
