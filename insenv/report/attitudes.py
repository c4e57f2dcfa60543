"""The figure of alignments without a reference: the estimated attitude with its stated three standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from insenv import style
from insenv.evaluation.errors import ATTITUDE, Track
from insenv.report.run_data import RunData
from insenv.report.tables import label
from insenv.style import COLOURS

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
        drawn = [Track(r.time, r.outputs["q_nb"]).euler_deg() for r in report.results if "q_nb" in r.outputs]
        settled = [(d[len(d) // 4 :, ATTITUDE.index(channel)]) for d in drawn]
        low, high = min(float(s.min()) for s in settled), max(float(s.max()) for s in settled)
        room = 0.15 * (high - low) + 0.05
        axis.set_ylim(low - room, high + room)
        axis.set_ylabel(label(channel))
    axes[-1].set_xlabel("time [s]")
    return handles
