"""q-method: any attitude, both hemispheres, its limit; and the eigenvectors that it uses."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from insenv import attitude, geodesy, limit, run
from insenv.core.batch import make_batch
from insenv.core.numeric import vectorized
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.estimators.parts.eigen import largest_eigenvector
from insenv.evaluation.limits import closed_forms as limits
from insenv.plant.feeding import input_rows
from insenv.scenario import load

eigenvector = vectorized(largest_eigenvector, (4, 4))


@pytest.mark.parametrize("seed", range(20))
def test_eigenvector_against_lapack(seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4)) * 10.0 ** rng.integers(-6, 7)
    A = A + A.T
    values, vectors = np.linalg.eigh(A)
    found = eigenvector(A)
    assert abs(abs(found @ vectors[:, -1]) - 1) < 1e-14
    assert np.abs(A @ found - values[-1] * found).max() < 1e-14 * np.abs(A).max() * 10


@pytest.mark.parametrize(
    "A", [np.zeros((4, 4)), np.eye(4), np.diag([1.0, 3, 3, 0]), np.diag([-5.0, -4, -9, -7]), np.ones((4, 4))]
)
def test_eigenvector_of_equal_and_zero_values(A):
    found = eigenvector(A)
    assert np.abs(A @ found - np.linalg.eigvalsh(A)[-1] * found).max() < 1e-14
    assert abs(found @ found - 1) < 1e-14


def test_eigenvector_resolves_close_values():
    """The gap between eigenvalues from which heading follows after a minute: about 1e-6 of the largest value."""
    Q, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(4, 4)))
    found = eigenvector(Q @ np.diag([1.0, 1 - 2e-6, 0.2, 0.1]) @ Q.T)
    assert np.linalg.norm(found - Q[:, 0] * (found @ Q[:, 0])) < 1e-8


def aligned(q_nb, latitude, gyro_bias=(0, 0, 0), accel_bias=(0, 0, 0), duration=120.0, dt=0.05):
    """Attitude error (rotation vector in n, rad) after `duration` at rest."""
    C_nb = attitude.numeric.to_dcm(q_nb)
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(latitude) + gyro_bias
    force = C_nb.T @ [0, 0, -float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))] + accel_bias
    model, n = get("q-method").model, round(duration / dt)
    columns = {"delta_angle": np.tile(rate * dt, (n, 1)), "delta_velocity": np.tile(force * dt, (n, 1)), "dt": np.full(n, dt)}
    runner = make_runner(model, {"latitude": latitude})
    runner.run(n, input_rows(model, columns, n), 0)
    return attitude.numeric.error_rotation_vector(runner.outputs()["q_nb"], q_nb)


quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@settings(max_examples=40, deadline=None)
@given(quaternions, st.floats(-85, 85))
def test_any_attitude_in_both_hemispheres(q, latitude_deg):
    q = np.array(q) / np.linalg.norm(q)
    assert np.abs(aligned(q, np.radians(latitude_deg))).max() < 1e-6


@pytest.mark.parametrize(
    "q", np.vstack([np.eye(4), [[0.5, 0.5, 0.5, 0.5], [np.sqrt(0.5), 0, np.sqrt(0.5), 0], [0, np.sqrt(0.5), 0, -np.sqrt(0.5)]]])
)
def test_identity_half_turns_and_vertical(q):
    assert np.abs(aligned(q, 0.7)).max() < 1e-7


@pytest.mark.parametrize("latitude_deg", [-50.0, 10.0, 45.0, 70.0])
@pytest.mark.parametrize("axis", range(3))
def test_errors_from_biases_are_those_of_theory(latitude_deg, axis):
    """Body on n: equations (42) of the ECEF paper. Gyro bias alone, then accelerometer bias alone."""
    latitude, q = np.radians(latitude_deg), np.array([1.0, 0, 0, 0])
    gyro, accel = np.zeros(3), np.zeros(3)
    gyro[axis], accel[axis] = np.radians(0.01) / 3600, 50e-6 * 9.8
    by_gyro, by_accel = aligned(q, latitude, gyro_bias=gyro), aligned(q, latitude, accel_bias=accel)
    level = 4.9e-8 * 120  # rad: the gyro's drift over the two minutes
    expected = limits.bias_tilts(gyro, np.zeros(3), latitude, 0.0)
    assert np.allclose(by_gyro[:2], expected[:2], atol=level)
    if axis == 1:
        assert by_gyro[2] == pytest.approx(expected[2], rel=0.02)
        # the gyro-independent rule of thumb: east drift over the horizontal Earth rate
        assert abs(by_gyro[2]) == pytest.approx(gyro[1] / (7.292115e-5 * np.cos(latitude)), rel=0.02)
    expected = limits.bias_tilts(np.zeros(3), accel, latitude, 0.0)
    # an average over the two minutes sees the tilt as it was half-way: the Earth has since turned by omega_ie T / 2
    lag = 7.292115e-5 * 60 * 50e-6
    assert np.allclose(by_accel, expected, atol=1.1 * lag)


def test_noise_limits_are_those_of_a_line_and_a_brownian_path():
    """Against a Monte Carlo of the best linear unbiased estimators of the formulas."""
    rng = np.random.default_rng(2)
    T, dt, runs = 300.0, 0.5, 4000
    t = np.arange(dt, T + dt, dt)
    path = np.cumsum(rng.normal(size=(runs, len(t))) * np.sqrt(dt), axis=1)
    white = rng.normal(size=(runs, len(t))) / np.sqrt(dt)
    fit = np.linalg.lstsq(np.stack([np.ones_like(t), t], axis=1), white.T, rcond=None)[0]
    g, latitude = float(geodesy.numeric.normal_gravity(np.sin(0.5), 0.0)), 0.5
    by_gyro, by_accel = limits.noise_tilts(1.0, 0.0, latitude, 0.0, T), limits.noise_tilts(0.0, 1.0, latitude, 0.0, T)
    horizontal = 7.292115e-5 * np.cos(latitude)
    assert by_gyro[2] == pytest.approx((path[:, -1] / T).std() / horizontal, rel=0.05)
    assert by_accel[2] == pytest.approx(fit[1].std() / g / horizontal, rel=0.05)
    assert by_accel[1] == pytest.approx((fit[0] + fit[1] * T).std() / g, rel=0.05)
    assert by_accel[0] == pytest.approx(white.mean(axis=1).std() / g, rel=0.05)


@pytest.mark.parametrize(
    ("name", "ratio"), [("ship-swaying", 1.6), ("car-parked", 1.6), ("aircraft-parked", 1.6), ("turntable-quaternion", 1.6)]
)
def test_alignment_in_place_reaches_its_limit(name, ratio):
    """Every vehicle, over eight seeds: RMS heading error over RMS limit."""
    found, limit = [], []
    for seed in range(8):
        result = run(load(name), ["q-method"], seed=seed).results[0]
        found.append(result.statistics()["final"]["heading_deg"])
        limit.append(result.limit["heading_deg"])
    assert np.sqrt(np.mean(np.square(found))) < ratio * np.sqrt(np.mean(np.square(limit)))


def test_profile_and_davenport_signs():
    """One rotation, many vectors: the quaternion that takes alpha to beta, by scipy."""
    from scipy.spatial.transform import Rotation

    from insenv.estimators.q_method import davenport

    rng = np.random.default_rng(3)
    rotation = Rotation.random(random_state=4)
    alpha = rng.normal(size=(6, 3))
    profile = sum(np.outer(rotation.apply(a), a) for a in alpha)
    q = eigenvector(np.array(ca.DM(davenport(ca.SX(profile)))))
    expected = rotation.as_quat(scalar_first=True)
    assert abs(abs(q @ expected) - 1) < 1e-14


def test_q_method_is_near_the_bound_and_not_below_it():
    """White noise alone, no bias, at rest: scatter of heading over 200 seeds at 100 s against the bound."""
    rng, dt, n, rows = np.random.default_rng(8), 0.1, 1000, 200
    N, V, latitude = 2e-6, 3e-5, 0.6
    rate, g = geodesy.numeric.earth_rate_n(latitude), float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))
    model = get("q-method").model
    u = np.tile(model.inputs.start_vector(), (rows, n, 1))
    u[..., model.inputs.slice("delta_angle")] = rate * dt + rng.normal(size=(rows, n, 3)) * N * np.sqrt(dt)
    u[..., model.inputs.slice("delta_velocity")] = [0, 0, -g * dt] + rng.normal(size=(rows, n, 3)) * V * np.sqrt(dt)
    u[..., model.inputs.slice("dt")] = dt
    batch = make_batch(model, rows, {"latitude": latitude, "smoothing_time": 0.0})
    batch.run(n, u)
    q_nb = model.outputs.unpack(batch.output())["q_nb"]
    heading = attitude.numeric.error_rotation_vector(q_nb, np.tile([1.0, 0, 0, 0], (rows, 1)))[:, 2]
    noise = {"gyro_arw_deg_sqrt_h": np.degrees(N) * 60, "accel_vrw_ug_sqrt_hz": V / 9.80665e-6}
    scenario = {
        "title": "white noise at rest", "duration_s": n * dt, "rate_hz": 1 / dt, "vehicle": {"kind": "car"}, "imu": noise,
        "start": {"latitude_deg": np.degrees(latitude), "longitude_deg": 0.0},
        "knowledge": {"tilt_sigma_deg": 60.0, "heading_sigma_deg": 360.0},
    }  # fmt: skip
    bound = limit(scenario).rotation[-1, 2]
    # 200 seeds know a standard deviation to 5 %
    assert 0.85 < np.sqrt(np.mean(heading**2)) / bound < 1.35
