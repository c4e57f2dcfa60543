"""Clocks and axes in which other people's files count: GPS time, Earth-centred axes, local axes with an origin.

GPS time and Unix time (UTC) differ by the leap seconds since 1980.
"""

from __future__ import annotations

import numpy as np

from insenv import geodesy
from insenv.logs.units import Array

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
