"""The figure of an error budget: contributions stacked over time, and their shares."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base.style import COLOURS, DASHED, LIMIT, legend, page, title
from insenv.evaluation.errors import CHANNELS
from insenv.report.tables import label, runs_of
from insenv.studies.budget_presentation import ranked
from insenv.studies.budget_result import Array, Budget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6BB1", "#A6761D", "#7A9A01", "#F0E442")
_OTHERS, _METHOD = "#c8c8c8", "#7f7f7f"


def draw_budget(found: Budget) -> Figure:
    """By channel: root of the sum of squares, band by band, with the error with all sources and the limit; their shares.

    Mean squares add up, and a band ends at the root of the sum of those below it and its own.  The largest source is the
    lowest band; the thickness of a band higher up therefore shows less than its rms.
    """
    own, others = ranked(found)
    names = [name for name in CHANNELS if name in found.channels]
    handles: dict[str, Any] = {}
    with page() as figure:
        if len(names) == 3:
            figure.set_size_inches(9.5, 8.4)
            panels = figure.subplots(3, 2, sharex=True, width_ratios=(1.4, 1))
            for (left, right), name in zip(panels, names, strict=True):
                handles |= _stack(left, found, name, own, others)
                _shares(right, found, name, own, others)
            panels[0, 0].set_title("Contributions: root of the sum of squares")
            panels[0, 1].set_title("Shares in the variance, %")
            bottom = panels[-1]
        else:
            rows = len(names) // 3
            figure.set_size_inches(11.0, 1.8 + 2.3 * rows)
            panels = figure.subplots(rows, 3, sharex=True)
            for axes, name in zip(panels.ravel(), names, strict=True):
                handles |= _stack(axes, found, name, own, others)
            bottom = panels[-1]
        for axes in bottom:
            axes.set_xlabel("time [s]")
        title(figure, f"{found.scenario}: error budget of {found.estimator}\n{runs_of(found.runs)} of {found.duration_s:g} s")
        legend(figure, handles, columns=4)
        return figure


def _bands(found: Budget, name: str, own: list[int], others: list[int]) -> list[tuple[str, str, Array]]:
    """Name, colour and mean square (records,) of each band, the lowest first."""
    place = found.channels.index(name)
    bands = [(found.sources[k], _COLOURS[j], np.nan_to_num(found.alone[k, :, place])) for j, k in enumerate(own)]
    if others:
        bands.append((f"{len(others)} others", _OTHERS, np.nan_to_num(found.alone[others][..., place]).sum(axis=0)))
    return [*bands, ("method", _METHOD, found.none[:, place])]


def _stack(axes: Axes, found: Budget, name: str, own: list[int], others: list[int]) -> dict[str, Any]:
    """Draw one channel; return the legend's handles by their text."""
    handles: dict[str, Any] = {}
    below = np.zeros(len(found.time))
    for text, colour, square in _bands(found, name, own, others):
        above = below + square
        handles[text] = axes.fill_between(found.time, np.sqrt(below), np.sqrt(above), color=colour, linewidth=0, label=text)
        below = above
    place = found.channels.index(name)
    (handles["all sources"],) = axes.plot(found.time, np.sqrt(found.whole[:, place]), color=COLOURS[6], label="all sources")
    late = found.time >= 0.3 * found.time[-1] if found.from_s > 0 else np.full(len(found.time), True)
    tops = [np.sqrt(below[late]), np.sqrt(found.whole[late, place])]
    if found.limit is not None:
        limit = np.sqrt(found.limit[:, place])
        (line,) = axes.plot(found.time, limit, color="white", linewidth=2.2)
        (line,) = axes.plot(found.time, limit, color=LIMIT, linestyle=DASHED, label="theoretical limit")
        handles["theoretical limit"] = line
        tops.append(limit[late])
    # an alignment begins with errors that would hide the rest
    highest = float(np.nanmax(np.concatenate(tops)))
    axes.set_ylim(0.0, 1.1 * highest if highest > 0.0 else 1.0)
    axes.set_xlim(0.0, float(found.time[-1]))
    axes.set_ylabel(label(name))
    return handles


def _shares(axes: Axes, found: Budget, name: str, own: list[int], others: list[int]) -> None:
    """Draw the shares of one channel over time."""
    bands = _bands(found, name, own, others)
    total = np.sum([square for *_, square in bands], axis=0)
    below = np.zeros(len(found.time))
    for _, colour, square in bands:
        above = below + 100.0 * np.divide(square, total, out=np.zeros_like(total), where=total > 0.0)
        axes.fill_between(found.time, below, above, color=colour, linewidth=0)
        below = above
    axes.set_ylim(0.0, 100.0)
    axes.set_xlim(0.0, float(found.time[-1]))
