"""Every heading at once: the same as a bank of Kalman filters, noise shows no heading, level in any attitude."""

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from constants import constants, number
from driven import columns_of, fed
from scipy.spatial.transform import Rotation

from insenv.core import symmetric
from insenv.estimators import every_heading as alignment
from insenv.estimators.every_heading import ACCEL, FLAT, GYRO, TILT, VELOCITY, N
from insenv.geodesy import NOMINAL_GRAVITY
from insenv.scenario import build

MODEL = alignment.MODEL
ARM, GYRO_BIAS, SIGMA = np.array([1.0, -0.5, -2.0]), 0.01, 5.0
KNOWN = {"antenna_lever_arm": ARM, "gyro_bias_sigma": GYRO_BIAS, "accel_bias_sigma": 0.2, "tilt_sigma": 0.1}


def skew(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def drawn(seed):
    """A state and a fix without age, whose errors and likelihoods are any; the likelihood is not flat."""
    rng = np.random.default_rng(seed)
    half = rng.standard_normal((N, N)) * np.repeat([1.0, 0.05, 0.01, 0.1], 3)[:, None]
    peak = rng.standard_normal((3, 2)) * 10
    state = {
        "q_lb": Rotation.from_rotvec([0.1, -0.2, 0.4]).as_quat(scalar_first=True),
        "velocity_l": rng.standard_normal(3),
        "covariance": number(symmetric.triangle(ca.DM(half @ half.T + 1e-4 * np.eye(N)))),
        "found": rng.standard_normal((N, 3)) * np.repeat([1.0, 0.01, 0.001, 0.01], 3)[:, None],
        "cost": peak @ peak.T,
        "rate_b": np.array([0.1, -0.2, 0.3]),
        "mean_rate": np.array([0.1, -0.2, 0.3]),
        "since_fix": 1.0,
        "levelled": 1.0,
    }
    fix = {
        "gnss_velocity_n": np.array([9.0, -4.0, 0.5]),
        "gnss_velocity_sigma": np.full(3, SIGMA),
        "gnss_latitude": 0.8,
        "gnss_velocity_valid": 1.0,
        "dt": 0.01,
    }
    return state, fix


def stepped(name, state, fix):
    tables = ((MODEL.parameters, KNOWN), (MODEL.state, state), (MODEL.inputs, fix))
    rows = MODEL.steps[name].function(*(constants(table, **values) for table, values in tables))
    return {row: number(value) for row, value in rows.items()}


@pytest.mark.parametrize("heading_deg", [0.0, 75.0, 200.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_fix_does_for_a_heading_what_it_does_for_its_kalman_filter(seed, heading_deg):
    state, fix = drawn(seed)
    after, psi = stepped("update", state, fix), np.radians(heading_deg)
    at = np.array([1.0, np.cos(psi), np.sin(psi)])
    C_lb = Rotation.from_quat(state["q_lb"], scalar_first=True).as_matrix()
    swing = C_lb @ np.cross(state["rate_b"], ARM)
    H = np.zeros((3, N))
    H[:, VELOCITY], H[:, TILT], H[:, GYRO] = np.eye(3), skew(swing), -C_lb @ skew(ARM)
    P, error = symmetric.full_array(state["covariance"], N), state["found"] @ at
    seen = state["velocity_l"] + swing - Rotation.from_euler("z", -psi).apply(fix["gnss_velocity_n"])
    S = H @ P @ H.T + SIGMA**2 * np.eye(3)
    K = P @ H.T @ np.linalg.inv(S)
    left = seen - H @ error
    before = at @ state["cost"] @ at
    assert at @ after["cost"] @ at == pytest.approx(before + left @ np.linalg.solve(S, left), rel=1e-9)
    taken = np.zeros(N)
    taken[VELOCITY] = state["velocity_l"] - after["velocity_l"]
    turned = Rotation.from_quat(after["q_lb"], scalar_first=True) * Rotation.from_quat(state["q_lb"], scalar_first=True).inv()
    taken[TILT], taken[GYRO], taken[ACCEL] = turned.as_rotvec(), after["gyro_bias"], after["accel_bias"]
    assert after["found"] @ at + taken == pytest.approx(error + K @ left, abs=1e-9)
    reduced = P - K @ H @ P
    assert symmetric.full_array(after["covariance"], N)[:9, :9] == pytest.approx(reduced[:9, :9], abs=1e-9)


def test_what_all_headings_find_is_weighted_by_their_likelihood():
    """Mean and covariance of (1, c, s) against a fine sum over the circle; the least is found in between the grid."""
    M = np.array([[30.0, -12.0, 5.0], [-12.0, 8.0, 1.0], [5.0, 1.0, 6.0]])
    angles = np.linspace(0, 2 * np.pi, 7200, endpoint=False)
    points = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)])
    costs = np.einsum("ik,ij,jk->k", points, M, points)
    weights = np.exp((costs.min() - costs) / 2)
    weights /= weights.sum()
    mean, covariance = map(number, alignment.moments(M))
    assert mean == pytest.approx(points @ weights, abs=2e-3)
    assert covariance == pytest.approx((points * weights) @ points.T - np.outer(mean, mean), abs=5e-3)
    assert number(alignment.least(M)) % (2 * np.pi) == pytest.approx(angles[np.argmin(costs)], abs=2e-3)
    assert number(alignment.flatness(M)) == pytest.approx(np.ptp(costs), rel=0.02)


