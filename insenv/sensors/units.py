"""Conversion of data-sheet units (deg/h, ug/sqrt(Hz), ...) to SI, and of the two notations of white noise.

NumPy functions of a number or an array, named ``<data-sheet unit>_to_<SI unit>``.  ``h`` is an hour, ``g`` the standard
gravity of data sheets (9.80665 m/s^2, independent of the local gravity), ``ppm`` a millionth.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from insenv.geodesy import STANDARD_GRAVITY

HOUR = 3600.0
"""s."""
DEGREE = math.pi / 180.0
"""rad."""
ZERO_CELSIUS = 273.15
"""K."""


ANGLE_UNITS = {"deg": DEGREE, "rad": 1.0}
"""unit -> radians."""
SPEED_UNITS = {"m/s": 1.0, "km/h": 1.0 / 3.6, "kn": 1852.0 / 3600.0}
"""unit -> m/s."""


def deg_to_rad(value: Any) -> Any:
    """deg to rad; also deg/s to rad/s."""
    return np.multiply(value, DEGREE)


def rad_to_deg(value: Any) -> Any:
    """rad to deg; also rad/s to deg/s."""
    return np.divide(value, DEGREE)


def arcsec_to_rad(value: Any) -> Any:
    """Seconds of arc to rad."""
    return np.multiply(value, DEGREE / 3600.0)


def urad_to_rad(value: Any) -> Any:
    """Microradians to rad."""
    return np.multiply(value, 1e-6)


def deg_h_to_rad_s(value: Any) -> Any:
    """deg/h to rad/s (bias); also deg/h/K to rad/s/K."""
    return np.multiply(value, DEGREE / HOUR)


def rad_s_to_deg_h(value: Any) -> Any:
    """rad/s to deg/h."""
    return np.divide(value, DEGREE / HOUR)


def deg_sqrt_h_to_rad_sqrt_s(value: Any) -> Any:
    """deg/sqrt(h) to rad/sqrt(s) (angle random walk)."""
    return np.multiply(value, DEGREE / math.sqrt(HOUR))


def deg_h_sqrt_h_to_rad_s_sqrt_s(value: Any) -> Any:
    """(deg/h)/sqrt(h) to (rad/s)/sqrt(s) (rate random walk)."""
    return np.multiply(value, DEGREE / HOUR / math.sqrt(HOUR))


def deg_h_g_to_rad_s_per_m_s2(value: Any) -> Any:
    """(deg/h)/g to (rad/s)/(m/s^2) (g-sensitivity)."""
    return np.multiply(value, DEGREE / HOUR / STANDARD_GRAVITY)


def g_to_m_s2(value: Any) -> Any:
    """g to m/s^2."""
    return np.multiply(value, STANDARD_GRAVITY)


def m_s2_to_g(value: Any) -> Any:
    """m/s^2 to g."""
    return np.divide(value, STANDARD_GRAVITY)


def ug_to_m_s2(value: Any) -> Any:
    """ug to m/s^2; also ug/K to m/s^2/K."""
    return np.multiply(value, STANDARD_GRAVITY * 1e-6)


def m_s2_to_ug(value: Any) -> Any:
    """m/s^2 to ug."""
    return np.divide(value, STANDARD_GRAVITY * 1e-6)


def mgal_to_m_s2(value: Any) -> Any:
    """mGal to m/s^2."""
    return np.multiply(value, 1e-5)


def ug_sqrt_hz_to_m_s_sqrt_s(value: Any) -> Any:
    """ug/sqrt(Hz) to (m/s)/sqrt(s) (velocity random walk as an acceleration density)."""
    return np.multiply(value, STANDARD_GRAVITY * 1e-6)


def m_s_sqrt_h_to_m_s_sqrt_s(value: Any) -> Any:
    """(m/s)/sqrt(h) to (m/s)/sqrt(s) (velocity random walk)."""
    return np.multiply(value, 1.0 / math.sqrt(HOUR))


def ug_sqrt_h_to_m_s2_sqrt_s(value: Any) -> Any:
    """ug/sqrt(h) to (m/s^2)/sqrt(s) (acceleration random walk)."""
    return np.multiply(value, STANDARD_GRAVITY * 1e-6 / math.sqrt(HOUR))


def ppm_to_one(value: Any) -> Any:
    """Parts per million to a pure number."""
    return np.multiply(value, 1e-6)


def percent_to_one(value: Any) -> Any:
    """Per cent to a pure number."""
    return np.multiply(value, 0.01)


def nt_to_t(value: Any) -> Any:
    """nT to T."""
    return np.multiply(value, 1e-9)


def deg_c_to_k(value: Any) -> Any:
    """Degrees Celsius to kelvin."""
    return np.add(value, ZERO_CELSIUS)


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
