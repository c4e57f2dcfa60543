"""Signs and phases of a ship's motion in waves: of the water's surface and particles, in long waves, from any direction."""

import numpy as np
import pytest

from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles import Hull, irregular_sea
from insenv.vehicles.waves import response, wave_components

SMALL = Hull(length=4.0, beam=1.0, draught=0.3, roll_period=1.0, roll_damping=0.5)
"""A float that rides long waves as the water does."""


def water(k, w, direction, x, y, t):
    """Displacement of the surface: forward, right, down (m), of a wave of 1 m that travels in `direction`.

    Deep water, on the surface: a particle moves on a circle, forward with the wave on the crest (Airy's theory).
    """
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
