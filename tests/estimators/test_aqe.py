"""aqe: its exact difference against SciPy, Jacobians against differences, sums over sigma points, between its updates."""

from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from constants import constants, number
from earth_fixed import matrix_of
from navigation import random_rows
from scipy.spatial.transform import Rotation

from insenv import attitude, geodesy, run
from insenv.core.runner import make_runner
from insenv.estimators import aqe, aqe_printed, get
from insenv.estimators.parts import gnss_fix, quaternion_error
from insenv.estimators.parts.quaternion_error import ACCEL, DQ, GYRO, POSITION, VELOCITY, N

MODEL = get("aqe-ekf").model
SCALE = np.concatenate([np.full(4, 1e-5), np.full(3, 1e-6), np.full(3, 1e-4), np.full(3, 1e-2), np.full(3, 1.0)])


@cache
def functions():
    q, v = ca.SX.sym("q", 4), ca.SX.sym("v", 3)
    P, d = ca.SX.sym("P", 4, 4), ca.SX.sym("d", 3)
    p, x = ca.SX.sym("p", MODEL.parameters.size), ca.SX.sym("x", MODEL.state.size)
    age = ca.SX.sym("age")
    named = MODEL.parameters.symbols(p), MODEL.state.symbols(x)
    found = aqe.unscented(q, P, v, d)
    antenna = gnss_fix.antenna(*named, age)
    H = aqe.fix_sensitivity(named[0], named[1], age, antenna)
    return {
        "U": ca.Function("U", [q], [quaternion_error.U(q)]),
        "Y": ca.Function("Y", [q], [quaternion_error.Y(q)]),
        "basis": ca.Function("basis", [v], [aqe.basis(v)]),
        "fix": ca.Function("fix", [p, x, age], [antenna.offset_w, antenna.velocity_w, H]),
        "unscented": ca.Function("unscented", [q, P, v, d], [found.G, found.mean, found.extra, found.C]),
    }


def call(name, *arguments):
    result = functions()[name](*arguments)
    return [r.full() for r in result] if isinstance(result, (list, tuple)) else result.full()


def delta_C(dQ, q_hat):
    """C_hat - C (3x3) from dQ = Q_hat - Q, both of unit length, (9); quadratic in any dQ."""
    return 2 * call("Y", dQ).T @ call("U", q_hat) - call("Y", dQ).T @ call("U", dQ)


def unit(rng):
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


@pytest.mark.parametrize("seed", range(3))
def test_difference_of_attitude_matrices_is_exact_for_errors_of_any_size(seed):
    rng = np.random.default_rng(seed)
    q_hat, q = unit(rng), unit(rng)
    dQ = q_hat - q
    assert np.allclose(delta_C(dQ, q_hat), matrix_of(q_hat) - matrix_of(q), atol=1e-14)  # (8), (9)
    other = 2 * call("Y", dQ).T @ call("U", q) + call("Y", dQ).T @ call("U", dQ)  # the second line of (9)
    assert np.allclose(other, matrix_of(q_hat) - matrix_of(q), atol=1e-14)


def random_state(rng):
    rows = random_rows(rng)
    more = {"since_propagation_q_wb": rows["q_wb"], "acceleration_w": rng.normal(size=3), "mean_rate": rng.normal(size=3) * 0.1}
    return MODEL.state.pack({**rows, **more, "dt": 0.01})


def with_error(x, error):
    """The state of an estimate with `error` (16) relative to state x: estimate minus truth."""
    s = MODEL.state.unpack(x)
    q = s["q_wb"] + error[DQ]
    q = q / np.linalg.norm(q)
    theta = geodesy.numeric.transport_rate_w(error[POSITION], s["q_ew"], s["height"])
    off = {
        "q_wb": q, "since_propagation_q_wb": q, "velocity_w": s["velocity_w"] + error[VELOCITY],
        "q_ew": attitude.numeric.multiply(s["q_ew"], attitude.numeric.from_rotation_vector(theta)),
        "height": s["height"] - error[POSITION][2], "gyro_bias": s["gyro_bias"] - error[GYRO],
        "accel_bias": s["accel_bias"] - error[ACCEL],
    }  # fmt: skip
    return MODEL.state.pack(off, base=x)


