"""The tables of a recorded log as CSV files: names of their columns, and the keys of a log's description that name these.

Every value is in SI and in body or navigation axes, as `insenv.logs.RecordedLog` has it, so that reading changes no bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv.core.tables import Array
from insenv.logs.formats.contract import Columns
from insenv.logs.recorded import GnssFixes, Readings, RecordedLog, Reference
from insenv.sensors import registry
from insenv.sensors.instrument import Column
from insenv.sensors.units import ZERO_CELSIUS

_TIME: dict[str, Any] = {"time": "time_s"}
_AGE = {"age": "age_s"}
_PLACE: dict[str, Any] = {
    "latitude": "latitude_rad",
    "longitude": "longitude_rad",
    "height": "height_m",
    "position_unit": "rad",
}
_NED_VELOCITY = [f"velocity_{axis}_mps" for axis in ("north", "east", "down")]
IMU: dict[str, Any] = {
    **_TIME,
    "interval": "interval_s",
    "gyro": [f"delta_angle_{axis}_rad" for axis in "xyz"],
    "accel": [f"delta_velocity_{axis}_mps" for axis in "xyz"],
    "kind": "increment",
    "stamp": "interval_end",
    "gyro_unit": "rad",
    "accel_unit": "m/s",
    "axes": "FRD",
}
_TEMPERATURE = {"temperature": "temperature_degc"}
GNSS: dict[str, Any] = {
    **_TIME,
    **_PLACE,
    "position_sigma": [f"position_sigma_{axis}_m" for axis in ("north", "east", "down")],
}
GNSS_VELOCITY: dict[str, Any] = {
    "velocity": _NED_VELOCITY,
    "velocity_sigma": [f"velocity_sigma_{axis}_mps" for axis in ("north", "east", "down")],
}
UNIX_TIME = "unix_s"
"""Name of a column of Unix time (UTC), s."""
RECEIVER: dict[str, Any] = {
    **GNSS,
    "time": UNIX_TIME,
    "latitude": "latitude_deg",
    "longitude": "longitude_deg",
    "position_unit": "deg",
}
"""The keys of [gnss] for the columns of a receiver's own files; those of its velocity are `GNSS_VELOCITY`."""
RECEIVER_REFERENCE = {name: value for name, value in RECEIVER.items() if name != "position_sigma"}
"""The same of [reference], with the velocity of `REFERENCE_VELOCITY`."""
REFERENCE_VELOCITY = {"velocity": _NED_VELOCITY}
_SUFFIXES = {"m": "m", "m/s": "mps", "rad": "rad", "T": "t"}
"""Ends of the names of columns, by SI unit; one without a unit has none."""
_COMPONENTS = {"n": ("north", "east", "down")}
"""Names of the components by frame; x, y, z in others."""
_ATTITUDE: dict[str, Any] = {"roll": "roll_rad", "pitch": "pitch_rad", "heading": "heading_rad", "attitude_unit": "rad"}


def imu_keys(log: RecordedLog) -> dict[str, Any]:
    """The keys of [imu] for the columns of `imu_columns`."""
    return {**IMU, **(_TEMPERATURE if log.temperature is not None else {})}


def gnss_keys(fixes: GnssFixes) -> dict[str, Any]:
    """The keys of [gnss] for the columns of `gnss_columns`."""
    moving = fixes.velocity_n is not None and fixes.velocity_sigma is not None
    return {**GNSS, **(GNSS_VELOCITY if moving else {}), **(_AGE if fixes.age is not None else {})}


def instrument_keys(readings: Readings) -> dict[str, Any]:
    """The keys of an instrument's section for the columns of `instrument_columns`."""
    instrument = registry.instruments()[readings.id]
    keys = dict(_TIME)
    for column in _measured(readings):
        row = instrument.measurement[column.row]
        ends = [column.key, *(f"{column.key}_{part}" for part in _COMPONENTS.get(row.frame, "xyz"))]
        names = ["_".join(filter(None, (end, _SUFFIXES.get(row.unit, "")))) for end in ends]
        keys[column.key] = names[1:] if row.size == 3 else names[0]
        if column.units and not column.unit_key:
            keys[f"{column.key}_unit"] = next(unit for unit, size in column.units.items() if size == 1.0)
        keys |= {"axes": "FRD"} if column.axes else {}
    return keys | (_AGE if readings.age is not None else {})


def _measured(readings: Readings) -> list[Column]:
    return [column for column in registry.instruments()[readings.id].columns if column.row in readings.rows]


