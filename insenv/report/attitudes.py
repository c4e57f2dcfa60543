"""The figure of alignments without a reference: the estimated attitude with its stated three standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base import style
from insenv.base.style import COLOURS
from insenv.evaluation.errors import ATTITUDE, Track
from insenv.report.run_data import RunData
from insenv.report.tables import label

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def page(figure: Figure, report: RunData, shown: list[str]) -> dict[str, Any]:
    """Draw roll, pitch and heading over time; return the legend's handles by their text."""
    figure.set_size_inches(8.0, 7.5)
    axes = figure.subplots(3, 1, sharex=True)
    handles: dict[str, Any] = {}
    for index, result in enumerate(report.results):
        if "q_nb" not in result.outputs:
            continue
        colour = COLOURS[index % len(COLOURS)]
        angles = Track(result.time, result.outputs["q_nb"]).euler_deg()
        for axis, channel, angle in zip(axes, ATTITUDE, angles.T, strict=True):
            (handles[result.estimator],) = axis.plot(result.time, style.unwrapped(angle), color=colour, zorder=3)
            if channel in result.sigma:
                around, name = 3.0 * result.sigma[channel], f"{result.estimator}: stated ±3 sigma"
                handles[name] = axis.fill_between(
                    result.time, angle - around, angle + around, color=colour, alpha=0.16, linewidth=0, zorder=2
                )
    for axis, channel in zip(axes, ATTITUDE, strict=True):
        axis.set_ylim(*_reach(report, channel))
        axis.set_ylabel(label(channel))
    axes[-1].set_xlabel("time [s]")
    return handles


def _reach(report: RunData, channel: str) -> tuple[float, float]:
    """The range of an angle (deg) that is shown: all values after the first quarter, with the median of three sigma around."""
    ends = []
    for result in report.results:
        if "q_nb" in result.outputs:
            angle = Track(result.time, result.outputs["q_nb"]).euler_deg()[:, ATTITUDE.index(channel)]
            late = angle[len(angle) // 4 :]
            around = 3.0 * float(np.median(result.sigma[channel])) if channel in result.sigma else 0.0
            ends += [float(late.min()) - around, float(late.max()) + around]
    room = 0.08 * (max(ends) - min(ends)) + 1e-3
    return min(ends) - room, max(ends) + room
