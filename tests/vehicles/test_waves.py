"""Spectra of the sea, and a ship's motion in it: signs and phases from any direction, in long and short waves."""

import numpy as np
import pytest
from lone_vehicle import history
from scipy.integrate import quad

from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles import Hull, irregular_sea
from insenv.vehicles.waves import response, spectrum, wave_components

SMALL = Hull(length=4.0, beam=1.0, draught=0.3, roll_period=1.0, roll_damping=0.5)
"""A float that rides long waves as the water does."""


def water(k, w, direction, x, y, t):
    """Displacement of the surface: forward, right, down (m), of a wave of 1 m by Airy's theory for deep water."""
    phase = w * t - k * (x * np.cos(direction) + y * np.sin(direction))
    along = np.sin(phase)  # the integral of a velocity w cos(phase)
    return np.array([along * np.cos(direction), along * np.sin(direction), -np.cos(phase)])


@pytest.mark.parametrize("direction", [0.0, 0.6, np.pi / 2, 2.3, np.pi, -0.8, -2.0])
def test_a_small_hull_moves_with_the_water(direction):
    w, step = 0.4, 1e-4
    k = w**2 / STANDARD_GRAVITY
    motions = response([w], SMALL, direction)
    for t in (0.0, 1.7, 5.3):
        turned = {name: (value[0] * np.exp(1j * w * t)).real for name, value in motions.items()}
        here = water(k, w, direction, 0, 0, t)
        ahead = (water(k, w, direction, step, 0, t) - water(k, w, direction, -step, 0, t)) / (2 * step)
        right = (water(k, w, direction, 0, step, t) - water(k, w, direction, 0, -step, t)) / (2 * step)
        expected = {
            "surge": here[0], "sway": here[1], "down": here[2],
            "pitch": -ahead[2],  # nose up where the surface rises ahead
            "roll": right[2],  # right side down where it falls to the right
            "yaw": ahead[1],  # the bow is carried to the right
        }  # fmt: skip
        for name, value in expected.items():
            size = k if name in ("pitch", "roll", "yaw") else 1.0
            # resonance and depth: some percent at this frequency
            assert turned[name] == pytest.approx(value, abs=0.09 * size), name


def test_smith_effect_is_the_decay_with_depth_of_the_draught():
    """Waves much longer than the hull is wide and long, not than it is deep: heave falls as exp(-k d) times its resonance."""
    hull = Hull(length=0.5, beam=0.2, draught=2.0)
    w = np.array([0.7, 0.9])
    k = w**2 / STANDARD_GRAVITY
    found = -response(w, hull, np.pi / 2)["down"].real
    # (1 - k d) / (1 - 2 k d): the closed form of Jensen, Mansour and Olsen without damping, at rest
    assert found == pytest.approx(np.exp(-k * 2.0) * (1 - k * 2.0) / (1 - 2 * k * 2.0), rel=0.02)


def test_heave_at_its_resonance_is_bounded_by_the_waves_that_it_radiates():
    """k T = 1/2: forced by sqrt(1/4 + e^2), damped by e = (2 sin(k B / 2) exp(-k T))^2 / (k B) (Jensen, Mansour, Olsen)."""
    hull, k = Hull(length=0.1, beam=16.0, draught=5.0), 0.1
    damping = 4.0 * np.sin(0.8) ** 2 * np.exp(-1.0) / 1.6
    found = np.abs(response([np.sqrt(STANDARD_GRAVITY * k)], hull, 0.0)["down"])
    assert found == pytest.approx(np.exp(-0.5) * np.hypot(0.5, damping) / damping, rel=1e-4)


@pytest.mark.parametrize("speed", [0.5, 8.0])
def test_roll_resonates_at_the_frequency_of_encounter(speed):
    """There the damping alone is left, and the roll has the phase of the elevation."""
    hull, ahead = Hull(), speed / STANDARD_GRAVITY
    own = 2 * np.pi / hull.roll_period  # w + w^2 U / g, against the waves
    w = (np.sqrt(1 + 4 * ahead * np.cos(0.8) * own) - 1) / (2 * ahead * np.cos(0.8))
    roll = response([w], hull, np.pi - 0.8, speed)["roll"][0]
    assert abs(roll.imag) < 1e-6 * abs(roll.real)


