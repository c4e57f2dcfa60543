"""What a reader delivers of a flight log: series of inertial units, receivers and solutions, each with its name in that log.

Times are in seconds on one clock of the log. Everything else is in SI, radians, body FRD, NED.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, TypeVar

import numpy as np

from insenv.base.remarks import Remark
from insenv.core.tables import Array
from insenv.logs.recorded import GnssFixes, Readings, Reference

FIX_3D = 3
"""Fix type of a position fix in three dimensions, in every format."""
UNIX_US = 10**14
"""Time stamps beyond this many microseconds (3 years) are Unix time, not time since boot."""


@dataclass(frozen=True)
class ImuSeries:
    """Samples of one unit: time (n,) s, rate_ib_b (n, 3) rad/s, specific_force_b (n, 3) m/s^2.

    stamp: whether the time is the end of the interval over which the sample is the mean, or the instant of the sample.
    """

    name: str
    time: Array
    rate_ib_b: Array
    specific_force_b: Array
    stamp: Literal["interval_end", "instant"]

    @property
    def rate_hz(self) -> float:
        """Median rate (Hz); 0 for fewer than two samples."""
        steps = np.diff(self.time)
        steps = steps[steps > 0.0]
        return float(1.0 / np.median(steps)) if steps.size else 0.0


@dataclass(frozen=True, kw_only=True)
class FixSeries(GnssFixes):
    """Fixes of one receiver, as the log has them.

    time: of validity as far as the log shows it. height: above mean sea level if `height_sea`; undulation (m): of the geoid
    above the ellipsoid there, None if the log does not state it. If the log does not state them, position_sigma is NaN and
    velocity_sigma None; a velocity component that the log does not hold has a standard deviation of `NO_INFORMATION`.
    """

    name: str
    height_sea: bool = False
    undulation: float | None = None


@dataclass(frozen=True, kw_only=True)
class SolutionSeries(Reference):
    """A solution for comparison. true: a simulator's truth, not an estimate; height_sea: height above mean sea level."""

    name: str
    true: bool = False
    height_sea: bool = False


@dataclass(frozen=True)
class Place:
    """A place that a log states: latitude, longitude (rad), height (m), and the name of the message.

    height_sea: whether the height is above mean sea level.
    """

    name: str
    latitude: float
    longitude: float
    height: float
    height_sea: bool = False


@dataclass(frozen=True, kw_only=True)
class Flight:
    """A log: series, notes for the user, number of rows (messages).

    imus: in any order; of the others the first is preferred, and None stands for one that the log does not have.  others:
    series that cannot be used, each with the reason.  parameters: of the vehicle, by name.  place: where the vehicle is if the
    log has no fixes, or None.  unix: Unix time (s) of one of its moments, None if it states none.  readings: of magnetometer,
    barometer (heights above mean sea level) and two-antenna heading, one series of each at most.
    """

    imus: Sequence[ImuSeries]
    fixes: Sequence[FixSeries | None]
    solutions: Sequence[SolutionSeries | None]
    notes: Sequence[Remark]
    rows: int
    others: Sequence[str] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    place: Place | None = None
    unix: float | None = None
    readings: Sequence[Readings | None] = ()


GAUSS = 1e-4
"""T."""
AZIMUTH_SIGMA = np.radians(2.0)
"""Assumed of a two-antenna heading that states no accuracy, rad: an antenna distance of some decimetres."""


# Steps that readers share.


_MEASURED = {
    "barometer": ("barometer_height",),
    "magnetometer": ("magnetometer_field_b",),
    "heading": ("heading_azimuth", "heading_azimuth_sigma"),
}
"""Rows of instruments that flight logs hold, by id of the instrument."""


def reading(id: str, name: str, time: Array, values: Array) -> Readings | None:
    """The readings that are finite; None if there are none.

    values: (n,) m above mean sea level of a barometer; (n, 3) T in b of a magnetometer; (n, 2) rad of a heading, the azimuth of
    the body's x axis and its standard deviation.
    """
    table = np.asarray(values, dtype=np.float64).reshape(len(time), -1)
    good = np.isfinite(table).all(axis=1)
    return Readings(id, name, np.asarray(time)[good], table[good], _MEASURED[id]) if good.any() else None


Timed = TypeVar("Timed", ImuSeries, FixSeries, SolutionSeries, Readings, GnssFixes)


def rows_of(series: Timed, rows: np.ndarray) -> Timed:
    """The series with only these rows, in this order."""
    length = series.time.size
    picked: dict[str, Any] = {}
    for each in fields(series):
        value = getattr(series, each.name)
        if isinstance(value, np.ndarray) and value.shape[:1] == (length,):
            picked[each.name] = value[rows]
    return replace(series, **picked)


def instance_name(name: str, instance: int | None) -> str:
    """Name of a series: that of its message, with the number of the instance."""
    return name if instance is None else f"{name}[{instance}]"


def three_sigmas(horizontal: Array, vertical: Array) -> Array:
    """Standard deviations (m, 3) from the horizontal and vertical accuracy (m,); NaN unless all are stated (above 0)."""
    stated = (horizontal > 0).all() and (vertical > 0).all()
    sigma = np.stack([horizontal, horizontal, vertical], axis=1)
    return sigma if stated else np.full(sigma.shape, np.nan)


def with_places(turned: SolutionSeries, name: str, at: Array, **rows: Any) -> SolutionSeries:
    """A solution at the times `at` (n,) s of positions and velocities, with the attitude of `turned` interpolated.

    rows: other fields of `SolutionSeries`.  `turned` itself if fewer than two of the times are within its own.
    """
    assert turned.roll is not None and turned.pitch is not None and turned.heading is not None
    inside = (at >= turned.time.min()) & (at <= turned.time.max())
    if np.count_nonzero(inside) < 2:
        return turned
    angles = {
        each: np.interp(at[inside], turned.time, np.unwrap(angle))
        for each, angle in (("roll", turned.roll), ("pitch", turned.pitch), ("heading", turned.heading))
    }
    rows = {key: value[inside] if isinstance(value, np.ndarray) else value for key, value in rows.items()}
    return replace(turned, name=name, time=at[inside], **angles, **rows)


def nearest_rows(times: Array, at: Array) -> np.ndarray:
    """Index of the row nearest to each time; both in the same unit, `times` increasing."""
    right = np.searchsorted(times, at).clip(0, times.size - 1)
    left = (right - 1).clip(0)
    return np.where(np.abs(times[left] - at) <= np.abs(times[right] - at), left, right)
