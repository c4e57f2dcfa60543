"""qakf and qakf-improved: their equations, any start; the printed ones against the textbook filter in NumPy."""

import casadi as ca
import numpy as np
import pytest
from constants import constants, number
from resting import at_rest, attitude_error, samples

from insenv import attitude, geodesy, run
from insenv.estimators import qakf


@pytest.mark.parametrize("id", ["qakf", "qakf-improved"])
@pytest.mark.parametrize("opposite", np.eye(4)[1:])
def test_start_opposite_to_the_truth(id, opposite):
    """Half a turn off about each axis: every residual along the sphere is zero there; noise leads away from it."""
    q = np.array([np.cos(0.3), 0.2, -0.4, 0.7])
    q /= np.linalg.norm(q)
    start = {"start_quaternion": attitude.numeric.multiply(opposite, q)}
    assert np.abs(attitude_error(at_rest(id, q, 0.6, 200.0, parameters=start, accel_noise=1e-4), q)).max() < 2e-3


def left(v):
    """[v +]: v (x) q as a matrix times q."""
    return np.array([[0, *-v], *np.column_stack([v, np.cross(np.eye(3), -v).T])])


def right(v):
    """[v -]: q (x) v as a matrix times q."""
    return np.array([[0, *-v], *np.column_stack([v, np.cross(np.eye(3), v).T])])


def observed(q, alpha, beta, theta):
    """M Q and K Q of the definition at the attitude q turned by theta."""
    M, moved = left(beta) - right(alpha), attitude.numeric.multiply(np.r_[1.0, theta], q)
    return M @ moved / (2 * 9.8), M.T @ M @ moved / (2 * (alpha @ alpha + beta @ beta))


@pytest.mark.parametrize("seed", range(3))
def test_observation_and_its_jacobian_against_the_paper_s_matrices(seed):
    """H theta and the residual, multiplied by Q, against M Q and K Q of the definition and their differences."""
    rng = np.random.default_rng(seed)
    q, alpha, beta = rng.normal(size=4), rng.normal(size=3) * 9, rng.normal(size=3) * 9
    q /= np.linalg.norm(q)
    symbols = [ca.SX.sym("q", 4), ca.SX.sym("a", 3), ca.SX.sym("b", 3)]
    single = ca.Function("s", symbols, qakf.vector_observation(*symbols, 9.8))
    spread = ca.sumsqr(symbols[1]) + ca.sumsqr(symbols[2])
    many = ca.Function("m", symbols, qakf.profile_observation(symbols[0], symbols[2] @ symbols[1].T, spread))
    # multiplication by q from the right: what the filter's components are seen through
    back = np.stack([attitude.numeric.multiply(e, q) for e in np.eye(4)], axis=1)
    for place, own in ((0, single), (1, many)):
        H, residual = (np.array(v) for v in own(q, alpha, beta))
        assert np.allclose(back @ residual.ravel(), observed(q, alpha, beta, np.zeros(3))[place], atol=1e-13)
        for axis in range(3):
            step = np.eye(3)[axis] * 0.5
            difference = observed(q, alpha, beta, step)[place] - observed(q, alpha, beta, -step)[place]
            assert np.allclose(back @ H[:, axis], difference, atol=1e-12)
        assert np.abs(H).max() < 1.0 + 1e-9 or place == 0


