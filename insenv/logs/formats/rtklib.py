"""Solutions of RTKLIB (.pos): positions in degrees, in Earth-centred axes or relative to a base, with quality and accuracies.

A line that begins with % and names the columns precedes the rows: the time is a date or week and time of week, in GPS time, UTC
or JST.  Velocities (option out-outvel) are read where they are.

RTKLIB 2.4.3 manual, appendix B.1; src/solution.c.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timezone

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.formats import log_tables
from insenv.logs.formats.contract import FileColumns, Format
from insenv.logs.units import GPS_EPOCH, LOCAL_AXES, WEEK_S, gps_of_unix, of_ecef, of_local, unix_of_gps

_NO_VELOCITY = declared(
    "velocity-accuracy-zero", "{label}: all standard deviations of the velocity are 0: the velocity is not used"
)
_CLOCKS = ("GPST", "UTC", "JST")
_JST_S = 9 * 3600.0
_PLACES = {"latitude": "geodetic", "x-ecef": "ecef", "e-baseline": "local"}
"""Kind of the positions by the name of their first column."""
_DEGREES, _MINUTES = "(deg)", "(d'\")"
_SIGMAS = {
    "geodetic": ("sdn", "sde", "sdu", "sdne", "sdeu", "sdun"),
    "ecef": ("sdx", "sdy", "sdz", "sdxy", "sdyz", "sdzx"),
    "local": ("sde", "sdn", "sdu", "sden", "sdnu", "sdue"),
}
"""Columns of the standard deviations of three axes, and of the square roots of their covariances with sign."""
_VELOCITIES = {"geodetic": ("vn", "ve", "vu"), "ecef": ("vx", "vy", "vz"), "local": ("ve", "vn", "vu")}
_FURTHER = {"Q": "quality", "ns": "satellites", "age": "age_s", "ratio": "ratio"}
_UNIT = re.compile(r"\([^)]*\)")
_BASE = re.compile(r"^%\s*ref pos\s*:\s*(.+)$", re.MULTILINE)


def read_columns(label: str, raw: bytes, section: str) -> FileColumns:
    """The fixes: the columns of `log_tables.RECEIVER` and tow_s, quality (1 fixed, 2 float, 5 single), satellites, age_s,
    ratio.
    """
    text = raw.decode("utf-8-sig", errors="replace")
    names, angle_unit, clock = _heading(label, text)
    lines, numbers = [], []
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("%"):
            lines.append(line.replace(",", " ").split())
            numbers.append(number)
    if not lines:
        raise InputError(f"{label}: no rows, only a header")
    kind = _PLACES[names[0]]
    width = 2 + len(names) + (4 if angle_unit == _MINUTES else 0)
    wrong = next((row for row, fields in enumerate(lines) if len(fields) != width), None)
    if wrong is not None:
        raise InputError(f"{label}: line {numbers[wrong]} has {len(lines[wrong])} fields, expected {width} by the header")
    unix = _times(label, lines, numbers, clock)
    values = _numbers(label, lines, numbers)
    if angle_unit == _MINUTES:
        angles = [_degrees(values[:, k : k + 3], [fields[2 + k] for fields in lines]) for k in (0, 3)]
        values = np.column_stack([*angles, values[:, 6:]])
    column = dict(zip(names, values.T, strict=True))
    place, C_nc = _places(label, kind, values[:, :3], text)
    variances = C_nc @ _covariances([column[name] for name in _SIGMAS[kind]]) @ np.swapaxes(C_nc, 1, 2)
    velocity, velocity_sigma = None, None
    notes: tuple[Remark, ...] = ()
    if _VELOCITIES[kind][0] in column:
        velocity = np.einsum("kij,kj->ki", C_nc, np.column_stack([column[name] for name in _VELOCITIES[kind]]))
        of_velocity = [column[name.replace("sd", "sdv", 1)] for name in _SIGMAS[kind]]
        velocity_sigma = _sigmas(C_nc @ _covariances(of_velocity) @ np.swapaxes(C_nc, 1, 2))
        if not velocity_sigma.any():
            velocity, notes = None, (_NO_VELOCITY.filled(label=label),)
    columns = log_tables.receiver_columns(
        unix, np.degrees(place[:, :2]), place[:, 2], _sigmas(variances), velocity, velocity_sigma
    )
    columns |= {"tow_s": gps_of_unix(unix) % WEEK_S}
    columns |= {to: column[name] for name, to in _FURTHER.items() if name in column}
    return FileColumns(columns, np.array(numbers), notes)


def _heading(label: str, text: str) -> tuple[list[str], str, str]:
    """The names of the columns without units, the notation of the angles, and the clock."""
    for line in text.splitlines():
        words = line.replace(",", " ").lstrip("% ").split()
        if line.startswith("%") and len(words) > 4 and words[0] in _CLOCKS:
            names = [_UNIT.sub("", word) for word in words[1:]]
            if names[0] not in _PLACES:
                raise InputError(f"{label}: the first column after the time is {words[1]!r}: allowed are {', '.join(_PLACES)}")
            lacking = [name for name in ("Q", *_SIGMAS[_PLACES[names[0]]]) if name not in names]
            if lacking:
                raise InputError(f"{label}: its header lacks the columns {', '.join(lacking)} of a solution of RTKLIB")
            return names, _MINUTES if words[1].endswith(_MINUTES) else _DEGREES, words[0]
    raise InputError(
        f"{label}: no line '% GPST ...' or '% UTC ...' with the names of the columns: allowed are solutions of RTKLIB with "
        "their heading (out-outhead = on)"
    )


def _times(label: str, lines: Sequence[Sequence[str]], numbers: Sequence[int], clock: str) -> Array:
    """Unix times (n,) s."""
    dated = "/" in lines[0][0]
    seconds = np.zeros(len(lines))
    for row, fields in enumerate(lines):
        try:
            if dated:
                date = datetime(*map(int, fields[0].split("/")), tzinfo=timezone.utc)  # type: ignore[misc, arg-type]
                hours, minutes, seconds_of_minute = fields[1].split(":")
                seconds[row] = date.timestamp() + 3600 * int(hours) + 60 * int(minutes) + float(seconds_of_minute)
            else:
                seconds[row] = float(fields[0]) * WEEK_S + float(fields[1]) + GPS_EPOCH
        except (ValueError, TypeError):
            allowed = "2025/07/08 19:34:18.499" if dated else "a week and a time of week"
            raise InputError(
                f"{label}: line {numbers[row]}: time {' '.join(fields[:2])!r}: allowed is {allowed}, as in the first row"
            ) from None
    if clock == "GPST":  # what a calendar without leap seconds shows
        return unix_of_gps(seconds - GPS_EPOCH)
    return seconds - (_JST_S if clock == "JST" else 0.0)


def _numbers(label: str, lines: Sequence[Sequence[str]], numbers: Sequence[int]) -> Array:
    """The values (n, k) after the time."""
    try:
        return np.array([fields[2:] for fields in lines], dtype=np.float64)
    except ValueError:
        for fields, number in zip(lines, numbers, strict=True):
            for field in fields[2:]:
                try:
                    float(field)
                except ValueError:
                    raise InputError(f"{label}: line {number}: {field[:40]!r} is not a number") from None
        raise


def _places(label: str, kind: str, values: Array, text: str) -> tuple[Array, Array]:
    """Latitude, longitude (rad), height (m), (n, 3), and C_nc (n, 3, 3) from the axes of the columns to north, east, down."""
    if kind == "geodetic":
        place = np.column_stack([np.radians(values[:, :2]), values[:, 2]])
        return place, np.broadcast_to(LOCAL_AXES["NEU"], (len(values), 3, 3))
    if kind == "ecef":
        return of_ecef(values)
    place, turned = of_local(values @ LOCAL_AXES["ENU"].T, _base(label, text))
    return place, turned @ LOCAL_AXES["ENU"]


def _base(label: str, text: str) -> tuple[float, float, float]:
    """Latitude, longitude (rad) and height (m) of the base station, as the heading states them."""
    match = _BASE.search(text)
    words = match[1].replace(",", " ").split() if match else []
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) == 7:
        degrees = [_degrees(np.array([numbers[k : k + 3]]), [words[k]])[0] for k in (0, 3)]
        numbers = [*degrees, numbers[6]]
    if len(numbers) != 3:
        raise InputError(
            f"{label}: positions relative to a base without the line '% ref pos : latitude longitude height' of its place"
        )
    return float(np.radians(numbers[0])), float(np.radians(numbers[1])), numbers[2]


def _degrees(parts: Array, written: Sequence[str]) -> Array:
    """Degrees (n,) of degrees, minutes and seconds (n, 3), of which the first carries the sign, as written."""
    sign = np.array([-1.0 if word.startswith("-") else 1.0 for word in written])
    return np.asarray(sign * (np.abs(parts[:, 0]) + parts[:, 1] / 60.0 + parts[:, 2] / 3600.0))


def _covariances(deviations: Sequence[Array]) -> Array:
    """Matrices (n, 3, 3) of the standard deviations of axes 1, 2, 3 and the signed roots of the covariances 12, 23, 31."""
    a, b, c, ab, bc, ca = (np.sign(each) * each * each for each in deviations)
    return np.stack([np.stack(row, axis=-1) for row in ((a, ab, ca), (ab, b, bc), (ca, bc, c))], axis=-2)


def _sigmas(covariances: Array) -> Array:
    return np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))


FORMAT = Format(
    name="rtklib",
    suffixes=(".pos",),
    read_columns=read_columns,
    keys={"gnss": log_tables.RECEIVER, "reference": log_tables.RECEIVER_REFERENCE},
    further_keys={"gnss": (log_tables.GNSS_VELOCITY,), "reference": (log_tables.REFERENCE_VELOCITY,)},
)