def constant(count, delta_angle, delta_velocity):
    """Rows of inputs of `count` samples of 10 ms; increments (3), or (count, 3)."""
    u = np.tile(MODEL.inputs.pack({"dt": 0.01}), (count, 1))
    u[:, MODEL.inputs.slice("delta_angle")], u[:, MODEL.inputs.slice("delta_velocity")] = delta_angle, delta_velocity
    return u


def moved(state, u):
    """The state after samples without an update."""
    runner = make_runner(MODEL, {"filter_interval": 10.0}, "interpreter")
    runner.x[:] = state
    runner.run(len(u), u, 0)
    return runner.x.copy()


def test_errors_of_any_size_follow_the_closed_form():
    """An attitude wrong by about 100 deg: its quaternion error and its velocity error after a second."""
    rng = np.random.default_rng(5)
    x = random_state(rng)
    s = MODEL.state.unpack(x)
    wrong = attitude.numeric.multiply(attitude.numeric.from_rotation_vector(np.array([0.6, -0.9, 1.4])), s["q_wb"])
    other = MODEL.state.pack({"q_wb": wrong, "since_propagation_q_wb": wrong}, base=x)
    u = constant(100, rng.normal(size=(100, 3)) * 3e-3, rng.normal(size=3) * 0.1)
    ends = [MODEL.state.unpack(moved(state, u)) for state in (other, x)]
    dQ = wrong - s["q_wb"]
    expected = delta_C(dQ, wrong) @ ends[0]["since_propagation_velocity"]
    assert np.allclose(ends[0]["velocity_w"] - ends[1]["velocity_w"], expected, atol=1e-3 * np.linalg.norm(expected))
    rate = ends[0]["omega_ie_w"] + ends[0]["omega_ew_w"]
    carried = attitude.numeric.multiply(np.r_[1, -rate / 2], attitude.numeric.multiply(dQ, ends[0]["since_propagation_turn"]))
    assert np.allclose(ends[0]["q_wb"] - ends[1]["q_wb"], carried, atol=3e-5)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("age", [0.0, 0.1])
def test_fix_sensitivities_against_differences(seed, age):
    rng = np.random.default_rng(seed)
    x = random_state(rng)
    p = MODEL.parameters.pack({"antenna_lever_arm": rng.normal(size=3) * 3})
    s = MODEL.state.unpack(x)

    def predicted(error):
        state = with_error(x, error)
        e = MODEL.state.unpack(state)
        change = matrix_of(e["q_wb"]) - matrix_of(s["q_wb"])
        axis = matrix_of(s["q_ew"])[2]
        gravity = geodesy.numeric.normal_gravity_about_axis(axis, s["height"])
        force_b = matrix_of(s["q_wb"]).T @ (s["acceleration_w"] - gravity)
        felt = change @ force_b + matrix_of(s["q_wb"]) @ error[ACCEL]
        state[MODEL.state.slice("acceleration_w")] += felt
        state[MODEL.state.slice("previous_delta_angle")] += error[GYRO] * s["dt"]
        state[MODEL.state.slice("mean_rate")] += error[GYRO]
        offset, velocity, _ = call("fix", p, state, age)
        return np.concatenate([offset.ravel() + error[POSITION], velocity.ravel()])

    H = call("fix", p, x, age)[2]
    tangent = np.linalg.svd(s["q_wb"][None])[2][1:].T
    for step in [*(np.r_[t, np.zeros(12)] * 1e-5 for t in tangent.T), *(np.eye(N)[j] * SCALE[j] for j in range(4, N))]:
        difference = (predicted(step) - predicted(-step)) / 2
        assert np.allclose(H @ step, difference, rtol=2e-3, atol=2e-8), step


def test_sigma_points_against_monte_carlo():
    """Mean and covariance of the nonlinear part for level attitude within 3 deg and heading within 40 deg."""
    rng = np.random.default_rng(1)
    q_hat = unit(rng)
    force = matrix_of(q_hat).T @ [0, 0, -9.8]
    sigma = np.radians([3.0, 3.0, 40.0])
    P = call("Y", q_hat) @ np.diag((sigma / 2) ** 2) @ call("Y", q_hat).T
    G, mean, extra, C = call("unscented", q_hat, P, force, force / 2)
    total = (G @ P @ G.T + extra)[:3, :3]
    q = q_hat - rng.normal(size=(200_000, 3)) * (sigma / 2) @ call("Y", q_hat).T
    q /= np.linalg.norm(q, axis=1)[:, None]
    y = (matrix_of(q_hat) - matrix_of(q)) @ force
    assert np.allclose(mean[:3, 0], y.mean(axis=0), atol=0.01)
    found = np.cov(y.T)
    assert np.allclose(np.sqrt(np.diag(total))[:2], np.sqrt(np.diag(found))[:2], rtol=0.15)
    assert np.linalg.eigvalsh(extra).min() > -1e-12
    spin = call("U", q_hat) @ force / 9.8
    assert np.abs(G @ spin).max() < 1e-9  # a turn about the specific force moves nothing
    assert C.shape == (3, 3)