def reference_keys(reference: Reference) -> dict[str, Any]:
    """The keys of [reference] for the columns of `reference_columns`."""
    keys = dict(_TIME)
    keys |= _PLACE if reference.latitude is not None else {}
    keys |= {"velocity": _NED_VELOCITY} if reference.velocity_n is not None else {}
    return keys | (_ATTITUDE if reference.roll is not None else {})


def imu_columns(log: RecordedLog) -> Columns:
    """The samples that the log has: those that were interpolated are left out."""
    sampled = ~log.bridged
    columns = {
        "time_s": log.imu_time[sampled],
        "interval_s": log.dt[sampled],
        **_vector(IMU["gyro"], log.delta_angle[sampled]),
        **_vector(IMU["accel"], log.delta_velocity[sampled]),
    }
    if log.temperature is not None:  # the difference is exact, so that reading gives the same kelvins
        columns["temperature_degc"] = log.temperature[sampled] - ZERO_CELSIUS
    return columns


def gnss_columns(fixes: GnssFixes) -> Columns:
    """The fixes by arrival, with their age, or by time of validity where there is no arrival."""
    columns = {**_stamps(fixes), "latitude_rad": fixes.latitude, "longitude_rad": fixes.longitude, "height_m": fixes.height}
    columns |= _vector(GNSS["position_sigma"], fixes.position_sigma)
    if fixes.velocity_n is not None and fixes.velocity_sigma is not None:
        columns |= _vector(GNSS_VELOCITY["velocity"], fixes.velocity_n)
        columns |= _vector(GNSS_VELOCITY["velocity_sigma"], fixes.velocity_sigma)
    return columns


def instrument_columns(readings: Readings) -> Columns:
    """The measurements by arrival, with their age, or by time of validity where there is no arrival."""
    keys = instrument_keys(readings)
    named = [keys[column.key] for column in _measured(readings)]
    names = [name for value in named for name in ([value] if isinstance(value, str) else value)]
    return {**_stamps(readings), **_vector(names, readings.values)}


def reference_columns(reference: Reference) -> Columns:
    """The reference where all that it has is known."""
    columns: Columns = {"time_s": reference.time}
    if reference.latitude is not None and reference.longitude is not None and reference.height is not None:
        columns |= {"latitude_rad": reference.latitude, "longitude_rad": reference.longitude, "height_m": reference.height}
    if reference.velocity_n is not None:
        columns |= _vector(_NED_VELOCITY, reference.velocity_n)
    if reference.roll is not None and reference.pitch is not None and reference.heading is not None:
        columns |= {"roll_rad": reference.roll, "pitch_rad": reference.pitch, "heading_rad": reference.heading}
    known = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    return {name: column[known] for name, column in columns.items()}


def _stamps(measured: GnssFixes | Readings) -> Columns:
    if measured.arrival is None or measured.age is None:
        return {"time_s": measured.time}
    return {"time_s": measured.arrival, "age_s": measured.age}


def _vector(names: list[str], values: Array) -> Columns:
    return dict(zip(names, values.T, strict=True))


def receiver_columns(
    time: Array, degrees: Array, height: Array, sigma: Array, velocity: Array | None, velocity_sigma: Array | None
) -> Columns:
    """The columns of `RECEIVER`, and those of `GNSS_VELOCITY` where there is a velocity.

    time (n,) s, Unix; degrees (n, 2): latitude, longitude; height (n,) m above the ellipsoid; the rest (n, 3) north, east,
    down.
    """
    columns = {UNIX_TIME: time, "latitude_deg": degrees[:, 0], "longitude_deg": degrees[:, 1], "height_m": height}
    columns |= _vector(GNSS["position_sigma"], sigma)
    if velocity is not None and velocity_sigma is not None:
        columns |= _vector(GNSS_VELOCITY["velocity"], velocity) | _vector(GNSS_VELOCITY["velocity_sigma"], velocity_sigma)
    return columns


def tables(log: RecordedLog) -> dict[str, Columns]:
    """All tables of a log by section: imu, gnss, the instruments, reference; those that it has."""
    columns = {"imu": imu_columns(log)}
    if log.gnss is not None:
        columns["gnss"] = gnss_columns(log.gnss)
    columns |= {each.id: instrument_columns(each) for each in log.instruments}
    if log.reference is not None:
        columns["reference"] = reference_columns(log.reference)
    return columns
