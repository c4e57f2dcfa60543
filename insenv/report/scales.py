"""The vertical scale of an error panel: linear, or symmetric logarithmic if a linear scale would hide small errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

FALL, SPREAD = 10.0, 50.0
"""The scale is logarithmic if errors fall by more along the run, or if estimators differ by more."""


def threshold_of(errors: list[Array], reach: list[float]) -> float | None:
    """Up to which value the scale is linear, and logarithmic beyond it; None for a linear scale.

    errors, reach: by estimator, its errors and the extent of its limit or stated accuracy. A logarithmic scale is linear within
    the errors of the best estimator in the last quarter, so that these are legible beside the initial errors of the worst one.
    """
    largest, settled = _extents(errors, reach)
    if largest <= FALL * max(settled) and max(settled) <= SPREAD * min(settled):
        return None
    return _round_up(min(settled))


def _extents(errors: list[Array], reach: list[float]) -> tuple[float, list[float]]:
    """The largest error, and for each estimator that of the last quarter with its reach."""
    finite = [(e[np.isfinite(e)], r) for e, r in zip(errors, reach, strict=True)]
    finite = [(e, r) for e, r in finite if e.size]
    largest = max((float(np.abs(e).max()) for e, _ in finite), default=0.0)
    return largest, [max(float(np.abs(e[len(e) * 3 // 4 :]).max()), r, 1e-300) for e, r in finite] or [1.0]


def set_scale(axis: Axes, errors: list[Array], reach: list[float]) -> dict[str, Any]:
    """Set the scale of `threshold_of`; return the legend's handle for the linear part of a logarithmic one."""
    from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

    largest, settled = _extents(errors, reach)
    threshold = threshold_of(errors, reach)
    if threshold is None:
        top = 1.12 * max(largest, *settled)
        axis.set_ylim(-top, top)
        axis.yaxis.set_major_locator(MaxNLocator(5))
        return {}
    finite = [e[np.isfinite(e)] for e in errors if np.isfinite(e).any()]
    lowest, highest = min(float(e.min()) for e in finite), max(float(e.max()) for e in finite)
    bottom, top = min(1.8 * lowest, -1.3 * max(settled)), max(1.8 * highest, 1.3 * max(settled))
    powers = range(math.ceil(math.log10(4.0 * threshold)), math.floor(math.log10(max(top, -bottom))) + 1)
    stride = -(-len(powers) // 3) or 1
    marks = [threshold, *(10.0**power for power in powers[stride - 1 :: stride])]
    if not powers and (near := _round_up(max(top, -bottom) / 2.6)) > threshold:
        marks.append(near)
    ticks = [*(-m for m in reversed(marks)), 0.0, *marks]
    axis.set_yscale("symlog", linthresh=threshold, linscale=1.3)
    axis.yaxis.set_major_locator(FixedLocator(ticks))
    axis.yaxis.set_minor_locator(NullLocator())
    axis.yaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "\N{MINUS SIGN}"))
    axis.set_ylim(bottom, top)
    style.mark_scale(axis, threshold)
    name = "scale: linear here, logarithmic beyond"
    return {name: axis.axhspan(-threshold, threshold, color=style.LINEAR, linewidth=0, zorder=0, label=name)}


def _round_up(value: float) -> float:
    """The next larger of 1, 2, 5, 10, ..."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if value <= step * power * (1 + 1e-9))
