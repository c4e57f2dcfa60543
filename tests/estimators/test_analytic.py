"""analytic: its stated noise, the scatter about a straight line, and a car that somebody steps into."""

import casadi as ca
import numpy as np
import pytest
from constants import number
from driven import fed, outputs_of

from insenv import run
from insenv.estimators import analytic
from insenv.geodesy import OMEGA_IE

G, LATITUDE = 9.8, 0.6
MODEL = analytic.MODEL


def test_it_states_the_noise_of_two_means():
    V, N, time = 2e-3, 3e-5, 200.0
    walks = {"velocity_random_walk": V, "angle_random_walk": N}
    path = {"angle": np.array([1e-3, 0, -1e-3]), "velocity": np.array([0, 0, -G * time])}
    x = MODEL.state.pack({**path, "first": np.concatenate(list(path.values())) / time, "time": time})
    shown = outputs_of(MODEL, x, {"accel_bias_sigma": 0.0, "gyro_bias_sigma": 0.0, **walks, "latitude": LATITUDE})
    expected = [V / np.sqrt(time) / G] * 2 + [N / np.sqrt(time) / (OMEGA_IE * np.cos(LATITUDE))]
    assert shown["attitude_sigma"] == pytest.approx(expected, rel=1e-6)


def test_the_scatter_about_a_straight_line_is_that_of_a_fit():
    """Angle and velocity of a swaying base, sample by sample, against a line fitted to them."""
    rng, dt, count = np.random.default_rng(5), 0.1, 400
    rows = np.cumsum(rng.normal(size=(count, 6)), axis=0) * 1e-2 + [1e-4, 0, 2e-4, 0.1, 0.2, -9.8]
    columns = {"delta_angle": rows[:, :3] * dt, "delta_velocity": rows[:, 3:] * dt, "dt": np.full(count, dt)}
    x = MODEL.state.symbols(ca.SX(ca.DM(fed(MODEL, columns, backend="interpreter").x)))
    found = number(analytic.spread(x))
    middle = np.cumsum(rows, axis=0) * dt - rows * dt / 2  # the integrals in the middle of each sample
    t = dt * (np.arange(count) + 0.5)
    left = middle - np.stack([np.polyval(np.polyfit(t, column, 1), t) for column in middle.T], axis=1)
    assert found == pytest.approx(np.mean(left**2, axis=0), rel=2e-3)
    ended = number(analytic.departure(x))
    lines = [np.polyval(np.polyfit(t, column, 1), dt * count) for column in middle.T]
    assert ended == pytest.approx(rows.sum(axis=0) * dt - lines, rel=2e-3)


def test_it_knows_that_somebody_has_just_stepped_in():
    """A parked car, 2.5 s after it has begun to tilt by 0.6 deg: heading is off by 100 deg, 14 deg were stated."""
    found = run("car-parked", "analytic", seed=30000, duration_s=125.0).results[0]
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        late = found.time > 55.0
        assert (np.abs(found.errors[channel]) < 3 * found.sigma[channel])[late].all(), channel
    assert np.abs(found.errors["heading_deg"]).max() > 90.0
