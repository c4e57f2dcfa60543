"""Mechanizations and error models against an independent one in ECEF (tests/helpers/earth_fixed.py): 100 s at 250 m/s.

The filters' transitions are read off their covariances: without noise one of rank one, v v^T, becomes (Phi v)(Phi v)^T.
What the filters' models leave out is below 1e-3 of what the largest term causes; half a Coriolis term is 1e-2 of it.
At the end: the covariance that an alignment hands over, and errors that turn with a corrected platform.
"""

import dataclasses
from functools import cache

import casadi as ca
import earth_fixed
import numpy as np
import pytest
from changed_scenario import changed
from driven import fed, of_model
from earth_fixed import ACCEL, GYRO, PHI, POSITION, SCALE, VELOCITY, Motion, matrix_of, quaternion_of, skew, stored, tangent
from scipy.spatial.transform import Rotation

import insenv
from insenv import geodesy
from insenv.core import symmetric
from insenv.estimators import get
from insenv.estimators.fusion import fusion
from insenv.estimators.fusion.available import all_states
from insenv.estimators.parts.error_model import TILT, aligned, covariance_after
from insenv.estimators.parts.kalman import Update
from insenv.sensors.imu_tables import COUPLINGS

FLIGHT, DURATION, DT = Motion(), 100.0, 0.025
STRAIGHT = Motion(swings=((2.0, 0.2, 0.4, (0.3, -0.8, 0.3)),),
    turns=((0.02, 0.3, 0.2, (0.2, -0.3, 0.9)), (0.01, 0.5, 1.0, (0.9, 0.4, -0.1))))  # fmt: skip
"""Nearly straight: over some seconds the attitude changes by 1e-2 rad."""
EXACT = {
    "angle_random_walk": 0.0, "velocity_random_walk": 0.0, "gyro_bias_sigma": 0.0, "accel_bias_sigma": 0.0,
    "gyro_correlation_time": 1e12, "accel_correlation_time": 1e12, "position_sigma": 0.0, "velocity_sigma": 0.0,
    "tilt_sigma": 0.0, "heading_sigma": 0.0, "standing_window": 0.0,
}  # fmt: skip
IN_PLACE = {"moving": 1.0, "coarse_time": 0.0, "update_interval": 2 * DT}


@cache
def truth(motion, duration, known_place=False):
    """Phi (15, 15) of the error states in e, C_ew at the start and at the end, and r, v, C at the end."""
    Phi, r, v, C = earth_fixed.transition(motion, duration, step=0.1, known_place=known_place)
    assert np.abs(r - motion.position(duration)).max() < 1e-5 and np.abs(v - motion.velocity(duration)).max() < 1e-6
    return Phi, motion.frame_w(0.0, 2), motion.frame_w(duration), (r, v, C)


@cache
def inputs(motion, duration):
    count = round(duration / DT)
    delta_angle, delta_velocity = motion.increments(DT, count)
    return {"delta_angle": delta_angle, "delta_velocity": delta_velocity, "dt": np.full(count, DT)}


def navigated(id, motion, duration, covariance=None, **parameters):
    """The state of an estimator at the end of a motion, on its exact increments, from its true start."""
    model, columns, start = get(id).model, inputs(motion, duration), motion.start()
    start |= {name.removeprefix("start_"): value for name, value in start.items()}
    given = of_model(model, {**start, **EXACT, **parameters})
    given = {name: np.maximum(model.parameters[name].lower, value) for name, value in given.items()}
    rows = {} if covariance is None else {"covariance": stored(covariance)}
    if id == "ecef-kf":
        rows["fix_sigma"] = 1.0  # of fixes that never come
    return fed(model, columns, given, "interpreter", **rows).state


def carried(id, motion, duration, directions, scale, **parameters):
    """Phi times each direction (columns), up to the sign of each."""
    found = []
    for v in directions.T:
        state = navigated(id, motion, duration, np.outer(v, v), **parameters)
        P = symmetric.full_array(state["covariance"], len(v))
        largest = np.argmax(np.diag(P) / scale**2)
        found.append(P[:, largest] / np.sqrt(P[largest, largest]))
    return np.array(found).T


