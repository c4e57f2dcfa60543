"""The section [gravity] of a scenario: the difference between true gravity and the normal gravity of the estimators."""

from __future__ import annotations

from math import radians, sin
from typing import Any

import numpy as np

from insenv.base.toml import Number, Section, key
from insenv.geodesy import numeric
from insenv.sensors import units
from insenv.vehicles import StartSection


class GravitySection(Section):
    """True gravity minus normal gravity, constant along the trajectory; no estimator knows it."""

    deflection_north_arcsec: Number = key(
        0.0,
        "deflection of the vertical: true zenith north of that of normal gravity",
        "arcsec",
        ge=-300,
        le=300,
    )
    deflection_east_arcsec: Number = key(0.0, "deflection of the vertical: the same to the east", "arcsec", ge=-300, le=300)
    disturbance_mgal: Number = key(0.0, "gravity disturbance: true minus normal gravity, downward", "mGal", ge=-1000, le=1000)

    def rows(self, start: StartSection) -> dict[str, Any]:
        """The row `gravity_disturbance_n` of the truth (m/s^2, NED): (-g xi, -g eta, dg) for deflections xi, eta.

        Heiskanen and Moritz 1967, section 2-19; g is normal gravity at the start.
        """
        g = float(numeric.normal_gravity(sin(radians(start.latitude_deg)), start.height_m))
        north, east = (-g * units.arcsec_to_rad(each) for each in (self.deflection_north_arcsec, self.deflection_east_arcsec))
        return {"gravity_disturbance_n": np.array([north, east, units.mgal_to_m_s2(self.disturbance_mgal)])}
