"""Conversion of data-sheet units (deg/h, ug/sqrt(Hz), ...) to SI, and of the two notations of white noise.

Conversions of a number or an array are named ``<data-sheet unit>_to_<SI unit>``; `insenv.base.units` declares them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.units import CONVERTED, DEGREE, Conversion, converted
from insenv.base.units import HOUR as HOUR

ZERO_CELSIUS = CONVERTED["deg C"].convert.scale
"""K."""


ANGLE_UNITS = {"deg": DEGREE, "rad": 1.0}
"""unit -> radians."""
SPEED_UNITS = {"m/s": 1.0, **{unit: CONVERTED[unit].convert.scale for unit in ("km/h", "kn")}}
"""unit -> m/s."""

arcsec_to_rad = CONVERTED["arcsec"].convert
deg_h_to_rad_s = CONVERTED["deg/h"].convert
rad_s_to_deg_h = deg_h_to_rad_s.back
deg_sqrt_h_to_rad_sqrt_s = CONVERTED["deg/sqrt(h)"].convert  # angle random walk
ug_to_m_s2 = CONVERTED["ug"].convert
m_s2_to_ug = ug_to_m_s2.back
mgal_to_m_s2 = CONVERTED["mGal"].convert
ppm_to_one = CONVERTED["ppm"].convert
nt_to_t = CONVERTED["nT"].convert
deg_c_to_k = CONVERTED["deg C"].convert


@dataclass(frozen=True)
class Unit:
    """A unit of data sheets.

    name: of the unit.  largest: value that an error in this unit does not exceed: in proportion to a quantity that quantity;
        per kelvin or g ten times that of the poorest units.  ending: of the keys of an estimator's section that are given in
        it; None: there are none.  shown: whether MAVLink's parameters are in it.
    """

    name: str
    largest: float = 1e9
    ending: str | None = None
    shown: bool = False

    @property
    def convert(self) -> Conversion:
        """The conversion to SI."""
        return converted(self.name).convert

    @property
    def si(self) -> str:
        """The unit of the rows that it is converted to."""
        return converted(self.name).si


UNITS = {
    unit.name: unit
    for unit in (
        Unit("deg", 180.0, "deg", shown=True),
        Unit("arcsec"),
        Unit("urad"),
        Unit("deg/h", ending="deg_h", shown=True),
        Unit("deg/s"),
        Unit("deg/sqrt(h)", ending="deg_sqrt_h", shown=True),
        Unit("deg/h/sqrt(h)"),
        Unit("deg/h/g", 1e6),
        Unit("deg/h/K", 1e4),
        Unit("ug", ending="ug", shown=True),
        Unit("mGal", ending="mgal"),
        Unit("g"),
        Unit("ug/sqrt(Hz)", ending="ug_sqrt_hz", shown=True),
        Unit("m/s/sqrt(h)", ending="mps_sqrt_h"),
        Unit("ug/sqrt(h)"),
        Unit("ug/K", 1e5),
        Unit("ppm", 1e6),
        Unit("ppm/K", 1e3),
        Unit("%", 100.0),
        Unit("% per m/s^2", 100.0),
        Unit("nT"),
        Unit("m", ending="m"),
        Unit("s", ending="s"),
        Unit("m/s", ending="mps"),
        Unit("", ending=""),
    )
}
"""The units of data sheets by name: their conversions, and the largest values and keys in them."""
SHOWN = {unit.si: (name, unit.convert) for name, unit in UNITS.items() if unit.shown}
"""Unit shown and its conversion to SI, by SI unit."""


def density_from_sample_std(sample_std: Any, sample_interval: float) -> Any:
    """White noise density from the standard deviation of the rate of one sample.

    A sample is the mean rate over `sample_interval` (s), so density = sample_std * sqrt(sample_interval):
    rad/s per sample to rad/sqrt(s) = (rad/s)/sqrt(Hz), m/s^2 per sample to (m/s)/sqrt(s).
    """
    return np.multiply(sample_std, math.sqrt(sample_interval))


def one_sigma_from_cep(cep: float) -> float:
    """Standard deviation per horizontal axis from the circular error probable, the median of the error."""
    return cep / math.sqrt(2.0 * math.log(2.0))


def one_sigma_from_r50(r50: float) -> float:
    """Standard deviation of one axis from the bound that half of its errors do not exceed."""
    return r50 / 0.6744897501960817