def test_low_pass_gain_delay_and_bypass():
    """Unit gain, the delay used by the stated accuracy, the Butterworth cut-off; time constant 0 changes nothing."""
    dt, tau, n = 0.02, 2.0, 10000
    values, rates, value, time = ca.SX.sym("v", 3, 3), ca.SX.sym("r", 3, 3), ca.SX.sym("x", 3), dt * np.arange(1, n + 1)
    step = ca.Function("f", [values, rates, value], qakf.low_pass(values, rates, value, tau, dt))
    signals = np.stack([np.ones(n), time, np.sin(time / tau)])
    found = np.array(step.mapaccum("whole", n, 2)(np.zeros((3, 3)), np.zeros((3, 3)), signals)[0])[2].reshape(n, 3)
    assert found[-1, 0] == pytest.approx(1.0, abs=1e-8)
    assert n * dt - found[-1, 1] == pytest.approx(2 * sum(qakf.DAMPING) * tau, rel=0.01)
    assert np.abs(found[n // 2 :, 2]).max() == pytest.approx(np.sqrt(0.5), rel=0.05)
    through = qakf.low_pass(ca.DM.ones(3, 3), ca.DM.ones(3, 3), ca.DM([3, 4, 5]), 0.0, dt)[0]
    assert np.allclose(np.array(through)[2], [3, 4, 5], atol=1e-12)


def test_one_update_with_exact_vectors_takes_out_the_whole_error():
    """Three orthogonal vectors without noise: what is left of 1 mrad is of second order, and what the start knows."""
    rng = np.random.default_rng(3)
    true = rng.normal(size=4)
    true /= np.linalg.norm(true)
    theta = np.array([4e-4, -3e-4, 5e-4])  # half the attitude error
    off = attitude.numeric.multiply(np.r_[1.0, theta] / np.linalg.norm(np.r_[1.0, theta]), true)
    C = attitude.numeric.to_dcm(true)
    x = constants(qakf.IMPROVED.model.state, q_start=off, samples=1e4, noise_variance=1e-12)
    H, residual = qakf.profile_observation(x.q_start, ca.SX(ca.DM(C)), ca.SX(6.0))
    after = number(qakf.profile_update(x, H, residual)["q_start"])
    left = attitude.numeric.to_rotation_vector(attitude.numeric.multiply(after, true * [1, -1, -1, -1])) / 2
    assert np.abs(left).max() < 0.01 * np.abs(theta).max()


def test_the_covariance_about_the_axes_of_the_start_is_stated_about_those_of_now():
    """At the pole after three hours: north and east of now are 45 deg round, the main axes of [[2, 1], [1, 2]]."""
    half, P = np.pi / 8, np.array([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]) * 1e-12
    given = {"axis_n": [0.0, 0.0, -1.0], "half_turn": [np.cos(half), np.sin(half)], "rest_force_n": [0.0, 0.0, -9.8]}
    x = constants(qakf.PLAIN.model.state, covariance=P[np.tril_indices(3)], time=1e4, **given)
    p = constants(qakf.PARAMETERS, smoothing_time=0.0)
    north, east, _ = number(qakf.output(p, x, (0.0, 0.0))["attitude_sigma"]) / (2 * qakf.SURPLUS * 1e-6)
    assert [north**2, east**2] == pytest.approx([1.0, 3.0], rel=1e-6)


@pytest.mark.parametrize(("scenario", "seed"),
    [pytest.param("ship-irregular-sea", 30060, marks=pytest.mark.slow), ("large-misalignment", 30035)])  # fmt: skip
def test_a_filter_that_creeps_says_so(scenario, seed):
    """Seeds with 9 and 48 deg of heading after ten minutes: a stated sigma of 8 deg is not what it is after convergence."""
    found = run(scenario, "qakf", seed=seed).results[0]
    assert abs(found.errors["heading_deg"][-1]) > 5.0
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        assert abs(found.errors[channel][-1]) < 3 * found.sigma[channel][-1], channel


def textbook(alpha, beta, improved, b=1.0, s=0.0, known=0.0, least=1e-7, dt=0.05):
    """Q (4) after all vectors: Kalman filter with a 4x4 gain, noise by Sage and Husa."""
    q, P, K, r = np.array([1.0, 0, 0, 0]), np.eye(4), np.zeros((4, 4)), 0.0
    for k, (a, c) in enumerate(zip(alpha / geodesy.NOMINAL_GRAVITY, beta / geodesy.NOMINAL_GRAVITY, strict=True)):
        M = left(c) - right(a)
        K = K + M.T @ M * dt
        H = K if improved else M
        e = -H @ q
        d = 1 / (k + 1) if b == 1 else (1 - b) / (1 - b ** (k + 1))
        r = max((1 - d) * r + d * np.trace(np.outer(e, e) - s * H @ P @ H.T) / 4, (least / geodesy.NOMINAL_GRAVITY) ** 2)
        if known:
            r = (known / geodesy.NOMINAL_GRAVITY) ** 2
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + r * np.eye(4))
        q = q + gain @ e
        q /= np.linalg.norm(q)
        P = (np.eye(4) - gain @ H) @ P @ (np.eye(4) - gain @ H).T + r * gain @ gain.T
    return q


def both_at_rest(id, q_nb, parameters, n=400, dt=0.05, latitude=0.6):
    """A printed filter after n samples at rest with noise, and the vectors that it has seen."""
    columns = samples(q_nb, latitude, n * dt, dt, accel_noise=1e-3)
    runner = at_rest(id, q_nb, latitude, n * dt, dt, parameters, "interpreter", accel_noise=1e-3)
    rate_n, time = geodesy.numeric.earth_rate_n(latitude), np.arange(n)[:, None] * dt
    up = np.array([0, 0, -float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))])
    turns = attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(rate_n * (time + dt / 2)))
    turns_b = attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(columns["delta_angle"][0] / dt * time))
    return runner, np.einsum("tij,tj->ti", turns_b, columns["delta_velocity"] / dt), np.einsum("tij,j->ti", turns, up)


@pytest.mark.parametrize("id", ("qakf-printed", "qakf-improved-printed"))
@pytest.mark.parametrize("reading",
    [{}, {"forgetting": 0.97}, {"subtracted": 1.0, "least_noise_sigma": 1e-4}, {"noise_sigma": 1e-3}])  # fmt: skip
def test_against_the_textbook(id, reading):
    q_nb = attitude.numeric.from_euler(0.1, -0.2, 0.7)
    runner, alpha, beta = both_at_rest(id, q_nb, reading)
    names = {"forgetting": "b", "subtracted": "s", "noise_sigma": "known", "least_noise_sigma": "least"}
    expected = textbook(alpha, beta, "improved" in id, **{names[name]: value for name, value in reading.items()})
    found = runner.state["q_start"]
    # alpha here leaves out the rotation within a sample: 2e-6 rad
    assert np.abs(attitude.numeric.error_rotation_vector(found, expected)).max() < 2e-3
    assert np.abs(attitude.numeric.error_rotation_vector(found, expected)[:2]).max() < 2e-5
    assert np.abs(attitude.numeric.error_rotation_vector(found, q_nb)).max() > 1e-4  # 20 s leave an error to compare
