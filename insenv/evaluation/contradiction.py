"""Where fixes contradict an estimate although each of them passes the gate.

Two signs in the innovations of a filter, which are independent if it is consistent:

- the median of `FIXES` successive test ratios is beyond `RATIO`: estimate and fixes differ by more than both state;
- their velocity jumps from one fix to the next by far more than it usually varies: the inertial unit has missed an impact,
  such as the touch-down of a drone, or the receiver has jumped. The estimate is wrong for some time after it, without a sign
  in the test ratios if the receiver is much better than it states. Of an estimate that is wrong already, or uncertain by as
  much, the jump is its own.

A verdict over a whole run sees neither.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base.remarks import Doubt, Remark, remark
from insenv.core.tables import Array, Vector

FIXES = 5
"""Successive fixes of which the median counts."""
SHORTEST_S = 1.0
"""They cover at least this time: a receiver of 20 Hz has slow errors."""
RATIO = 3.0
"""Median test ratio that contradicts."""
JUMP = 10.0
"""Jump of a velocity in units of its usual variation from one group of `FIXES` to the next (robust standard deviation)."""
SMALLEST_JUMP = 0.3
"""Smaller jumps (m/s) are not reported."""
COVERED = 4.0
"""A jump of fewer standard deviations of the estimate's velocity is covered by what the filter states."""
UNMEASURED_SIGMA = 50.0
"""Standard deviation of an innovation (m/s) from which the receiver does not measure this component."""
COMPONENTS = ("north", "east", "down", "vn", "ve", "vd")


@dataclass(frozen=True)
class Contradiction:
    """An interval (s) in which fixes contradict the estimate, and its component with the largest median test ratio.

    innovation: its median where that ratio is largest (m or m/s), estimate minus fix.
    """

    begin: float
    end: float
    component: str
    ratio: float
    innovation: float


@dataclass(frozen=True)
class Jump:
    """A jump of the innovation of a velocity component between two fixes, at `before` and `after` (s), by `size` (m/s)."""

    before: float
    after: float
    component: str
    size: float


def contradiction_notes(time: Vector, outputs: Mapping[str, Array]) -> tuple[Remark, ...]:
    """The worst contradiction and the largest jump, a sentence each.

    time (n,) s; outputs: `innovation` (n, 6) and `test_ratio` (n, 6), position and velocity in n, of the last fix; there are
    none for an estimator without them. `velocity_sigma` (n, 3) m/s, where there is one.
    """
    intervals, jumped = contradictions(time, outputs), jumps(time, outputs)
    jumped = [jump for jump in jumped if not any(interval.begin <= jump.before for interval in intervals)]
    return (*contradicted(intervals), *velocity_jump(jumped))


@remark(
    "fixes-contradict",
    "the fixes contradict the estimate from {begin:.1f} to {end:.1f} s: {component} is off by {innovation:+.2g} {unit}, "
    "{ratio:.1f} times the combined stated sigma of estimate and fix; the stated sigmas are too small there{more}",
    Doubt,
)
def contradicted(intervals: Sequence[Contradiction]) -> dict[str, Any] | None:
    """The worst of the intervals in which fixes contradict the estimate."""
    if not intervals:
        return None
    worst = max(intervals, key=lambda each: each.ratio)
    unit = "m/s" if worst.component.startswith("v") else "m"
    return {**vars(worst), "unit": unit, "more": _more(len(intervals) - 1, "time")}


@remark(
    "velocity-jump",
    "between {before:.2f} and {after:.2f} s the receiver's {component} changes by {change:+.2g} m/s more than the inertial "
    "unit measures: the unit misses an impact, such as a touch-down, or the receiver jumps; the stated sigmas do not hold for "
    "some time after it{more}",
    Doubt,
)
def velocity_jump(jumps: Sequence[Jump]) -> dict[str, Any] | None:
    """The largest jump of the velocity."""
    if not jumps:
        return None
    largest = max(jumps, key=lambda each: abs(each.size))
    return {**vars(largest), "change": -largest.size, "more": _more(len(jumps) - 1, "jump")}


def _more(count: int, what: str) -> str:
    return "" if not count else f" ({count} more such {what}{'s' if count > 1 else ''})"


def contradictions(time: Vector, outputs: Mapping[str, Array]) -> list[Contradiction]:
    """The intervals in which test ratios stay beyond `RATIO`, in order.  Arguments: see `contradiction_notes`."""
    time, innovations, ratios = _fixes(time, outputs)
    if len(time) < FIXES:
        return []
    width = max(FIXES, int(np.ceil(SHORTEST_S / float(np.median(np.diff(time))))))
    if len(time) < width:
        return []
    median = _medians(ratios, width)
    size = np.abs(median)
    intervals = []
    for group in _groups(contradicts(median), width):
        window, component = np.unravel_index(int(np.argmax(size[group])), (len(group), 6))
        first = int(group[window])
        intervals.append(
            Contradiction(
                begin=float(time[group[0]]),
                end=float(time[group[-1] + width - 1]),
                component=COMPONENTS[component],
                ratio=float(size[first, component]),
                innovation=float(np.median(innovations[first : first + width, component])),
            )
        )
    return intervals


def contradicts(medians: Array) -> NDArray[np.bool_]:
    """Whether the median test ratio of a component (..., components) is beyond `RATIO`."""
    return np.asarray(np.abs(medians).max(axis=-1) > RATIO)