def driven(seconds, seed=1, grade="autopilot", **mounting):
    """The alignment after a drive of the car, and its truth: straight on for 30 s, then turns."""
    scenario = changed("car-unknown-heading", imu={"grade": grade, **mounting}, rate_hz=60.0)
    plant = build(scenario, seed=seed, duration_s=seconds)
    columns = columns_of(plant)
    known = plant.knowledge.rows_of(MODEL.parameters)
    return fed(MODEL, columns, {**known, "tilt_sigma": np.pi}), columns


@pytest.mark.parametrize("seed", range(4))
def test_the_noise_of_a_straight_line_shows_no_heading(seed):
    """27 fixes of 5 to 10 cm/s; as states with sensitivities that have their noise, c and s were known to 16 deg."""
    runner, _ = driven(29.0, seed)
    assert number(alignment.flatness(runner.state["cost"])) < FLAT and runner.state["cost_count"] > 10
    assert runner.outputs()["attitude_sigma"][2] > 1.0 and runner.outputs()["attitude_sigma"][:2].max() < 0.04
    assert runner.state["found"][TILT.stop - 1] == pytest.approx(0.0) and runner.state["since_flat"] == 0


@pytest.mark.parametrize("mounting_angles_deg", [[0.0, 0.0, 0.0], [180.0, 0.0, 0.0], [10.0, 80.0, 120.0]])
def test_a_turn_shows_it_however_the_unit_is_mounted(mounting_angles_deg):
    """Level by the specific force; gyros of a degree a second."""
    for seed in range(3):
        runner, columns = driven(38.0, seed, mounting_angles_deg=mounting_angles_deg)
        outputs = runner.outputs()
        truth = Rotation.from_quat(columns["q_nb"][-1], scalar_first=True)
        error = (truth * Rotation.from_quat(outputs["q_nb"], scalar_first=True).inv()).as_rotvec()
        assert np.degrees(outputs["attitude_sigma"][2]) < 8.0
        assert np.all(np.abs(error) < 3.5 * outputs["attitude_sigma"])


def test_interpreted_and_compiled_it_is_the_same_to_the_bit():
    scenario = changed("car-unknown-heading", imu={"grade": "autopilot"}, rate_hz=60.0)
    plant = build(scenario, seed=1, duration_s=34.0)
    columns, known = columns_of(plant), plant.knowledge.rows_of(MODEL.parameters) | {"tilt_sigma": np.pi}
    states = [fed(MODEL, columns, known, backend).state for backend in ("interpreter", "native")]
    assert states[0]["levelled"] and number(alignment.flatness(states[0]["cost"])) > FLAT
    assert all(np.array_equal(states[0][name], states[1][name]) for name in MODEL.state.names)


@pytest.mark.parametrize("force", [[0.3, -0.2, -9.8], [9.0, 3.0, 2.0], [0.0, 0.0, 9.8], [-5.0, 0.0, 9.0]])
def test_the_specific_force_of_a_level_frame_points_up(force):
    upright = Rotation.from_quat(number(alignment.upright(np.array(force))), scalar_first=True)
    assert upright.apply(force) == pytest.approx([0, 0, -np.linalg.norm(force)], abs=1e-6)


@pytest.mark.parametrize(("gained", "known"), [(0.5, 1.0), (2.0, 0.0)])
def test_a_level_is_taken_where_the_velocity_changes_little(gained, known):
    """Over a second 0.5 m/s tilt the mean force by 3 deg, 2 m/s by 12 deg."""
    state = {"level_begun": 1.0, "level_time": 1.0, "level_force": np.array([0.2, 0.1, -NOMINAL_GRAVITY])}
    after = stepped("level", state, {"gnss_velocity_n": np.array([gained, 0, 0]), "dt": 0.01})
    assert after["levelled"] == after["update_due"] == known and after["level_time"] == 0.0
    if known:
        sigma = np.sqrt(symmetric.full_array(after["covariance"], N)[3, 3])
        assert sigma == pytest.approx(max(np.arctan2(gained, NOMINAL_GRAVITY), alignment.LEAST_LEVEL))


def test_an_outlier_counts_as_a_measurement_with_so_large_an_error():
    """Its squared test ratios for the best heading are 25 at most: three components of a fix 500 sigmas off."""
    state, fix = drawn(1)
    heading = number(alignment.least(ca.SX(ca.DM(state["cost"]))))
    after = stepped("update", state, {**fix, "gnss_velocity_n": np.full(3, 500 * SIGMA)})
    at = np.array([1.0, np.cos(heading), np.sin(heading)])
    assert 25 < at @ (after["cost"] - state["cost"]) @ at <= 75.001


def test_what_does_not_become_a_heading_soon_is_forgotten():
    """The drift of the gyros turns l: the filters, of first order in it, begin anew."""
    state, fix = drawn(1)
    kept = stepped("update", {**state, "since_flat": alignment.SOON - 2.0}, fix)
    anew = stepped("update", {**state, "since_flat": alignment.SOON}, fix)
    assert kept["cost"].any() and kept["since_flat"] == pytest.approx(alignment.SOON - 1.0)
    assert not anew["cost"].any() and not anew["found"].any() and anew["since_flat"] == 0
    assert np.sqrt(anew["covariance"][symmetric.place(6, 6)]) == pytest.approx(GYRO_BIAS)


def test_while_nothing_is_known_the_drift_is_no_error():
    state, fix = drawn(2)
    flat = {**state, "cost": 1e-3 * state["cost"], "cost_count": 30.0}
    after = stepped("update", flat, fix)
    down = TILT.stop - 1
    P = symmetric.full_array(after["covariance"], N)
    assert not P[down].any() and not after["found"][down, 1:].any() and after["since_flat"] == 0
    assert after["cost_count"] == pytest.approx(33.0 * np.exp(-GYRO_BIAS / alignment.FADED))
