"""The tables of a recorded log as CSV files: names of their columns, and the keys of a log's description that name these.

Every value is in SI and in body or navigation axes, as `insenv.logs.RecordedLog` has it, so that reading changes no bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insenv.core.tables import Array, Row
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
"""Names of the components of a vector by frame; x, y, z in others."""
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
        parts = _components(row) if row.size > 1 else [""]
        names = ["_".join(filter(None, (column.key, part, _SUFFIXES.get(row.unit, "")))) for part in parts]
        keys[column.key] = names if row.size > 1 else names[0]
        if column.units and not column.unit_key:
            keys[f"{column.key}_unit"] = next(unit for unit, size in column.units.items() if size == 1.0)
        keys |= {"axes": "FRD"} if column.axes else {}
    return keys | (_AGE if readings.age is not None else {})


def _components(row: Row) -> Sequence[str]:
    """A name of each element of a row: those of the components, numbers where there are more of them."""
    names = _COMPONENTS.get(row.frame, tuple("xyz"))
    return names[: row.size] if row.size <= len(names) else [str(number + 1) for number in range(row.size)]


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
    values = {"time": log.imu_time, "interval": log.dt, "gyro": log.delta_angle, "accel": log.delta_velocity}
    if log.temperature is not None:  # the difference is exact, so that reading gives the same kelvins
        values["temperature"] = log.temperature - ZERO_CELSIUS
    return _named(imu_keys(log), {key: value[sampled] for key, value in values.items()})


def gnss_columns(fixes: GnssFixes) -> Columns:
    """The fixes by arrival, with their age, or by time of validity where there is no arrival."""
    values = {**_stamps(fixes), "latitude": fixes.latitude, "longitude": fixes.longitude, "height": fixes.height}
    values |= {"position_sigma": fixes.position_sigma, "velocity": fixes.velocity_n, "velocity_sigma": fixes.velocity_sigma}
    return _named(gnss_keys(fixes), values)


def instrument_columns(readings: Readings) -> Columns:
    """The measurements by arrival, with their age, or by time of validity where there is no arrival."""
    keys, rows = instrument_keys(readings), readings.columns()
    return _named(keys, {**_stamps(readings), **{column.key: rows[column.row] for column in _measured(readings)}})


def reference_columns(reference: Reference) -> Columns:
    """The reference where all that it has is known."""
    values: dict[str, Any] = {name: getattr(reference, name) for name in ("time", "latitude", "longitude", "height")}
    values |= {"velocity": reference.velocity_n, "roll": reference.roll, "pitch": reference.pitch, "heading": reference.heading}
    columns = _named(reference_keys(reference), values)
    known = np.all([np.isfinite(column) for column in columns.values()], axis=0)
    return {name: column[known] for name, column in columns.items()}


def _stamps(measured: GnssFixes | Readings) -> dict[str, Any]:
    if measured.arrival is None or measured.age is None:
        return {"time": measured.time}
    return {"time": measured.arrival, "age": measured.age}


def _named(keys: Mapping[str, Any], values: Mapping[str, Any]) -> Columns:
    """The columns, in the order of `values`, that a section's keys name: values (n,) or (n, k) by key; others are left out."""
    columns: Columns = {}
    for key, value in values.items():
        if key in keys:
            names = [keys[key]] if isinstance(keys[key], str) else keys[key]
            columns |= zip(names, np.reshape(value, (-1, len(names))).T, strict=True)
    return columns


def receiver_columns(
    time: Array, degrees: Array, height: Array, sigma: Array, velocity: Array | None, velocity_sigma: Array | None
) -> Columns:
    """The columns of `RECEIVER`, and those of `GNSS_VELOCITY` where there is a velocity.

    time (n,) s, Unix; degrees (n, 2): latitude, longitude; height (n,) m above the ellipsoid; the rest (n, 3) north, east,
    down.
    """
    values: dict[str, Any] = {"time": time, "latitude": degrees[:, 0], "longitude": degrees[:, 1], "height": height}
    values["position_sigma"], moving = sigma, velocity is not None and velocity_sigma is not None
    values |= {"velocity": velocity, "velocity_sigma": velocity_sigma} if moving else {}
    return _named({**RECEIVER, **(GNSS_VELOCITY if moving else {})}, values)


def tables(log: RecordedLog) -> dict[str, Columns]:
    """All tables of a log by section: imu, gnss, the instruments, reference; those that it has."""
    columns = {"imu": imu_columns(log)}
    if log.gnss is not None:
        columns["gnss"] = gnss_columns(log.gnss)
    columns |= {each.id: instrument_columns(each) for each in log.instruments}
    if log.reference is not None:
        columns["reference"] = reference_columns(log.reference)
    return columns
