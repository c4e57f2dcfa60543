"""Logs of Google's GnssLogger on Android phones (gnss_log_*.txt): fixes, and the raw inertial and magnetic sensors.

A line that begins with # names the fields of each kind of line, which differ between versions.  Gyro and accelerometer have
samples of their own times; those of the accelerometer are interpolated at the times of the gyro.  The axes of a phone that lies
on its back are right, forward, up.

Fixes are those of the provider GPS.  AccuracyMeters is the radius of 68 % (android.location.Location), 1.51 standard deviations
of each axis.  The height of a phone without vertical accuracy is taken to be twice as wrong.

https://github.com/google/gps-measurement-tools
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.formats import log_tables
from insenv.logs.formats.contract import Columns, FileColumns, Format

_RADIUS_68 = float(np.sqrt(-2.0 * np.log(0.32)))
"""Radius that holds 68 % of a round normal distribution, standard deviations of one axis."""
_VERTICAL = 2.0
"""Assumed standard deviation of the height by that of north and east."""
_NO_VERTICAL = declared(
    "vertical-accuracy-assumed",
    "{label}: {count} fixes state no vertical accuracy: {factor:g} times that of north and east is assumed",
)
_NO_SPEED = declared("speed-accuracy-missing", "{label}: the fixes state no accuracy of their speed, which is not used")
_KINDS = {"imu": ("UncalGyro", "UncalAccel"), "magnetometer": ("UncalMag",), "gnss": ("Fix",), "reference": ("Fix",)}
_GPS = ("gps",)
_NS = 1e-9
_BOOT, _UTC = "elapsedRealtimeNanos", "utcTimeMillis"
_FIX_UTC = ("UnixTimeMillis", "(UTC)TimeInMs")
_OLD_NAMES = {
    "Latitude": "LatitudeDegrees",
    "Longitude": "LongitudeDegrees",
    "Altitude": "AltitudeMeters",
    "Speed": "SpeedMps",
    "Accuracy": "AccuracyMeters",
}
"""Names of version 2 and before."""

TIME = "time_s"
_AXES = "xyz"
_SAMPLES: dict[str, Any] = {
    "time": TIME,
    "gyro": [f"gyro_{axis}_rad_s" for axis in _AXES],
    "accel": [f"accel_{axis}_mps2" for axis in _AXES],
    "kind": "rate",
    "stamp": "instant",
    "gyro_unit": "rad/s",
    "accel_unit": "m/s2",
    "axes": "RFU",
}
_FIELD: dict[str, Any] = {"time": TIME, "field": [f"field_{axis}_ut" for axis in _AXES], "field_unit": "uT", "axes": "RFU"}
_MOTION: dict[str, Any] = {"speed": "speed_mps", "course": "course_deg", "speed_sigma": "speed_sigma_mps"}


def read_columns(label: str, raw: bytes, section: str) -> FileColumns:
    """The columns for a section; times are those since the phone was switched on, or Unix times if the fixes have no others."""
    text = raw.decode("utf-8-sig", errors="replace")
    if section not in _KINDS:
        return FileColumns({})
    lines = _lines(label, text)
    fixes = lines.get("Fix")
    boot = fixes is None or not np.isnan(fixes.get(_BOOT, np.array([np.nan]))).any()
    missing = [kind for kind in _KINDS[section] if kind not in lines]
    if missing:
        raise InputError(
            f"{label}: no lines {', '.join(missing)} for [{section}] (it has {', '.join(lines) or 'none that are read'})"
        )
    if section == "imu":
        return FileColumns(_inertial(lines["UncalGyro"], lines["UncalAccel"], boot))
    if section == "magnetometer":
        sensor = lines["UncalMag"]
        names = [f"UncalMag{axis}MicroT" for axis in "XYZ"]
        return FileColumns(
            {TIME: _time(sensor, boot), **dict(zip(_FIELD["field"], (sensor[name] for name in names), strict=True))}
        )
    return _fixes(label, lines["Fix"], boot)


def _lines(label: str, text: str) -> dict[str, dict[str, Array]]:
    """By kind the fields that are numbers, by name; NaN where they are empty.  Of the fixes those of the provider GPS."""
    fields: dict[str, list[str]] = {}
    rows: dict[str, list[list[str]]] = {}
    wanted = {kind for kinds in _KINDS.values() for kind in kinds}
    for number, line in enumerate(text.splitlines(), 1):
        words = [word.strip() for word in line.lstrip("# ").split(",")]
        if words[0] not in wanted:
            continue
        if line.startswith("#"):
            fields[words[0]] = [_OLD_NAMES.get(word, word) for word in words[1:]]
        elif words[0] not in fields:
            raise InputError(f"{label}: line {number}: {words[0]} before the line '# {words[0]},...' that names its fields")
        elif words[0] != "Fix" or words[1].lower() in _GPS:
            rows.setdefault(words[0], []).append(words[1:])
    if not fields:
        raise InputError(f"{label}: no line '# Fix,...' or '# UncalGyro,...' that names the fields: not a log of GnssLogger")
    return {kind: _columns(label, kind, fields[kind], lines) for kind, lines in rows.items()}


def _columns(label: str, kind: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> dict[str, Array]:
    columns = {}
    for place, name in enumerate(names):
        if name == "Provider":
            continue
        values = np.full(len(rows), np.nan)
        for row, words in enumerate(rows):
            word = words[place] if place < len(words) else ""
            try:
                values[row] = float(word) if word else np.nan
            except ValueError:
                if name in _TEXTS:
                    continue
                raise InputError(f"{label}: {kind} number {row + 1}: {name} is {word[:40]!r}, not a number") from None
        columns[name] = values
    return columns


_TEXTS = ("SolutionType", "MockLocation")
"""Fields that are not numbers in every version."""


def _time(columns: dict[str, Array], boot: bool) -> Array:
    """Times (n,) s: since the phone was switched on, or Unix."""
    if boot:
        return columns[_BOOT] * _NS
    return columns[next(name for name in (_UTC, *_FIX_UTC) if name in columns)] * 1e-3


def _inertial(gyro: dict[str, Array], accel: dict[str, Array], boot: bool) -> Columns:
    """Gyro and accelerometer at the times of the gyro that lie within those of the accelerometer."""
    time, other = _time(gyro, boot), _time(accel, boot)
    time, first = np.unique(time, return_index=True)
    other, of_other = np.unique(other, return_index=True)
    inside = (time >= other[0]) & (time <= other[-1])
    rates = [gyro[f"UncalGyro{axis}RadPerSec"][first][inside] for axis in "XYZ"]
    forces = [np.interp(time[inside], other, accel[f"UncalAccel{axis}Mps2"][of_other]) for axis in "XYZ"]
    return {TIME: time[inside], **dict(zip([*_SAMPLES["gyro"], *_SAMPLES["accel"]], [*rates, *forces], strict=True))}


def _fixes(label: str, fixes: dict[str, Array], boot: bool) -> FileColumns:
    notes: list[Remark] = []
    radius = fixes["AccuracyMeters"] / _RADIUS_68
    vertical = fixes.get("VerticalAccuracyMeters", np.full(len(radius), np.nan))
    unknown = ~(vertical > 0.0)
    if unknown.any():
        notes.append(_NO_VERTICAL.filled(label=label, count=np.count_nonzero(unknown), factor=_VERTICAL))
    sigma = np.column_stack([radius, radius, np.where(unknown, _VERTICAL * radius, vertical)])
    degrees = np.column_stack([fixes["LatitudeDegrees"], fixes["LongitudeDegrees"]])
    columns = log_tables.receiver_columns(_time(fixes, boot), degrees, fixes["AltitudeMeters"], sigma, None, None)
    columns[TIME] = columns.pop(log_tables.UNIX_TIME)
    speed_sigma = fixes.get("SpeedAccuracyMps", np.zeros(len(radius)))
    if (speed_sigma > 0.0).all() and not np.isnan(fixes["SpeedMps"]).any():
        course = fixes.get("BearingDegrees", np.full(len(radius), np.nan))
        shown = (course != 0.0) | (fixes.get("BearingAccuracyDegrees", course) > 0.0)  # 0 stands for a course that is not known
        columns |= {
            "speed_mps": fixes["SpeedMps"],
            "course_deg": np.where(shown, course, np.nan),
            "speed_sigma_mps": speed_sigma,
        }
    else:
        notes.append(_NO_SPEED.filled(label=label))
    return FileColumns(columns, notes=tuple(notes))


_FIXES = {**log_tables.RECEIVER, "time": TIME}
FORMAT = Format(
    name="gnss-logger",
    suffixes=("gnss_log_*.txt",),
    read_columns=read_columns,
    keys={
        "imu": _SAMPLES,
        "gnss": _FIXES,
        "magnetometer": _FIELD,
        "reference": {name: value for name, value in _FIXES.items() if name != "position_sigma"},
    },
    further_keys={"gnss": (_MOTION,)},
)
