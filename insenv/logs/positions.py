"""Positions in Earth-centred axes, and in local axes with an origin, as latitude, longitude and height."""

from __future__ import annotations

import numpy as np

from insenv import geodesy
from insenv.logs.units import Array

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
