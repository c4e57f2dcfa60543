"""The tables of a recorded log as CSV files: names of their columns, and the keys of a log's description that name these.

Every value is in SI and in body or navigation axes, as `insenv.logs.RecordedLog` has it, so that reading changes no bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv.logs.formats.contract import Columns
from insenv.logs.recorded import GnssFixes, Readings, RecordedLog, Reference
from insenv.logs.units import Array
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
INSTRUMENTS: dict[str, dict[str, Any]] = {
    "barometer": {**_TIME, "height": "height_m"},
    "magnetometer": {**_TIME, "field": [f"field_{axis}_t" for axis in "xyz"], "field_unit": "T", "axes": "FRD"},
    "odometer": {**_TIME, "speed": "speed_mps", "speed_unit": "m/s"},
    "dvl": {**_TIME, "velocity": [f"velocity_{axis}_mps" for axis in "xyz"], "axes": "FRD"},
    "heading": {**_TIME, "azimuth": "azimuth_rad", "azimuth_sigma": "azimuth_sigma_rad", "azimuth_unit": "rad"},
}
_BASELINE = {"baseline": [f"baseline_{axis}_m" for axis in ("north", "east", "down")]}
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
    baseline = _BASELINE if "heading_baseline_n" in readings.rows else {}
    return {**INSTRUMENTS[readings.id], **baseline, **(_AGE if readings.age is not None else {})}


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
    named = instrument_keys(readings)
    columns = [
        name
        for key, value in named.items()
        if key in ("height", "field", "speed", "velocity", "azimuth", "azimuth_sigma", "baseline")
        for name in ([value] if isinstance(value, str) else value)
    ]
    return {**_stamps(readings), **_vector(columns, readings.values)}


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


def tables(log: RecordedLog) -> dict[str, Columns]:
    """All tables of a log by section: imu, gnss, the instruments, reference; those that it has."""
    columns = {"imu": imu_columns(log)}
    if log.gnss is not None:
        columns["gnss"] = gnss_columns(log.gnss)
    columns |= {each.id: instrument_columns(each) for each in log.instruments}
    if log.reference is not None:
        columns["reference"] = reference_columns(log.reference)
    return columns