def test_sigma_points_hold_the_second_order():
    """Small independent rotations t about axes of which the third is that of v: mean and covariance of t x (t x v) / 2.

    E[t x (t x v) / 2] = -|v| (0, 0, s1^2 + s2^2) / 2, with the variances v^2 (s1^2 s3^2, s2^2 s3^2, 2 (s1^4 + s2^4)) / 4.
    """
    rng = np.random.default_rng(5)
    q_hat, force = unit(rng), np.array([3.0, -9.0, 1.0])
    axes, v, s = call("basis", force), np.linalg.norm(force), np.array([4e-4, 2e-4, 6e-4])
    P = call("U", q_hat) @ axes @ np.diag((s / 2) ** 2) @ axes.T @ call("U", q_hat).T
    _, mean, extra, _ = call("unscented", q_hat, P, force, force / 2)
    C = matrix_of(q_hat) @ axes
    assert np.allclose(C.T @ mean[:3, 0], [0, 0, v * (s[0] ** 2 + s[1] ** 2) / 2], rtol=1e-3, atol=1e-9)
    variance = np.diag([s[0] ** 2 * s[2] ** 2, s[1] ** 2 * s[2] ** 2, 2 * (s[0] ** 4 + s[1] ** 4)]) * v**2 / 4
    assert np.allclose(C.T @ extra[:3, :3] @ C, variance, rtol=5e-3, atol=1e-3 * variance.max())
    assert np.allclose(extra, np.kron([[1, 0.5], [0.5, 0.25]], extra[:3, :3]), rtol=1e-3, atol=1e-6 * extra.max())


def test_integrals_of_the_interval_against_quadrature():
    """Of a constant specific force in a body that turns at a constant rate: its integral and that of its integral."""
    rng = np.random.default_rng(2)
    rate, force, dt, count = np.array([0.4, -0.3, 0.5]), np.array([1.0, 2.0, -9.0]), 0.01, 10
    start = MODEL.state.unpack(random_state(rng))
    still = {"gyro_bias": np.zeros(3), "accel_bias": np.zeros(3)}
    before = {"previous_delta_angle": rate * dt, "previous_delta_velocity": force * dt, "since_propagation_turn": [1, 0, 0, 0]}
    u = constant(count, rate * dt, force * dt)
    end = MODEL.state.unpack(moved(MODEL.state.pack({**start, **still, **before}), u))
    time, weight = np.polynomial.legendre.leggauss(12)
    time, weight = (time + 1) * count * dt / 2, weight * count * dt / 2
    turned = Rotation.from_rotvec(time[:, None] * rate).apply(force)
    assert np.allclose(end["since_propagation_velocity"], weight @ turned, rtol=1e-6, atol=1e-8)
    assert np.allclose(end["since_propagation_distance"], weight * (count * dt - time) @ turned, rtol=1e-3, atol=1e-6)


def test_the_curvature_bounds_what_the_sensitivity_omits():
    """The variance added to a fix is E|dQ|^4 |a|^2 of the lever arm a: that of Y^T(dQ) U(dQ) a, by drawing."""
    rng = np.random.default_rng(3)
    q, arm, swing = unit(rng), np.array([3.0, -1.0, 2.0]), np.array([0.4, 0.2, -0.3])
    L = call("Y", q) @ np.diag([0.05, 0.2, 0.3]) @ Rotation.random(random_state=1).as_matrix()
    p = constants(MODEL.parameters, antenna_lever_arm=arm)
    antenna = gnss_fix.Antenna(*[ca.SX.zeros(3)] * 3, ca.SX(swing), *[ca.SX.zeros(3)] * 2, ca.SX.eye(3))
    found = number(aqe._curvature(p, antenna, ca.SX(L @ L.T)))
    drawn = rng.normal(size=(100_000, 3)) @ L.T
    fourth = np.mean(np.sum(drawn**2, axis=1) ** 2)
    assert np.allclose(found, fourth * np.repeat([arm @ arm, swing @ swing], 3), rtol=0.05)
    for dQ in drawn[:20]:  # Y^T U is the rotation of a quaternion of length |dQ|
        assert np.linalg.norm(call("Y", dQ).T @ call("U", dQ) @ arm) == pytest.approx(dQ @ dQ * np.linalg.norm(arm))


