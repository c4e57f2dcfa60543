"""The magnetic field of the Earth along a way: the World Magnetic Model at one place and date, and its gradient there.

The model is evaluated in NumPy by a package, once before a run.  Equations use the field at the place and its gradient, which
are plain numbers: the components in the local north, east and down, each linear in the way along the curved Earth.  100 km
from the place the linear field is wrong by about 20 nT, 1000 km from it by about 2 uT.
"""

from __future__ import annotations

from functools import lru_cache
from math import cos, degrees
from typing import Any

import casadi as ca
import numpy as np

from insenv.base.errors import InputError
from insenv.core.elementary import Scalar, sin_cos, wrap_angle
from insenv.core.tables import Array
from insenv.geodesy import radii

_TESLA_PER_NT = 1e-9
FIRST, VALID_FOR = 2010, 5
"""Year of the first coefficients, and years for which each are made."""
_HALF_WAY = 10e3
"""Half of the way over which the gradient is a difference quotient, m."""
_LARGEST_TURN = 0.01
"""Largest change of longitude for it, rad: near a pole 10 km east are several turns."""


def displacement_n(
    latitude: Scalar, longitude: Scalar, height: Scalar, latitude0: Scalar, longitude0: Scalar, height0: Scalar
) -> ca.SX:
    """Way (3x1, m) along the curved Earth from a place (index 0) to another: north, east and down in their local n.

    (R_M + h) d(latitude), (R_N + h) cos(latitude) d(longitude), -d(height).
    """
    s, c = sin_cos(latitude)
    R_M, R_N = radii(s)
    north = (latitude - latitude0) * (R_M + height)
    east = wrap_angle(longitude - longitude0) * (R_N + height) * c
    return ca.vertcat(north, east, height0 - height)


def world_magnetic_model(latitude: float, longitude: float, height: float, year: float) -> tuple[Array, Array]:
    """Field (3, T, n) and gradient (3, 3; T/m) at a place (rad, m above the ellipsoid) and a decimal year.

    Raises `InputError` for a year that none of the package's coefficients are for.
    """
    first, last = world_magnetic_years()
    if not first <= year <= last:
        raise InputError(f"year = {year:g}: allowed is {first:g} to {last:g}, the time of the World Magnetic Model")
    field, gradient = _evaluated(latitude, longitude, height, year)
    return field.copy(), gradient.copy()


@lru_cache(maxsize=64)
def _evaluated(latitude: float, longitude: float, height: float, year: float) -> tuple[Array, Array]:
    """Kept: the package takes milliseconds, and the plants of a scenario are at one place."""
    model = _model(int(min(year, world_magnetic_years()[1] - 1.0) // VALID_FOR) * VALID_FOR)
    north, east = _HALF_WAY / 6.37e6, min(_HALF_WAY / (6.37e6 * cos(latitude)), _LARGEST_TURN)
    s = np.sin(latitude)
    R_M, R_N = (float(radius) for radius in radii(s))
    steps = (
        ((north, 0.0, 0.0), north * (R_M + height)),
        ((0.0, east, 0.0), east * (R_N + height) * cos(latitude)),
        ((0.0, 0.0, -_HALF_WAY), _HALF_WAY),
    )
    columns = []
    for (dlat, dlon, dh), way in steps:
        ahead = _field(model, latitude + dlat, longitude + dlon, height + dh, year)
        behind = _field(model, latitude - dlat, longitude - dlon, height - dh, year)
        columns.append((ahead - behind) / (2.0 * way))
    return _field(model, latitude, longitude, height, year), np.stack(columns, axis=1)


def world_magnetic_years() -> tuple[float, float]:
    """The decimal years of the package's coefficients, from the first to the newest."""
    return float(FIRST), float(_model().life_span[1])


def _field(model: Any, latitude: float, longitude: float, height: float, year: float) -> Array:
    if abs(latitude) > np.pi / 2:  # beyond the pole: there north and east point back
        field = _field(model, np.copysign(np.pi, latitude) - latitude, longitude + np.pi, height, year)
        return field * np.array([-1.0, -1.0, 1.0])
    east = (degrees(longitude) + 180.0) % 360.0 - 180.0
    field = model.calculate(degrees(latitude), east, height / 1e3, year, allow_date_outside_lifespan=True)
    return np.array([field.x, field.y, field.z]) * _TESLA_PER_NT


@lru_cache(maxsize=8)
def _model(epoch: int | None = None) -> Any:
    """The World Magnetic Model of an epoch, a year; None: of the newest coefficients."""
    from pygeomag import GeoMag

    return GeoMag() if epoch is None else GeoMag(base_year=epoch)
