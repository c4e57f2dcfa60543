"""The rows of a place: latitude, longitude and ellipsoidal height, in every table that has one."""

from __future__ import annotations

from dataclasses import replace
from math import pi

from insenv.core.tables import Row

_BOUNDS = ((-pi / 2, pi / 2), (-2 * pi, 2 * pi), (-12e3, 1e6))
"""Of latitude (rad), longitude (rad) and height (m), where a user gives them."""


def place_rows(prefix: str = "", of: str = "") -> tuple[Row, Row, Row]:
    """Rows ``PREFIXlatitude``, ``PREFIXlongitude`` (rad) and ``PREFIXheight`` (m) without bounds; `of` ends the meanings."""
    return (
        Row(f"{prefix}latitude", f"Geodetic latitude{of}", "rad"),
        Row(f"{prefix}longitude", f"Longitude{of}", "rad"),
        Row(f"{prefix}height", f"Height above the WGS-84 ellipsoid{of}", "m"),
    )


def bounded_place_rows(prefix: str = "", of: str = "") -> tuple[Row, Row, Row]:
    """`place_rows` with the bounds of places that a user may give."""
    latitude, longitude, height = (
        replace(row, lower=lower, upper=upper) for row, (lower, upper) in zip(place_rows(prefix, of), _BOUNDS, strict=True)
    )
    return latitude, longitude, height
