"""Units, sensor axes, angles, clocks and origins of recorded logs: what a description may state, and its meaning in SI, body
FRD and geodetic coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors import units
from insenv.sensors.units import SPEED_UNITS as SPEED_UNITS

ANGLE_UNITS: dict[str, float] = {**units.ANGLE_UNITS, "1e-7 deg": 1e-7 * units.ANGLE_UNITS["deg"]}
"""unit -> radians; 1e-7 deg: of latitudes and longitudes that receivers give as whole numbers."""

GYRO_UNITS: dict[str, dict[str, float]] = {
    "rate": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180.0,
        "rad/h": 1.0 / 3600.0,
        "deg/h": math.pi / 180.0 / 3600.0,
    },
    "increment": {"rad": 1.0, "deg": math.pi / 180.0},
}
"""kind -> unit -> factor to rad/s (rates) or rad (increments)."""

ACCEL_UNITS: dict[str, dict[str, float]] = {
    "rate": {"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY * 1e-3},
    "increment": {"m/s": 1.0},
}
"""kind -> unit -> factor to m/s2 (rates) or m/s (increments)."""

TIME_UNITS: dict[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
"""unit -> seconds."""


def standard_height(pressure_pa: Array) -> Array:
    """Height (m) at which the ICAO standard atmosphere has a pressure (Pa), in the troposphere; NaN for what no air has.

    ICAO Doc 7488: p = p0 (T / T0)^5.25588 with T = T0 - 6.5 K/km H, H geopotential, and h = H r / (r - H).
    """
    ratio = np.where(pressure_pa > 0.0, pressure_pa, np.nan) / 101325.0
    geopotential = 288.15 / 0.0065 * (1.0 - ratio ** (1.0 / 5.255880))
    return np.asarray(geopotential * 6356766.0 / (6356766.0 - geopotential))


_LETTERS = {"F": (0, 1), "B": (0, -1), "R": (1, 1), "L": (1, -1), "D": (2, 1), "U": (2, -1)}


def axes_matrix(axes: str | Sequence[Sequence[float]], *, reflection_allowed: bool = False) -> Array:
    """The matrix C_bs (3, 3) from sensor to body components: v_b = C_bs v_s, b = FRD.

    Three notations, here for a sensor whose x axis points forward, y left and z up:

    - ``"FLU"``: where the sensor's x, y and z axes point (Forward/Back, Right/Left, Down/Up);
    - ``"+x-y-z"``: body forward, right and down in terms of the sensor's axes;
    - ``[[1, 0, 0], [0, -1, 0], [0, 0, -1]]``: C_bs itself, any rotation (a mounting matrix).

    Raises ValueError if it is none of these, not orthonormal (1e-3), or left-handed where that is not allowed.
    """
    matrix = _from_string(axes) if isinstance(axes, str) else _from_rows(axes)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-3):
        raise ValueError("the axes must be orthonormal (each body axis from one sensor axis, no scale): C C^T = I within 1e-3")
    if np.linalg.det(matrix) < 0 and not reflection_allowed:
        raise ValueError("the axes are left-handed (determinant -1): check the signs; a right-handed sensor has +1")
    return matrix


def _from_string(axes: str) -> Array:
    text = axes.strip()
    matrix = np.zeros((3, 3))
    if len(text) == 3 and all(letter in _LETTERS for letter in text.upper()):
        for sensor_axis, letter in enumerate(text.upper()):
            body_axis, sign = _LETTERS[letter]
            matrix[body_axis, sensor_axis] = float(sign)
        return matrix
    signed = text.lower()
    if len(signed) == 6 and all(signed[i] in "+-" and signed[i + 1] in "xyz" for i in (0, 2, 4)):
        for row in range(3):
            matrix[row, "xyz".index(signed[2 * row + 1])] = 1.0 if signed[2 * row] == "+" else -1.0
        return matrix
    raise ValueError(
        'must be three letters of F/B, R/L, D/U ("FRD", "FLU", "RFU": where the sensor\'s x, y, z point), '
        'a signed permutation ("+x-y-z": body forward, right, down in sensor axes) or a 3x3 matrix C_bs'
    )


def _from_rows(rows: Sequence[Sequence[float]]) -> Array:
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ValueError("a mounting matrix must have three rows of three finite numbers")
    return matrix


def wrap(angle: Array) -> Array:
    """Angles [rad] wrapped into [-pi, pi); any shape.  Angles within are returned to the bit."""
    inside = (angle >= -math.pi) & (angle < math.pi)
    return np.where(inside, angle, (angle + math.pi) % (2.0 * math.pi) - math.pi)


# Clocks and axes in which other people's files count: GPS time, Earth-centred axes, local axes with an origin.
#
# GPS time and Unix time (UTC) differ by the leap seconds since 1980.


WEEK_S = 604800.0
GPS_EPOCH = 315964800.0
"""Unix time (s) of 1980-01-06 00:00:00 UTC, where GPS time begins."""
LEAP_DATES = np.array(
    [
        "1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
        "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01",
        "2015-07-01", "2017-01-01",
    ],
    dtype="datetime64[s]",
).astype(np.float64)  # fmt: skip
"""Unix times (s) from which on GPS time is ahead of UTC by one second more.

IERS Bulletin C 72 (2026): none is announced after 2017.
"""
_GPS_DATES = LEAP_DATES - GPS_EPOCH + np.arange(1, len(LEAP_DATES) + 1)
"""The same in seconds of GPS time."""


def year_of_unix(unix: float) -> float:
    """The decimal year of a Unix time (s), good to a day."""
    return 1970.0 + unix / 31556952.0


def gps_of_unix(unix: Array) -> Array:
    """Seconds of GPS time since its beginning, (n,), of Unix times (n,) s."""
    return np.asarray(unix - GPS_EPOCH + np.searchsorted(LEAP_DATES, unix, side="right"))


def unix_of_gps(gps: Array) -> Array:
    """Unix times (n,) s of seconds of GPS time (n,) since its beginning."""
    return np.asarray(gps + GPS_EPOCH - np.searchsorted(_GPS_DATES, gps, side="right"))


# Positions.

LOCAL_AXES = {
    "NED": np.eye(3),
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NEU": np.diag([1.0, 1.0, -1.0]),
    "NWU": np.diag([1.0, -1.0, -1.0]),
}
"""Where local axes x, y, z point: the matrices (3, 3) from their components to north, east, down."""


def of_ecef(r_e: Array) -> tuple[Array, Array]:
    """Latitude, longitude (rad) and height (m), (n, 3), of positions (n, 3) m in e, and C_ne (n, 3, 3) there."""
    place = np.column_stack(geodesy.numeric.ecef_to_geodetic(r_e))
    return place, np.swapaxes(geodesy.numeric.C_en(place[:, 0], place[:, 1]), 1, 2)


def of_local(offset: Array, origin: tuple[float, float, float]) -> tuple[Array, Array]:
    """Latitude, longitude (rad) and height (m), (n, 3), of positions (n, 3) m: north, east and down of an origin (rad, rad, m).

    Also the matrices (n, 3, 3) from these axes to the north, east and down of each position: 0.16 mrad apart at 1 km.
    """
    place = np.column_stack(geodesy.numeric.geodetic_from_ned_offset(offset, *origin))
    C_en = geodesy.numeric.C_en(place[:, 0], place[:, 1])
    return place, np.swapaxes(C_en, 1, 2) @ geodesy.numeric.C_en(*origin[:2])
