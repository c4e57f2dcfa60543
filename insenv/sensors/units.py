"""Conversion of data-sheet units (deg/h, ug/sqrt(Hz), ...) to SI, and of the two notations of white noise.

Conversions of a number or an array are named ``<data-sheet unit>_to_<SI unit>``.  ``h`` is an hour, ``g`` the standard
gravity of data sheets (9.80665 m/s^2, independent of the local gravity), ``ppm`` a millionth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.keys import CELSIUS, DEGREES, SAME, Conversion
from insenv.geodesy import STANDARD_GRAVITY

HOUR = 3600.0
"""s."""
DEGREE = DEGREES.scale
"""rad."""
ZERO_CELSIUS = CELSIUS.scale
"""K."""


ANGLE_UNITS = {"deg": DEGREE, "rad": 1.0}
"""unit -> radians."""
SPEED_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "kn": 1852.0 / 3600.0}
"""unit -> m/s."""


def _times(scale: float) -> Conversion:
    return Conversion("product", scale)


deg_to_rad = DEGREES
arcsec_to_rad = _times(DEGREE / 3600.0)
urad_to_rad = _times(1e-6)
deg_h_to_rad_s = _times(DEGREE / HOUR)
rad_s_to_deg_h = deg_h_to_rad_s.back
deg_sqrt_h_to_rad_sqrt_s = _times(DEGREE / math.sqrt(HOUR))  # angle random walk
deg_h_sqrt_h_to_rad_s_sqrt_s = _times(DEGREE / HOUR / math.sqrt(HOUR))  # rate random walk
deg_h_g_to_rad_s_per_m_s2 = _times(DEGREE / HOUR / STANDARD_GRAVITY)  # g-sensitivity
g_to_m_s2 = _times(STANDARD_GRAVITY)
ug_to_m_s2 = _times(STANDARD_GRAVITY * 1e-6)
m_s2_to_ug = ug_to_m_s2.back
mgal_to_m_s2 = _times(1e-5)
ug_sqrt_hz_to_m_s_sqrt_s = _times(STANDARD_GRAVITY * 1e-6)  # velocity random walk as an acceleration density
m_s_sqrt_h_to_m_s_sqrt_s = _times(1.0 / math.sqrt(HOUR))  # velocity random walk
ug_sqrt_h_to_m_s2_sqrt_s = _times(STANDARD_GRAVITY * 1e-6 / math.sqrt(HOUR))  # acceleration random walk
ppm_to_one = _times(1e-6)
percent_to_one = _times(0.01)
nt_to_t = _times(1e-9)
deg_c_to_k = CELSIUS


@dataclass(frozen=True)
class Unit:
    """A unit of data sheets.

    si: the unit of the rows that it is converted to.  largest: value that an error in this unit does not exceed: in
        proportion to a quantity that quantity; per kelvin or g ten times that of the poorest units.  ending: of the keys of
        an estimator's section that are given in it; None: there are none.  shown: whether MAVLink's parameters are in it.
    """

    si: str
    convert: Conversion = SAME
    largest: float = 1e9
    ending: str | None = None
    shown: bool = False


UNITS = {
    "deg": Unit("rad", deg_to_rad, 180.0, "deg", shown=True),
    "arcsec": Unit("rad", arcsec_to_rad),
    "urad": Unit("rad", urad_to_rad),
    "deg/h": Unit("rad/s", deg_h_to_rad_s, ending="deg_h", shown=True),
    "deg/s": Unit("rad/s", deg_to_rad),
    "deg/sqrt(h)": Unit("rad/s^0.5", deg_sqrt_h_to_rad_sqrt_s, ending="deg_sqrt_h", shown=True),
    "deg/h/sqrt(h)": Unit("rad/s/sqrt(s)", deg_h_sqrt_h_to_rad_s_sqrt_s),
    "deg/h/g": Unit("(rad/s)/(m/s^2)", deg_h_g_to_rad_s_per_m_s2, 1e6),
    "deg/h/K": Unit("rad/s/K", deg_h_to_rad_s, 1e4),
    "ug": Unit("m/s^2", ug_to_m_s2, ending="ug", shown=True),
    "mGal": Unit("m/s^2", mgal_to_m_s2, ending="mgal"),
    "g": Unit("m/s^2", g_to_m_s2),
    "ug/sqrt(Hz)": Unit("m/s^1.5", ug_sqrt_hz_to_m_s_sqrt_s, ending="ug_sqrt_hz", shown=True),
    "m/s/sqrt(h)": Unit("m/s^1.5", m_s_sqrt_h_to_m_s_sqrt_s, ending="mps_sqrt_h"),
    "ug/sqrt(h)": Unit("m/s^2/sqrt(s)", ug_sqrt_h_to_m_s2_sqrt_s),
    "ug/K": Unit("m/s^2/K", ug_to_m_s2, 1e5),
    "ppm": Unit("1", ppm_to_one, 1e6),
    "ppm/K": Unit("1/K", ppm_to_one, 1e3),
    "%": Unit("1", percent_to_one, 100.0),
    "% per m/s^2": Unit("s^2/m", percent_to_one, 100.0),
    "nT": Unit("T", nt_to_t),
    "m": Unit("m", ending="m"),
    "s": Unit("s", ending="s"),
    "m/s": Unit("m/s", ending="mps"),
    "": Unit("1", ending=""),
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
