"""The figure of a campaign: percentiles of the errors over time, and the mean NEES."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base.style import COLOURS, DASHED, LIMIT, PALE, legend, page, title, unwrapped
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.report.scales import set_scale
from insenv.report.tables import label, runs_of
from insenv.studies.campaign.statistics import Statistics

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_campaign(found: Statistics) -> Figure:
    """Percentiles of the errors over time with plus and minus the limit; the mean NEES with its bounds if there is one."""
    with page() as figure:
        groups = [[name for name in group if name in found.courses] for group in (ATTITUDE, POSITION, VELOCITY)]
        groups = [group for group in groups if group]
        rows = len(groups) + (found.nees is not None)
        handles: dict[str, Any] = {}
        if len(groups) == 1:  # attitude only: one row of panels per angle; on the right, the end of the run
            count = 3 + (found.nees is not None)
            figure.set_size_inches(9.0, 1.2 + 2.1 * count)
            axes = figure.subplots(count, 2, squeeze=False, sharex="col", width_ratios=(1.25, 1))
            for (left, right), name in zip(axes, groups[0], strict=False):
                for axis, from_s in ((left, 0.0), (right, found.from_s)):
                    handles |= _course(axis, found, name, from_s)
                left.set_ylabel(label(name).replace(" [", " error ["))
            axes[0, 0].set_title("Error over the whole run", loc="left")
            axes[0, 1].set_title(f"From {found.from_s:g} s on, where the statistics are taken", loc="left")
            if found.nees is not None:
                for axis, from_s in zip(axes[-1], (0.0, found.from_s), strict=True):
                    _nees(axis, found, from_s)
                axes[-1, 0].set_ylabel("mean NEES")
            bottom = list(axes[-1])
        else:
            figure.set_size_inches(11.0, 1.4 + 2.2 * rows)
            axes = figure.subplots(rows, 3, squeeze=False, sharex=True)
            for row, group in zip(axes, groups, strict=False):
                for axis, name in zip(row, group, strict=True):
                    handles |= _course(axis, found, name, 0.0)
                    axis.set_title(label(name).replace(" [", " error ["), loc="left")
            if found.nees is not None:
                _nees(axes[-1, 0], found, 0.0)
                axes[-1, 0].set_title("Mean NEES over the runs", loc="left")
                for above, axis in zip(axes[-2, 1:], axes[-1, 1:], strict=True):
                    axis.set_axis_off()
                    above.tick_params(labelbottom=True)
            bottom = list(axes[-1]) if found.nees is None else [axes[-1, 0], *axes[-2, 1:]]
        for axis in bottom:
            axis.set_xlabel("time [s]")
        plan = found.plan
        title(figure, f"{plan.name}: {plan.estimator}\n{runs_of(plan.runs)} of {plan.duration_s:g} s")
        legend(figure, handles, columns=3)
        return figure


def _course(axis: Axes, found: Statistics, name: str, from_s: float) -> dict[str, Any]:
    """Draw one channel from `from_s` on; return the legend's handles by their text."""
    course, late = found.courses[name], found.time >= from_s - 1e-9
    time = found.time[late]
    low, lower, median, upper, high = course.percentiles[:, late]
    handles: dict[str, Any] = {}
    axis.axhline(0.0, color=PALE, linewidth=0.6, zorder=1)
    for below, above, alpha, share in ((low, high, 0.16, "95 %"), (lower, upper, 0.32, "68 %")):
        text = f"{share} of the runs"
        handles[text] = axis.fill_between(time, below, above, color=COLOURS[0], alpha=alpha, linewidth=0, zorder=2, label=text)
    shown = unwrapped(median) if name in ATTITUDE else median
    (handles["median"],) = axis.plot(time, shown, color=COLOURS[0], zorder=3, label="median")
    reach = 0.0
    if course.limit is not None:
        for sign in (-1, 1):
            (line,) = axis.plot(time, sign * course.limit[late], color=LIMIT, linestyle=DASHED, linewidth=1.0, zorder=4)
        line.set_label("theoretical limit, ±1 sigma")
        handles[str(line.get_label())] = line
        reach = float(np.nanmax(course.limit[late][-max(1, len(time) // 4) :]))
    axis.set_xlim(from_s, float(found.time[-1]))
    return handles | set_scale(axis, [np.concatenate([low, high]) if from_s > 0 else np.stack([low, high], 1).ravel()], [reach])


def _nees(axis: Axes, found: Statistics, from_s: float) -> None:
    """Draw the mean NEES with the bounds of a consistent estimator."""
    assert found.nees is not None
    late = found.time >= from_s - 1e-9
    axis.axhspan(found.nees.low, found.nees.high, color=COLOURS[2], alpha=0.2, linewidth=0, zorder=1)
    axis.axhline(found.nees.degrees, color=LIMIT, linestyle=DASHED, linewidth=1.0, zorder=2)
    axis.plot(found.time[late], found.nees.mean[late], color=COLOURS[2], zorder=3)
    axis.set_xlim(from_s, float(found.time[-1]))
    axis.set_ylim(0.0, None)