def compare(found, expected, scale, rows, columns, tolerance, neglected):
    """Blocks of `found`, each column up to its sign, in units of `scale`: within `tolerance` of the expected block.

    neglected: by (row, column) what the model leaves out of the block, in the same units.
    """
    found, expected = found / scale[:, None], expected / scale[:, None]
    found, wrong = found * np.sign(np.sum(found * expected, axis=0)), []
    for row, here in rows.items():
        for column, there in columns.items():
            error = np.abs(found[here, there] - expected[here, there]).max()
            size = np.abs(expected[here, there]).max()
            bound = tolerance * size + neglected.get((row, column), 1e-7)
            wrong += [f"{row} from {column}: {error:.1e} where it is {size:.1e}"] if not error < bound else []
    assert not wrong, "; ".join(wrong)


NAMES = {"position": POSITION, "velocity": VELOCITY, "tilt": PHI, "gyro": GYRO, "accel": ACCEL}


def test_transition_of_the_15_states():
    """Position, velocity and psi are the error vectors in e, seen in w."""
    Phi, C_start, C_end, _ = truth(FLIGHT, DURATION)
    into = [np.kron(np.eye(5), np.zeros((3, 3))) + np.eye(15) for _ in range(2)]
    for matrix, C_ew in zip(into, (C_start, C_end), strict=True):
        for part in (POSITION, VELOCITY, PHI):
            matrix[part, part] = C_ew.T
    expected = into[1] @ Phi @ into[0].T * SCALE
    found = carried("loosely-coupled", FLIGHT, DURATION, np.diag(SCALE), SCALE, covariance_interval=DT)
    # the radius of the gradient of gravity, here 0.3 % of 0.063, is the Earth's mean radius
    compare(found, expected, SCALE, NAMES, NAMES, 8e-4, {("velocity", "position"): 1.5e-4, ("position", "position"): 1.5e-4})
    # gravity's change with latitude alone is 1.5e-4 in each of these two
    vertical, north = np.array([5, 3]), np.array([0, 2])
    error = np.abs(found[vertical, north]) - np.abs(expected[vertical, north])
    assert np.abs(error / SCALE[vertical]).max() < 5e-6


def test_transition_of_the_12_states_in_e():
    """Velocity, misalignment and biases in e, at a place that fixes tell."""
    Phi = truth(FLIGHT, DURATION, known_place=True)[0]
    order = np.r_[VELOCITY, PHI, ACCEL, GYRO]
    scale = SCALE[order]
    found = carried("ecef-kf", FLIGHT, DURATION, np.diag(scale), scale, **IN_PLACE)
    places = {name: slice(3 * k, 3 * k + 3) for k, name in enumerate(("velocity", "tilt", "accel", "gyro"))}
    compare(found, Phi[np.ix_(order, order)] * scale, scale, places, places, 8e-4, {})


def quaternion_error(C_ew, C_eb, r, v):
    """16 x 15: dQ, biases, dv, dr of errors in e. Attitude and velocity are relative to the computed frame, which dr turns."""
    turn, q, velocity_w = earth_fixed.frame_turn(r, C_ew) @ C_ew.T, quaternion_of(C_ew.T @ C_eb), C_ew.T @ v
    into = np.zeros((16, 15))
    into[0:4, POSITION], into[0:4, PHI] = -tangent(q) @ turn / 2, -tangent(q) @ C_ew.T / 2
    into[4:7, GYRO] = into[7:10, ACCEL] = np.eye(3)
    into[10:13, VELOCITY], into[10:13, POSITION] = C_ew.T, skew(velocity_w) @ turn
    into[13:16, POSITION] = C_ew.T
    return into


ROWS_16 = dict(
    zip(("tilt", "gyro", "accel", "velocity", "position"), map(slice, (0, 4, 7, 10, 13), (4, 7, 10, 13, 16)), strict=True)
)
COLUMNS_16 = {name: slice(3 * k, 3 * k + 3) for k, name in enumerate(ROWS_16)}
SCALE_16 = np.r_[np.full(4, 1e-5), np.repeat([1e-7, 1e-4, 0.1, 10.0], 3)]


def transition_16(id, motion, duration, interval):
    """Phi times directions on the tangent of the unit sphere: found, and by the independent mechanization."""
    Phi, C_start, C_end, (r, v, C) = truth(motion, duration)
    begin = motion.attitude(0.0), motion.position(0.0), motion.velocity(0.0)
    directions = np.zeros((16, 15))
    directions[:4, :3] = tangent(quaternion_of(C_start.T @ begin[0])) * SCALE_16[0]
    directions[4:, 3:] = np.diag(SCALE_16[4:])
    start = quaternion_error(C_start, *begin)
    expected = quaternion_error(C_end, C, r, v) @ Phi @ np.linalg.pinv(start) @ directions
    return carried(id, motion, duration, directions, SCALE_16, filter_interval=interval), expected


