"""Irregular sea: a wave spectrum, the response of a ship, and the sinusoids for `insenv.vehicles.ship`, computed in
NumPy.

Long-crested waves on deep water. Spectrum: JONSWAP as in DNV-RP-C205 (2010), sec. 3.5.5 (Pierson and Moskowitz for peak
enhancement 1). Response: Jensen, Mansour and Olsen 2004, "Estimation of ship motions using closed-form expressions",
Ocean Engineering 31, for heave and pitch; roll as a damped resonance driven by the wave's slope (Lewis, ed., 1989,
Principles of Naval Architecture III); surge, sway and yaw follow the orbital motion at half draught. All are averaged
over length and beam as well, and the decay with depth uses the wave number itself, so that short beam waves do not lift
the ship as they would in the closed forms. Suited to motion of realistic size and spectrum, not to ship design.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY


@dataclass(frozen=True)
class Hull:
    """Hull properties: length, beam, draught (m), natural roll period (s), roll damping (of critical)."""

    length: float = 100.0
    beam: float = 16.0
    draught: float = 5.0
    roll_period: float = 11.0
    roll_damping: float = 0.12

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            _positive(name, value, "1" if name == "roll_damping" else "s" if name == "roll_period" else "m")


def _positive(name: str, value: float, unit: str) -> None:
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{name} = {value} {unit}: allowed is a finite number above 0")


def spectrum(frequency: ArrayLike, significant_height: float, peak_period: float, enhancement: float = 3.3) -> Array:
    """Spectral density (m^2 s/rad) of the surface elevation at angular frequencies (rad/s) above 0.

    JONSWAP: S = (1 - 0.287 ln gamma) 5/16 Hs^2 wp^4 w^-5 exp(-5/4 (wp/w)^4) gamma^exp(-(w - wp)^2 / (2
    sigma^2 wp^2)), sigma = 0.07 below and 0.09 above the peak wp.
    """
    w, peak = np.asarray(frequency, dtype=np.float64), 2.0 * np.pi / peak_period
    sigma = np.where(w <= peak, 0.07, 0.09)
    enhanced = enhancement ** np.exp(-((w - peak) ** 2) / (2.0 * sigma**2 * peak**2))
    moskowitz = 5.0 / 16.0 * significant_height**2 * peak**4 * w**-5.0 * np.exp(-1.25 * (peak / w) ** 4)
    return np.asarray((1.0 - 0.287 * np.log(enhancement)) * moskowitz * enhanced)


def wave_components(
    significant_height: float, peak_period: float, components: int, enhancement: float = 3.3
) -> tuple[Array, Array]:
    """Angular frequencies (n,) rad/s and amplitudes (n,) m of `components` waves of equal energy that represent the
    spectrum.

    Each wave lies at the centroid of its share of the spectrum; the spacing is uneven, so that the sea does not repeat.
    The sum of A^2 / 2 is the zeroth moment of the spectrum, Hs^2 / 16, to the accuracy of the fitted factor 0.287 (0.5
    %). Raises `InputError` for a value that is out of range.
    """
    _positive("significant_height", significant_height, "m")
    _positive("peak_period", peak_period, "s")
    if not 1.0 <= enhancement <= 7.0:
        raise InputError(f"enhancement = {enhancement}: allowed is 1 (Pierson-Moskowitz) to 7")
    if components < 1:
        raise InputError(f"components = {components}: allowed is at least 1")
    peak = 2.0 * np.pi / peak_period
    edge = peak * np.linspace(0.3, 5.0, 40001)
    w = 0.5 * (edge[1:] + edge[:-1])
    energy = spectrum(w, significant_height, peak_period, enhancement) * np.diff(edge)
    share = np.minimum((np.cumsum(energy) / energy.sum() * components).astype(int), components - 1)
    total = np.bincount(share, energy, components)
    return np.bincount(share, energy * w, components) / total, np.sqrt(2.0 * total)


def response(
    frequency: ArrayLike, hull: Hull, relative_direction: float, speed: float = 0.0
) -> dict[str, NDArray[np.complex128]]:
    """Complex response by motion to waves of unit amplitude, relative to the elevation cos(w_e t) at the ship.

    frequency: rad/s; relative_direction: direction of wave travel, clockwise from the bow (rad; 0 following sea, pi
        head sea);
    speed: m/s. Motions: surge, sway, down (m/m), roll, pitch, yaw (rad/m). Elevation a cos(theta), theta = w_e t - k (x
    cos + y sin).
    """
    w = np.asarray(frequency, dtype=np.float64)
    k = w**2 / STANDARD_GRAVITY
    cos_b, sin_b = np.cos(relative_direction), np.sin(relative_direction)
    alpha = np.abs(1.0 - w * speed / STANDARD_GRAVITY * cos_b)
    x = np.abs(k * cos_b) * hull.length
    # averages of the wave and of its slope over the length: 1 in long waves, with x bounded away from 0/0
    y = np.where(x < 1e-3, 1e-3, x) / 2.0
    mean, slope = np.sin(y) / y, 3.0 * (np.sin(y) - y * np.cos(y)) / y**3
    across = np.sinc(np.abs(k * sin_b) * hull.beam / (2.0 * np.pi))
    smith = np.exp(-k * hull.draught) * across
    radiated = 2.0 * np.sin(np.minimum(k * hull.beam * alpha**2 / 2.0, np.pi / 2)) * np.exp(-k * hull.draught * alpha**2)
    safe = np.maximum(alpha, 1e-2)
    damping = radiated**2 / (k * hull.beam)
    forced = np.hypot(1.0 - k * hull.draught, damping / safe**3)
    yielding = 1.0 / np.hypot(1.0 - 2.0 * k * hull.draught * alpha**2, damping / safe**2)
    vertical = smith * np.minimum(forced * yielding, 2.0)
    ratio = w * alpha * hull.roll_period / (2.0 * np.pi)
    resonance = 1.0 / (1.0 - ratio**2 + 2j * hull.roll_damping * ratio)
    orbital = np.exp(-k * hull.draught / 2.0) * across
    sine = -1j  # of sin(theta) relative to cos(theta)
    return {
        "down": -vertical * mean + 0j,
        "pitch": sine * vertical * slope * k * cos_b,
        "roll": -sine * orbital * np.abs(mean) * k * sin_b * resonance,
        "surge": sine * orbital * mean * cos_b,
        "sway": sine * orbital * mean * sin_b,
        "yaw": -orbital * slope * k * cos_b * sin_b + 0j,
    }


def irregular_sea(
    significant_height: float,
    peak_period: float,
    components: int = 24,
    *,
    hull: Hull | None = None,
    wave_direction: float = 0.0,
    heading: float = 0.0,
    speed: float = 0.0,
    enhancement: float = 3.3,
) -> dict[str, Array]:
    """Parameters ``wave_...`` of ``ship(wave_components=components)`` for a sea and a ship in it.

    significant_height (m), peak_period (s), enhancement: properties of the sea; wave_direction: direction of wave
    travel, clockwise from north (rad); heading (rad), speed (m/s): mean values of the ship, for angle and frequency of
    encounter. Raises `InputError` for a value that is out of range.
    """
    hull = hull or Hull()
    frequency, amplitude = wave_components(significant_height, peak_period, components, enhancement)
    relative = wave_direction - heading
    motions = response(frequency, hull, relative, speed)
    forward, right = motions.pop("surge"), motions.pop("sway")
    motions["north"] = forward * np.cos(heading) - right * np.sin(heading)
    motions["east"] = forward * np.sin(heading) + right * np.cos(heading)
    encounter = frequency * (1.0 - frequency * speed / STANDARD_GRAVITY * np.cos(relative))
    parameters = {"wave_angular_frequency": np.abs(encounter)}
    for motion, complex_response in motions.items():
        # the ship overtakes these waves: their encounter runs backwards in time
        turned = np.where(encounter < 0.0, np.conj(complex_response), complex_response)
        parameters[f"wave_{motion}_amplitude"] = amplitude * np.abs(turned)
        parameters[f"wave_{motion}_phase"] = np.angle(turned) + 0.5 * np.pi
    return parameters