@pytest.mark.parametrize("speed", [0.0, 6.0, 15.0])
@pytest.mark.parametrize(("direction", "heading"), [(0.3, 0.3), (0.3, 2.8), (1.0, -0.4), (-2.0, 0.9)])
def test_sinusoids_are_the_response_at_the_frequency_of_encounter(speed, direction, heading):
    """Also where the ship overtakes the waves, whose encounter then runs backwards; displacements in north and east."""
    hull, count = Hull(length=60), 6
    sea = irregular_sea(2.0, 7.0, count, hull=hull, wave_direction=direction, heading=heading, speed=speed)
    w, amplitude = wave_components(2.0, 7.0, count)
    k = w**2 / STANDARD_GRAVITY
    motions = response(w, hull, direction - heading, speed)
    forward, right = motions.pop("surge"), motions.pop("sway")
    motions["north"] = forward * np.cos(heading) - right * np.sin(heading)
    motions["east"] = forward * np.sin(heading) + right * np.cos(heading)
    ahead = speed * np.array([np.cos(heading), np.sin(heading)])
    for t in (0.0, 2.0, 9.0):
        # the wave w t - k . x at the place that the ship has reached
        phase = w * t - k * (np.array([np.cos(direction), np.sin(direction)]) @ ahead) * t
        for name, value in motions.items():
            expected = amplitude * (value * np.exp(1j * phase)).real
            found = sea[f"wave_{name}_amplitude"] * np.sin(sea["wave_angular_frequency"] * t + sea[f"wave_{name}_phase"])
            assert np.allclose(found, expected, atol=1e-12), name


@pytest.mark.parametrize("enhancement", [1.0, 3.3])
def test_spectrum_has_the_moments_of_the_sea(enhancement: float) -> None:
    zeroth = quad(lambda w: float(spectrum(w, 3.0, 9.0, enhancement)), 0.2, 20.0, limit=200)[0]
    assert 4 * np.sqrt(zeroth) == pytest.approx(3.0, rel=0.01)
    first = quad(lambda w: w * float(spectrum(w, 3.0, 9.0, enhancement)), 0.2, 20.0, limit=200)[0]
    w, amplitude = wave_components(3.0, 9.0, 24, enhancement)
    assert np.sum(amplitude**2) / 2 == pytest.approx(zeroth, rel=0.005)
    assert np.sum(w * amplitude**2) / 2 == pytest.approx(first, rel=0.015)
    if enhancement == 1.0:  # closed form: mean period 0.772 Tp (DNV-RP-C205, sec. 3.5.5.4: T1 = 0.7719 Tp)
        assert 2 * np.pi * zeroth / first == pytest.approx(0.772 * 9.0, rel=0.01)


@pytest.mark.parametrize(("ratio", "width"), [(0.93, 0.07), (1.0, 0.07), (1.09, 0.09), (1.3, 0.09)])
def test_the_peak_is_narrow_below_and_wide_above(ratio: float, width: float) -> None:
    """DNV-RP-C205, sec. 3.5.5: the enhancement over Pierson and Moskowitz, gamma to the power of a bell 0.07 or 0.09 wide."""
    w = ratio * 2 * np.pi / 9.0
    enhanced = spectrum(w, 3.0, 9.0, 3.3) / spectrum(w, 3.0, 9.0, 1.0)
    assert enhanced == pytest.approx((1 - 0.287 * np.log(3.3)) * 3.3 ** np.exp(-0.5 * ((ratio - 1) / width) ** 2), rel=1e-9)


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_motion_in_an_irregular_sea_has_the_variance_of_spectrum_and_response(speed: float) -> None:
    hull, height, period, heading, direction = Hull(length=60), 2.5, 9.0, 0.4, 2.5
    sea = irregular_sea(height, period, 16, hull=hull, wave_direction=direction, heading=heading, speed=speed)
    rows = history("sea", {**sea, "sample_interval": 0.5, "seed": 3}, 8_000)
    w = np.linspace(0.15, 4.0, 4000)
    motions = response(w, hull, direction - heading, speed)
    for name in ("down", "pitch", "roll"):
        expected = np.sqrt(np.trapezoid(spectrum(w, height, period) * np.abs(motions[name]) ** 2, w))
        assert rows[f"wave_{name}_sine"].sum(axis=1).std() == pytest.approx(expected, rel=0.1)
    down = rows["wave_down_sine"].sum(axis=1)
    np.testing.assert_allclose(rows["height"], rows["height"][0] - (down - down[0]), atol=1e-4)