@pytest.mark.parametrize("id", ["aqe-ekf", "aqe-sukf"])
def test_transition_of_the_16_states(id):
    """What is left out: Earth's rate by position; horizontal position by height; wander by position."""
    found, expected = transition_16(id, FLIGHT, DURATION, 0.25)
    left_out = {("tilt", "position"): 2e-3, ("tilt", "velocity"): 2e-3, ("tilt", "accel"): 1.5e-4}
    left_out |= {("position", "position"): 7e-3, ("position", "velocity"): 7e-3, ("position", "accel"): 4e-4}
    left_out |= {("velocity", "position"): 4e-4}
    compare(found, expected, SCALE_16, ROWS_16, COLUMNS_16, 1.5e-3, left_out)


def test_transition_of_the_16_states_in_one_interval():
    """8 s in one update: each term is integrated over the interval, also into the position; in tilt the main terms."""
    found, expected = transition_16("aqe-ekf", STRAIGHT, 8.0, 8.0)
    compare(found, expected, SCALE_16, ROWS_16, COLUMNS_16, 0.02, {("tilt", "accel"): 5e-5, ("tilt", "position"): 1e-4})


@pytest.mark.parametrize("id", ["wander-sins", "loosely-coupled", "smoother", "aqe-ekf", "aqe-sukf"])
def test_mechanization_in_w(id):
    """The motion comes back from its increments; normal gravity, which has a north component above the ellipsoid."""
    _, _, C_ew, (r, v, C) = truth(FLIGHT, DURATION)
    state = navigated(id, FLIGHT, DURATION)
    found = matrix_of(state["q_ew"])
    assert np.abs(found - C_ew).max() < 5e-8
    assert np.abs(found @ state["velocity_w"] - v).max() < 2e-3
    assert np.abs(found @ matrix_of(state["q_wb"]) - C).max() < 5e-8
    assert abs(state["height"] - earth_fixed.geodetic(r)[2]) < 0.01
    assert np.linalg.norm(earth_fixed.frame_n(r)[:, 2] - found[:, 2]) * 6.4e6 < 0.2


def test_mechanization_in_e():
    """Also its place, which it extrapolates from fix to fix: here over the whole flight."""
    r, v, C = truth(FLIGHT, DURATION)[3]
    state = navigated("ecef-kf", FLIGHT, DURATION, **IN_PLACE)
    assert np.abs(state["velocity_e"] - v).max() < 0.02
    assert np.abs(matrix_of(state["q_eb"]) - C).max() < 3e-6  # two samples, 0.05 s
    latitude, longitude, height = earth_fixed.geodetic(r)
    assert np.abs(state["place"] - [latitude, longitude, height])[:2].max() * 6.4e6 < 5.0
    assert abs(state["place"][2] - height) < 3.0


UNIT = dict.fromkeys(("gyro_scale", "gyro_misalignment", "accel_scale", "accel_misalignment"), 1e-5) | {
    "gyro_g_sensitivity": 1e-7
}
SHOWN_IN = {"gyro_scale": 0, "gyro_misalignment": 0, "accel_scale": 1, "accel_misalignment": 1, "gyro_g_sensitivity": 2}
"""Errors of the unit, their sizes, and whether they are errors of the rate by the rate, the force by the force, or both."""


@pytest.mark.parametrize("seed", range(2))
def test_errors_of_the_unit_enter_as_in_an_independent_mechanization(seed):
    """20 s at 250 m/s in a curve: what scale factors, misalignments and g-sensitivity of any sign do together."""
    rng, estimator, duration = np.random.default_rng(seed), fusion(UNIT, ["gnss"], "unit"), 20.0
    errors, own = np.zeros((3, 1, 3, 3)), []
    for name in (name for name in all_states() if name in UNIT):  # in the order of the states
        places = COUPLINGS if name.endswith("misalignment") else [(i, i) for i in range(3)]
        drawn = UNIT[name] * rng.choice([-1.0, 1.0], len(places)) * rng.uniform(0.5, 2.0, len(places))
        for place, value in zip(places, drawn, strict=True):
            errors[(SHOWN_IN[name], 0, *place)] = value
        own += [*drawn]
    both = np.concatenate([errors, -errors], axis=1)
    (r, r_), (v, v_), (C, C_) = earth_fixed.moved(FLIGHT, np.zeros((2, 15)), duration, 0.05, False, *both)
    in_e = np.concatenate([r - r_, v - v_, -Rotation.from_matrix(C @ C_.T).as_rotvec()]) / 2
    expected = (in_e.reshape(3, 3) @ FLIGHT.frame_w(duration)).ravel()
    own, scale = np.concatenate([np.zeros(15), own]), np.concatenate([earth_fixed.SCALE, np.abs(own)])
    found = carried(estimator, FLIGHT, duration, own[:, None], scale, covariance_interval=DT)[:9, 0]
    found = found * np.sign(found @ (expected / earth_fixed.SCALE[:9] ** 2))
    for part in (POSITION, VELOCITY, PHI):
        # the columns take the attitude at the start of each sample, here of 25 ms
        assert np.abs(found[part] - expected[part]).max() < 4e-3 * np.abs(expected[part]).max(), part


