"""What a reader finds in a flight log: series of inertial units, receivers and solutions, each with its name in that log.

Times are in seconds on one clock of the log. Everything else is in SI, radians, body FRD, NED.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, TypeVar

import numpy as np

from insenv.core.tables import Table
from insenv.estimators import ImuDataSheet, Knowledge, registered
from insenv.logs.recorded import GnssFixes, Readings, Reference
from insenv.logs.units import Array
from insenv.sensors.grades import elements
from insenv.sensors.imu_tables import IMU_PARAMETERS
from insenv.sensors.units import SHOWN

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


AnySeries = TypeVar("AnySeries", ImuSeries, FixSeries, SolutionSeries, Readings)


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


@dataclass(frozen=True)
class Flight:
    """A log: series in the order of preference, notes for the user, number of rows (messages).

    others: series in the log that cannot be used, each with the reason.  parameters: of the vehicle, by name.  place: where
    the vehicle is if the log has no fixes, or None.  readings: of magnetometer, barometer (heights above mean sea level) and
    two-antenna heading, one series of each at most.
    """

    imus: tuple[ImuSeries, ...]
    fixes: tuple[FixSeries, ...]
    solutions: tuple[SolutionSeries, ...]
    notes: tuple[str, ...]
    rows: int
    others: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    place: Place | None = None
    readings: tuple[Readings, ...] = ()


@dataclass(frozen=True)
class FlightFormat:
    """A format of flight logs.

    suffix: end of the file name; kind: what to call such a log; hint: how to get inertial samples at a usable rate; read: from
    (name for messages, bytes) to the series, raises InputError.
    """

    suffix: str
    kind: str
    hint: str
    read: Callable[[str, bytes], Flight]


GAUSS = 1e-4
"""T."""
AZIMUTH_SIGMA = np.radians(2.0)
"""Assumed of a two-antenna heading that states no accuracy, rad: an antenna distance of some decimetres."""


# --- steps that readers share ------------------------------------------------------------------------


def reading(id: str, name: str, time: Array, values: Array) -> Readings | None:
    """The readings that are finite; None if there are none.

    values: (n,) m above mean sea level of a barometer; (n, 3) T in b of a magnetometer; (n, 2) rad of a heading, the azimuth of
    the body's x axis and its standard deviation.
    """
    rows = {
        "barometer": ("barometer_height",),
        "magnetometer": ("magnetometer_field_b",),
        "heading": ("heading_azimuth", "heading_azimuth_sigma"),
    }
    table = np.asarray(values, dtype=np.float64).reshape(len(time), -1)
    good = np.isfinite(table).all(axis=1)
    return Readings(id, name, np.asarray(time)[good], table[good], rows[id]) if good.any() else None


def instance_name(name: str, instance: int | None) -> str:
    """Name of a series: that of its message, with the number of the instance."""
    return name if instance is None else f"{name}[{instance}]"


def three_sigmas(horizontal: Array, vertical: Array) -> Array:
    """Standard deviations (m, 3) from the horizontal and vertical accuracy (m,); NaN unless all are stated (above 0)."""
    stated = (horizontal > 0).all() and (vertical > 0).all()
    sigma = np.stack([horizontal, horizontal, vertical], axis=1)
    return sigma if stated else np.full(sigma.shape, np.nan)


def interpolated_angles(at: Array, time: Array, angles: Sequence[Array]) -> tuple[Array, Array, Array]:
    """Roll, pitch and heading (rad) at the times `at`, interpolated between those at `time`."""
    roll, pitch, heading = (np.interp(at, time, np.unwrap(angle)) for angle in angles)
    return roll, pitch, heading


def nearest_rows(times: Array, at: Array) -> np.ndarray:
    """Index of the row nearest to each time; both in the same unit, `times` increasing."""
    right = np.searchsorted(times, at).clip(0, times.size - 1)
    left = (right - 1).clip(0)
    return np.where(np.abs(times[left] - at) <= np.abs(times[right] - at), left, right)


# Parameters that a vehicle's log holds (PARAM_VALUE, PARM, initial_parameters): what they say of its sensors.
#
# The lever arm of the antenna by the names of ArduPilot, PX4 and insenv. A log of insenv also has the data sheet of its
# inertial unit (``S_...``) and the settings of its estimator (``E_...``).

_ARMS = (
    ("S_ANT_LEV_ARM_", ""),
    ("GPS1_POS_", "INS_POS1_"),
    ("GPS_POS1_", "INS_POS1_"),
    ("EKF2_GPS_POS_", "EKF2_IMU_POS_"),
)
"""Names, without X, Y and Z, of the positions of antenna and inertial unit (m, FRD) from one point of the vehicle."""


ALIKE = 0.8
"""Share of the parameters of an estimator and of a log that must be the same."""


def lever_arm(values: Mapping[str, float]) -> tuple[Array, str] | None:
    """Lever arm (3,) m, FRD, from the inertial unit to the antenna, and the names of its parameters; None if there is none.

    Zeros count as not set: autopilots have them until somebody measures.
    """
    for antenna, unit in _ARMS:
        if not all(f"{antenna}{axis}" in values for axis in "XYZ"):
            continue
        arm = np.array([values[f"{antenna}{axis}"] - (values.get(f"{unit}{axis}", 0.0) if unit else 0.0) for axis in "XYZ"])
        if np.isfinite(arm).all() and arm.any():
            return arm, f"{antenna}X, Y, Z" + (f" less {unit}X, Y, Z" if unit and f"{unit}X" in values else "")
    return None


def unit_rows(values: Mapping[str, float]) -> dict[str, Any] | None:
    """Parameter rows (SI) of insenv's inertial unit; None if the log is not insenv's, or its unit was not stated."""
    rows = _rows("S", IMU_PARAMETERS, values)
    return rows if set(rows) == {row.name for row, _, _ in elements("S", IMU_PARAMETERS, IMU_PARAMETERS.names)} else None


NOT_IN_A_LOG = frozenset({"rotation_error", "thrust_error", "fix_wander_sigma", "fix_wander_time"})
"""What a scenario knows of its sensors and a replay cannot find."""


def settings(values: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """Parameter rows (SI) by the id of each estimator whose parameters are those in the log, but for a few of another version.

    Left out: what a start knows, and the data sheet, both of which a replay finds anew.
    """
    known = {each.name for kind in (Knowledge, ImuDataSheet) for each in fields(kind)} - NOT_IN_A_LOG
    told = {name for name in values if name.startswith("E_")}
    found = {}
    for id, estimator in registered().items() if told else ():
        table = estimator.model.parameters
        own = {name for _, _, name in elements("E", table, table.names)}
        if len(own & told) < ALIKE * len(own | told):
            continue
        rows = _rows("E", table, values)
        found[id] = {name: row for name, row in rows.items() if name not in known and not name.startswith("start_")}
    return found


def _rows(prefix: str, table: Table, values: Mapping[str, float]) -> dict[str, Any]:
    """Those rows of a table of which the log has all elements, by their short names."""
    rows: dict[str, Any] = {}
    lacking = set()
    for row, place, name in elements(prefix, table, table.names):
        if name not in values or not np.isfinite(values[name]):
            lacking.add(row.name)
            continue
        _, to_si = SHOWN.get(row.unit, (row.unit, float))
        number = min(max(float(to_si(values[name])), row.lower), row.upper)
        flat = rows.setdefault(row.name, np.zeros(row.size))
        flat[place - table.slice(row.name).start] = number
    return {name: flat if table[name].shape else float(flat[0]) for name, flat in rows.items() if name not in lacking}


# Time in a flight log: restarts of the clock, gaps, samples twice or out of order.

RESTART_S = 1.0
"""A clock that goes back by more has restarted; by less, samples are out of order."""


def restarts(time: Array) -> np.ndarray:
    """Number of restarts of the clock before each row: (n,) integers."""
    return np.concatenate([[0], np.cumsum(np.diff(time) < -RESTART_S)]).astype(np.int64)


def rows_of(series: AnySeries, rows: np.ndarray) -> AnySeries:
    """The series with only these rows, in this order."""
    length = series.time.size
    picked: dict[str, Any] = {}
    for each in fields(series):
        value = getattr(series, each.name)
        if isinstance(value, np.ndarray) and value.shape[:1] == (length,):
            picked[each.name] = value[rows]
    return replace(series, **picked)


def ordered(series: AnySeries) -> tuple[AnySeries, int]:
    """The series in order of time, each time once; number of rows removed or moved."""
    steps = np.diff(series.time)
    wrong = int(np.count_nonzero(steps <= 0.0))
    if not wrong:
        return series, 0
    _, first = np.unique(series.time, return_index=True)
    return rows_of(series, first), wrong


def longest(imu: ImuSeries, inside: np.ndarray, max_gap_s: float, notes: list[str]) -> tuple[ImuSeries, int]:
    """The samples `inside` of the longest segment without a restart or a gap longer than `max_gap_s`, in order of time.

    Returns them and the number of restarts before them. Appends to `notes`.
    """
    part = restarts(imu.time)
    nominal = 1.0 / imu.rate_hz
    best: tuple[float, ImuSeries, int] | None = None
    count, moved = 0, 0
    for number in np.unique(part[inside]):
        piece, wrong = ordered(rows_of(imu, np.flatnonzero(inside & (part == number))))
        moved += wrong
        edges = np.flatnonzero(np.diff(piece.time) > max_gap_s + nominal)
        for begin, end in zip([0, *(edges + 1)], [*(edges + 1), piece.time.size], strict=True):
            count += 1
            duration = float(piece.time[end - 1] - piece.time[begin])
            if best is None or duration > best[0]:
                best = duration, rows_of(piece, np.arange(begin, end)), int(number)
    assert best is not None  # `inside` is not empty
    _, chosen, number = best
    if moved:
        notes.append(f"{moved} samples twice or out of order: sorted, each time once")
    if count > 1:
        notes.append(
            f"{count} segments between restarts and gaps longer than {max_gap_s:g} s: the longest is used,"
            f" {chosen.time[0]:.3f} to {chosen.time[-1]:.3f} s (start_s and stop_s select another one)"
        )
    return chosen, number


def only(series: AnySeries, part: int, what: str, notes: list[str]) -> AnySeries | None:
    """The rows after `part` restarts, in order; None, with a note, if the series has fewer restarts."""
    of = restarts(series.time)
    if part > of[-1]:
        notes.append(f"{what}: {series.name} lacks a restart of the clock that the inertial unit has: not used")
        return None
    return ordered(rows_of(series, np.flatnonzero(of == part)))[0]