@pytest.mark.parametrize("id", ["aqe-ekf", "aqe-sukf"])
def test_between_time_updates_the_outputs_are_those_of_a_time_update(id):
    """The covariance in the state is that of the last time update; the outputs hold at the last sample."""
    runner = make_runner(get(id).model, {"tilt_sigma": 0.3, "heading_sigma": 1.0, "velocity_random_walk": 1e-2}, "interpreter")
    u = {"delta_angle": [1e-3, -2e-3, 3e-3], "delta_velocity": [0.02, 0.01, -0.098], "dt": 0.01}
    runner.run(1, np.tile(runner.model.inputs.pack(u), (1, 1)), 0)
    first = runner.outputs()
    runner.run(59, np.tile(runner.model.inputs.pack(u), (59, 1)), 0)
    between = runner.outputs()
    runner.step("predict", u)
    for name, value in runner.outputs().items():
        assert between[name] == pytest.approx(value, rel=1e-12, abs=1e-12), name
    assert (between["velocity_sigma"] > first["velocity_sigma"]).all()


def test_velocity_between_fixes_keeps_to_its_stated_sigma():
    """From 60 deg off, 2.7 m/s of error stood beside a sigma of 0.1 m/s before each fix: ratios of 44."""
    for seed in (41000, 41001):
        found = run("large-misalignment", "aqe-sukf", seed=seed, duration_s=60.0).results[0]
        for channel in ("vn_mps", "ve_mps", "vd_mps", "north_m", "east_m", "down_m"):
            ratio = np.abs(found.errors[channel]) / found.sigma[channel]
            assert np.mean(ratio > 3) < 0.01 and ratio.max() < 6, (seed, channel)


def transformed(q, P, velocity, distance, spread):
    """Mean (6), covariance (6x6) and mean attitude matrix (3x3) of dC f by points in 13 states, dQ first, NumPy."""
    n, root = 13, np.sqrt(spread)
    whole = np.zeros((n, n))
    whole[:4, :4], whole[4:, 4:] = P, np.diag(np.arange(1.0, 10.0))
    L = np.linalg.cholesky(whole + 1e-18 * np.eye(n))
    points = [np.zeros(n), *[sign * root * L[:, i] for i in range(n) for sign in (1, -1)]]
    weights = np.array([(spread - n) / spread, *[1 / (2 * spread)] * (2 * n)])

    changes = [delta_C(x[:4], q) for x in points]
    values = np.array([[*(change @ velocity), *(change @ distance)] for change in changes])
    mean = weights @ values
    covariance = (weights[:, None] * (values - mean)).T @ (values - mean)
    return mean, covariance, matrix_of(q) - np.tensordot(weights, changes, axes=1)


@pytest.mark.parametrize("spread", [13.0, 3.0, 20.0])
def test_the_sums_are_those_of_27_points(spread):
    rng = np.random.default_rng(8)
    q = attitude.numeric.from_euler(0.3, -0.4, 1.2)
    half = rng.normal(size=(4, 4)) * 0.1
    P, velocity, distance = half @ half.T, rng.normal(size=3) * 9, rng.normal(size=3) * 4
    found = aqe_printed.transform(SimpleNamespace(point_spread=spread))(ca.SX(q), ca.SX(P), ca.SX(velocity), ca.SX(distance))
    G, mean, extra, C = (np.array(ca.DM(each)) for each in (found.G, found.mean, found.extra, found.C))
    expected_mean, expected, expected_C = transformed(q, P, velocity, distance, spread)
    assert np.allclose(mean[:, 0], expected_mean, atol=1e-12)
    assert np.allclose(G @ P @ G.T + extra, expected, atol=1e-10)
    assert np.allclose(C, expected_C, atol=1e-12)