def test_the_hand_over_carries_what_biases_do():
    """The balance of specific force and Earth rate in place, against differences of the rates at a misalignment."""
    latitude, g, gyro, accel = 0.8, 9.81, 3e-8, 5e-4
    noise = np.array([1e-5, 2e-5, 3e-4])
    level, heading = accel / g, np.hypot(gyro / (geodesy.OMEGA_IE * np.cos(latitude)), accel / g * np.tan(latitude))
    sigma = np.sqrt(noise**2 + np.array([level, level, heading]) ** 2)
    found = aligned(ca.DM(sigma), latitude, g, gyro, accel)
    P, by_accel, by_gyro = (np.array(ca.evalf(part)) for part in dataclasses.astuple(found))
    assert np.diag(P) == pytest.approx(sigma**2, rel=1e-9)
    f, omega = np.array([0, 0, -g]), geodesy.OMEGA_IE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    for axis in range(3):
        phi = by_accel[:, axis] / accel  # the misalignment that this bias causes
        assert (np.cross(f, phi) + np.eye(3)[axis] * accel)[:2] == pytest.approx(0, abs=1e-12)
        assert np.cross(omega, phi)[1] == pytest.approx(0, abs=1e-15)
        phi = by_gyro[:, axis] / gyro
        assert (np.cross(omega, phi) + np.eye(3)[axis] * gyro)[1] == pytest.approx(0, abs=1e-15)


def test_what_is_unknown_about_the_vertical_of_the_platform_stays_so():
    """The platform is found 5 deg off level: the unknown heading is about its vertical before, and about the new one after."""
    psi = np.radians([4.0, -3.0, 0.0])
    before = Rotation.from_rotvec(psi).inv().apply([0.0, 0.0, 1.0])
    P = np.zeros((12, 12))
    P[TILT, TILT] = np.outer(before, before)
    P[TILT, 10] = P[10, TILT] = 0.1 * before
    update = Update((), ca.vertcat(ca.SX.zeros(6), psi, ca.SX.zeros(3)), symmetric.triangle(ca.SX(P)))
    after = np.array(ca.DM(symmetric.full(covariance_after(update, 12), 12)))
    wanted = np.zeros((12, 12))
    wanted[8, 8], wanted[8, 10], wanted[10, 8] = 1.0, 0.1, 0.1
    assert after == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("filter", ["loosely-coupled", "fusion"])
def test_a_parked_car_learns_no_heading_from_being_level(monkeypatch, filter):
    """The told attitude is 0.5 deg off level and 3 deg off in heading; zero velocities and fixes level the unit."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    for seed in (1, 2):
        (result,) = insenv.run(changed("car-city-drive", rate_hz=60.0), filter, seed=seed, duration_s=31.0).results
        assert result.sigma["heading_deg"][-1] > 0.9 * result.limit_sigma["heading_deg"][-1]
        assert abs(result.errors["heading_deg"][-1]) < 3 * result.sigma["heading_deg"][-1]


@pytest.mark.slow
def test_a_heading_30_deg_off_is_found_while_driving(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    known = {"heading_sigma_deg": 30.0, "heading_error_deg": 30.0}
    scenario = changed("car-unknown-heading", knowledge=known, rate_hz=60.0)
    found = [insenv.run(scenario, "loosely-coupled", seed=seed, duration_s=60.0).results[0] for seed in range(300, 308)]
    errors = np.abs([result.errors["heading_deg"][-1] for result in found])
    assert np.median(errors) < 0.4
    assert (errors < 3.5 * np.array([result.sigma["heading_deg"][-1] for result in found])).all()