def jumps(time: Vector, outputs: Mapping[str, Array]) -> list[Jump]:
    """The jumps of the velocity, in order.  Arguments: see `contradiction_notes`."""
    records, stated = time, outputs.get("velocity_sigma")
    time, innovations, ratios = _fixes(time, outputs)
    if len(time) < 4 * FIXES:
        return []
    usual_size, usual_ratio = (np.median(np.abs(values), axis=0) for values in (innovations, ratios))
    innovations = innovations * (usual_size < UNMEASURED_SIGMA * usual_ratio)
    median = _medians(innovations[:, 3:], FIXES)
    step = median[FIXES:] - median[:-FIXES]  # between the fixes FIXES - 1 + k and FIXES + k
    usual = 1.4826 * np.median(np.abs(step), axis=0)
    apart = np.diff(time)[FIXES - 1 : FIXES - 1 + len(step)]
    without_gap = apart < 3 * np.median(np.diff(time))
    # a jump is in one step, and steady on both sides of it; slow errors of a receiver are not
    groups = np.lib.stride_tricks.sliding_window_view(innovations[:, 3:], FIXES, axis=0)
    spread = groups.max(axis=-1) - groups.min(axis=-1)
    steady = np.maximum(spread[:-FIXES], spread[FIXES:]) < 0.5 * np.abs(step)
    large = steady & (np.abs(step) > np.maximum(JUMP * usual, SMALLEST_JUMP))
    jumped = []
    for group in _groups(large.any(axis=1) & without_gap, FIXES):
        window, component = np.unravel_index(int(np.argmax(np.abs(step[group] * large[group]))), (len(group), 3))
        first = int(group[window]) + FIXES - 1
        size = float(step[group[window], component])
        sigma = 0.0 if stated is None else float(stated[np.searchsorted(records, time[first + 1]) - 1, component])
        if abs(size) >= COVERED * sigma:
            jumped.append(Jump(float(time[first]), float(time[first + 1]), COMPONENTS[3 + component], size))
    return jumped


def _groups(holds: NDArray[np.bool_], apart: int) -> list[NDArray[np.intp]]:
    """Places at which a condition holds, in groups that are more than `apart` places from each other."""
    at = np.flatnonzero(holds)
    return np.split(at, np.flatnonzero(np.diff(at) > apart) + 1) if at.size else []


def _fixes(time: Vector, outputs: Mapping[str, Array]) -> tuple[Vector, Vector, Vector]:
    """Time (k,), innovation (k, 6) and test ratio (k, 6) of each fix in the records; empty without such outputs."""
    ratios, innovations = outputs.get("test_ratio"), outputs.get("innovation")
    if ratios is None or innovations is None or ratios.shape[1:] != (6,):
        return np.zeros(0), np.zeros((0, 6)), np.zeros((0, 6))
    fresh = np.concatenate([[False], (np.diff(ratios, axis=0) != 0.0).any(axis=1)])
    return time[fresh], innovations[fresh], ratios[fresh]


def _medians(values: Vector, width: int) -> Vector:
    """Medians (n - width + 1, k) of `width` successive rows."""
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(values, width, axis=0), axis=-1))


# Whether a vehicle seems to move sideways: a unit turned about the vertical shows in no innovation.
#
# GNSS measures the motion of a place.  A filter finds the attitude of the unit from it, however the unit is mounted, so axes
# that are named wrongly become a wrong heading with a small stated sigma.  Only a vehicle that moves forward contradicts it.

TRAVEL_SPEED = 3.0
"""Speed over the ground (m/s) from which the course counts."""
SHORTEST_TRAVEL_S = 10.0
"""Shortest time (s) at such speeds."""
LARGEST_HEADING_SIGMA = np.radians(10.0)
"""Largest standard deviation (rad) of a heading that counts."""
STEADY_LENGTH = 0.9
"""Length of the mean of the unit vectors of the angle: nearer 0 for a vehicle that moves in any direction."""
SIDEWAYS = np.radians(30.0)
"""Smallest angle (rad) that is not the drift angle of a ship in a current or of an aircraft in the wind."""
UNLIKELY = 3.0
"""Stated standard deviations of the heading that an angle may be by chance."""
OFF_WHEELS = np.radians(10.0)
"""The same of a vehicle on wheels: a unit that was mounted along it by eye is within some degrees."""


@remark(
    "moves-sideways",
    "the heading is {angle:+.0f} deg from the direction of travel: if this vehicle moves forward, the unit is turned about the "
    "vertical by that; look at `axes` and `mounting_angles_deg`, which fixes of GNSS do not show",
    Doubt,
)
def sideways_notes(time: Vector, outputs: Mapping[str, Array], wheels: bool = False) -> dict[str, Any] | None:
    """Heading less course is steadily far from 0.

    time (n,) s; outputs by row name: `q_nb` (n, 4), `velocity_n` (n, 3) m/s, none of an alignment, and `attitude_sigma` (n, 3)
    rad, where there is one.  wheels: whether the vehicle rolls without moving sideways.
    """
    velocity = outputs.get("velocity_n")
    if velocity is None or len(time) < 2:
        return None
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > TRAVEL_SPEED
    if (sigma := outputs.get("attitude_sigma")) is not None:
        moving &= sigma[:, 2] < LARGEST_HEADING_SIGMA
    if moving.sum() * float(np.median(np.diff(time))) < SHORTEST_TRAVEL_S:
        return None
    heading = attitude.numeric.to_euler(outputs["q_nb"][moving])[2]
    mean = np.mean(np.exp(1j * (heading - np.arctan2(velocity[moving, 1], velocity[moving, 0]))))
    angle = float(np.angle(mean))
    uncertain = 0.0 if sigma is None else UNLIKELY * float(np.median(sigma[moving, 2]))
    forward = abs(angle) < max(OFF_WHEELS if wheels else SIDEWAYS, uncertain)
    return None if abs(mean) < STEADY_LENGTH or forward else {"angle": np.degrees(angle)}
