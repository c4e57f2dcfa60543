"""Splines through points with velocities."""

from dataclasses import replace

import numpy as np
import pytest

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.scenario.tracks.shape import Points, check_velocity, shaped


def motion(time):
    """Latitude, longitude, height and velocity of a motion in sines."""
    w = 2.0 * np.pi
    angles = np.column_stack([300.0 * np.sin(w * time / 60.0), 2.0 * np.sin(w * time / 5.0)]) / 6.4e6 + np.radians([47.0, 11.0])
    rates = np.column_stack([5.0 * w * np.cos(w * time / 60.0), 0.4 * w * np.cos(w * time / 5.0)]) / 6.4e6
    height, climb = 500.0 + 0.1 * np.sin(w * time / 1.5), 0.1 * w / 1.5 * np.cos(w * time / 1.5)
    return np.column_stack([angles, height]), in_metres(angles[:, 0], height, rates, -climb)


def in_metres(latitude, height, rates, down):
    R_M, R_N = geodesy.numeric.radii(np.sin(latitude))
    return np.column_stack([(R_M + height) * rates[:, 0], (R_N + height) * np.cos(latitude) * rates[:, 1], down])


def closed_form():
    time = np.arange(0.0, 60.05, 0.1)
    place, velocity = motion(time)
    return Points("vehicle.fmu", time, *place.T, velocity=velocity)


def apart(points):
    """Largest error of position (m) and velocity (m/s) of the track of some points, between them too."""
    shape = shaped(points, 0.1, None, "level")
    time = np.arange(0.0, points.time[-1], 0.005)
    place, velocity = motion(time)
    found = shape.spline.at(time)[:, :3] + shape.origin
    rates = shape.spline.at(time, 1)
    own = in_metres(found[:, 0], found[:, 2], rates, -rates[:, 2])
    return np.abs(np.array([6.4e6, 6.4e6, 1.0]) * (found - place)).max(), np.abs(own - velocity).max()


def test_a_closed_form_with_its_velocities():
    """From its first point on: without the velocities nothing tells of the motion before it."""
    points = closed_form()
    position, velocity = apart(points)
    assert position < 1e-7 and velocity < 2e-6
    position, velocity = apart(replace(points, velocity=None))
    assert 1e-5 < position < 1e-3 and 1e-3 < velocity < 0.05
    # an Euler step of 10 ms leaves the velocity half a step ahead of the position: the truth stays near both
    position, velocity = apart(replace(points, velocity=motion(points.time + 0.005)[1]))
    assert position < 1e-3 and velocity < 0.01


@pytest.mark.parametrize(("wrong", "said"), [
    (lambda v: 3.6 * v, "velocity north is .* m/s at .* s, and .* m/s by the positions"),
    (lambda v: v * [1.0, 1.0, -1.0], "velocity down is .* max_contradiction_mps = 0.05 m/s"),
    (lambda v: v * 1.003, "velocity north .* the Earth model"),
])  # fmt: skip
def test_velocities_that_contradict_the_positions_are_refused(wrong, said):
    points = closed_form()
    points = replace(points, velocity=wrong(points.velocity))
    with pytest.raises(InputError, match=said):
        check_velocity(points, shaped(points, 0.1, None, "level"), 0.05)
