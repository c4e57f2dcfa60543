"""Feedback, outputs and slowly varying fixes of the filters, against vectors in e and exact least squares; process noise."""

from functools import cache

import casadi as ca
import earth_fixed
import navigation
import numpy as np
import pytest
from driven import fed, of_model, outputs_of
from earth_fixed import ACCEL, GYRO, PHI, POSITION, VELOCITY, matrix_of, quaternion_of, stored, tangent
from resting import samples
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import aqe, get
from insenv.estimators.parts import kalman

MOTION, WANDER = earth_fixed.Motion(latitude=-0.7, speed=180.0), 0.8


def about_down(angle):
    return Rotation.from_euler("z", angle).as_matrix()


@cache
def true_motion():
    """r, v, C_eb of the motion at some time, and C_ew there with a wander angle."""
    r = MOTION.position(7.0)
    return r, MOTION.velocity(7.0), MOTION.attitude(7.0), earth_fixed.frame_n(r) @ about_down(WANDER)


def rows_in_w(r, v, C_eb, C_ew):
    """Rows of a navigation state in a wander-azimuth frame."""
    rows = {"q_wb": quaternion_of(C_ew.T @ C_eb), "velocity_w": C_ew.T @ v, "q_ew": quaternion_of(C_ew)}
    return rows | {"height": earth_fixed.geodetic(r)[2]}


def shifted(error):
    """r, v, C_eb, C_ew of an estimate with errors in e (15): the frame w is carried along with the vertical."""
    r, v, C, C_ew = true_motion()
    before, after = C_ew[:, 2], earth_fixed.frame_n(r + error[POSITION])[:, 2]
    carried = Rotation.from_rotvec(np.cross(before, after)).as_matrix() @ C_ew
    return r + error[POSITION], v + error[VELOCITY], Rotation.from_rotvec(-error[PHI]).as_matrix() @ C, carried


def as_vectors(state):
    """r, v (e), C_eb of a state in w."""
    C_ew = matrix_of(state["q_ew"])
    latitude, longitude, _ = geodesy.numeric.geodetic_from_q_ew(state["q_ew"])
    r = geodesy.numeric.geodetic_to_ecef(latitude, longitude, state["height"])
    return r, C_ew @ state["velocity_w"], C_ew @ matrix_of(state["q_wb"])


def error_of(seed):
    rng = np.random.default_rng(seed)
    return rng.normal(size=15) * np.repeat([300.0, 2.0, 1e-3, 1e-5, 1e-3], 3)


def check_truth(state, error):
    """The state is the true motion, but for products of two errors."""
    r, v, C, _ = true_motion()
    found = as_vectors(state)
    assert np.abs(found[0] - r).max() < 0.02
    assert np.abs(found[1] - v).max() < 2e-4
    assert np.abs(found[2] - C).max() < 5e-6
    assert np.allclose(state["gyro_bias"], error[GYRO]) and np.allclose(state["accel_bias"], error[ACCEL])


@pytest.mark.parametrize("seed", range(2))
def test_feedback_of_the_15_states_returns_to_the_truth(seed):
    error = error_of(seed)
    r, v, C, C_ew = shifted(error)
    given = np.concatenate([*(C_ew.T @ error[part] for part in (POSITION, VELOCITY, PHI)), error[9:]])
    after = navigation.FUNCTIONS["fed_back"](navigation.MODEL.state.pack(rows_in_w(r, v, C, C_ew)), given).full().ravel()
    check_truth(navigation.MODEL.state.unpack(after), error)


@pytest.mark.parametrize("height_m", [0.0, 1e5])
@pytest.mark.parametrize("id", ["loosely-coupled", "fusion", "aqe-sukf"])
def test_a_fix_after_a_long_outage_returns_the_position(id, height_m):
    """100 km off, and a height of 100 km too, as stated: less than 10 m of that are left, and 3 m of the height."""
    model = get(id).model
    sigma = {"position_sigma": (1e6, 1e6, 1e6), "velocity_sigma": 10.0, "tilt_sigma": 0.01, "heading_sigma": 0.01}
    start = {"start_latitude": 0.9, "start_longitude": 0.3, "start_height": height_m, "start_velocity_n": np.zeros(3)}
    runner = make_runner(model, start | sigma, "interpreter")
    latitude, longitude, _ = geodesy.numeric.geodetic_from_ned_offset(np.array([7e4, 7e4, 0.0]), 0.9, 0.3, 0.0)
    fix = {"gnss_valid": 1.0, "gnss_latitude": latitude, "gnss_longitude": longitude, "gnss_height": 0.0}
    fix |= {"gnss_position_sigma": np.full(3, 0.01), "gnss_velocity_sigma": np.full(3, 0.1)}
    sample = {"delta_angle": np.zeros(3), "delta_velocity": np.array([0.0, 0.0, -0.0982]), "dt": 0.01}
    runner.advance({name: value for name, value in (sample | fix).items() if name in model.inputs})
    found = runner.outputs()
    place = found["latitude"], found["longitude"], found["height"]
    error = geodesy.numeric.position_error(*place, latitude, longitude, 0.0)
    assert np.hypot(*error[:2]) < 10.0 and abs(error[2]) < 3.0


@pytest.mark.parametrize(("n", "size"), [(12, 1e-5), (15, 1e-5), (15, 1.0)])
def test_propagation_is_a_congruence_and_first_order_exact(n, size):
    """(1 + A) P (1 + A)^T + Q of the stored triangle; of a small A that of exp(A), of a large one a covariance too."""
    rng = np.random.default_rng(1)
    L, A, noise = rng.normal(size=(n, n)), rng.normal(size=(n, n)) * size, rng.uniform(size=n) * size
    P = L @ L.T
    found = kalman.propagate(symmetric.triangle(ca.SX(ca.DM(P))), ca.sparsify(ca.SX(ca.DM(A))), ca.SX(ca.DM(noise)))
    found = symmetric.full_array(np.array(ca.DM(ca.evalf(found))).ravel(), n)
    assert np.linalg.eigvalsh(found).min() > 0
    if size < 1.0:
        assert np.abs(found - expm(A) @ P @ expm(A).T - np.diag(noise)).max() < 1e-7 * np.abs(P).max()


def test_scalar_measurements_one_after_another_are_the_joint_update():
    """Both forms of the update against Kalman's equations for three correlated measurements; a refused one is left out."""
    rng = np.random.default_rng(8)
    L, H, z, variance = rng.normal(size=(5, 5)), rng.normal(size=(3, 5)), rng.normal(size=3), rng.uniform(0.5, 2.0, 3)
    P = L @ L.T
    for used in ([0, 1, 2], [0, 2]):
        S = H[used] @ P @ H[used].T + np.diag(variance[used])
        K = P @ H[used].T @ np.linalg.inv(S)
        triangle, full, one, other = symmetric.triangle(ca.SX(ca.DM(P))), ca.SX(ca.DM(P)), ca.SX.zeros(5), ca.SX.zeros(5)
        for i in range(3):
            row, accept = ca.SX(ca.DM(H[i : i + 1])), float(i in used)
            triangle, one, _ = kalman.measure(triangle, one, row, z[i], variance[i], accept)
            full, other, _ = kalman.measure_joseph(full, other, row, z[i], variance[i], accept)
        for found in (one, other):
            assert np.allclose(np.array(ca.DM(ca.evalf(found))).ravel(), K @ z[used], rtol=1e-9, atol=1e-12)
        for found in (symmetric.full(triangle, 5), full):
            assert np.allclose(np.array(ca.DM(ca.evalf(found))), P - K @ H[used] @ P, rtol=1e-8, atol=1e-10)


@cache
def fused():
    """`aqe.fused` with 15 measurements as a function of the state, innovations, sensitivities and variances."""
    model = get("aqe-ekf").model
    x, z, H, variance = ca.SX.sym("x", model.state.size), ca.SX.sym("z", 15), ca.SX.sym("H", 15, 16), ca.SX.sym("r", 15)
    named = model.state.symbols(x)
    changed, _ = aqe.fused(named, z, H, variance, [1] * 15)
    return model, ca.Function("fused", [x, z, H, variance], [model.state.assemble({**vars(named), **changed})])


def directions(q):
    """16 x 15: rotation vector in w, biases, velocity, position, as errors of a state with attitude q."""
    into = np.zeros((16, 15))
    into[:4, :3] = tangent(q) / 2
    into[4:, 3:] = np.eye(12)
    return into


@pytest.mark.parametrize("seed", range(2))
def test_feedback_of_the_16_states_returns_to_the_truth(seed):
    """All errors measured: attitude and velocity relative to the computed frame, which the position error turns."""
    error = error_of(seed)
    r, v, C, C_ew = shifted(error)
    true = true_motion()
    w = true[3]
    q, q_true = quaternion_of(C_ew.T @ C), quaternion_of(w.T @ true[2])
    q_true = q_true if q @ q_true > 0 else -q_true
    model, function = fused()
    D = directions(q)
    P = D @ np.diag(np.repeat([1e-2, 1e-6, 1e-2, 1e2, 1e6], 3)) @ D.T
    state = rows_in_w(r, v, C, C_ew) | {"q_wb": q, "covariance": stored(P)}
    H = np.linalg.pinv(D)
    dQ = q - q_true
    full = np.concatenate([dQ, error[GYRO], error[ACCEL], C_ew.T @ v - w.T @ true[1], w.T @ error[POSITION]])
    after = function(model.state.pack(state), H @ full, H, np.full(15, 1e-20)).full().ravel()
    check_truth(model.state.unpack(after), error)


@pytest.mark.parametrize("seed", range(2))
def test_feedback_turns_the_covariance_with_the_estimate(seed):
    """Seen in the axes of the estimated body it is what Kalman's equations give, however far the attitude turns."""
    rng = np.random.default_rng(seed)
    model, function = fused()
    r, v, C, C_ew = true_motion()
    q = quaternion_of(C_ew.T @ C)
    L = rng.normal(size=(15, 15)) * np.repeat([0.3, 1e-4, 1e-2, 1.0, 30.0], 3)[:, None]
    D = directions(q)
    P = D @ L @ L.T @ D.T
    H = rng.normal(size=(15, 15)) / np.repeat([0.3, 1e-4, 1e-2, 1.0, 30.0], 3) @ np.linalg.pinv(D)
    H[4:] = 0.0  # four measurements
    variance = np.full(15, 0.5)
    z = rng.normal(size=15)
    state = rows_in_w(r, v, C, C_ew) | {"covariance": stored(P)}
    after = model.state.unpack(function(model.state.pack(state), z, H, variance).full().ravel())
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(variance))
    expected, found = P - K @ H @ P, symmetric.full_array(after["covariance"], 16)
    assert abs(after["q_wb"] @ q) < np.cos(0.01)  # the attitude has turned by a degree and more

    def in_body(q):
        """15 x 16: rotation, velocity and position in the axes of the body with attitude q."""
        into = np.linalg.pinv(directions(q))
        for part in (slice(0, 3), slice(9, 12), slice(12, 15)):
            into[part] = matrix_of(q).T @ into[part]
        return into

    one, other = in_body(after["q_wb"]) @ found @ in_body(after["q_wb"]).T, in_body(q) @ expected @ in_body(q).T
    scale = np.sqrt(np.diag(other))
    assert np.abs((one - other) / np.outer(scale, scale)).max() < 1e-6


@pytest.mark.parametrize("id", ["loosely-coupled", "smoother", "aqe-ekf", "aqe-sukf"])
def test_outputs_are_turned_by_the_wander_angle(id):
    """Attitude, velocity and standard deviations in n of a state whose frame is turned by a wander angle."""
    rng, model = np.random.default_rng(4), get(id).model
    r, v, C, C_ew = true_motion()
    rows, C_nw = rows_in_w(r, v, C, C_ew), about_down(WANDER)
    L = rng.normal(size=(15, 15)) * np.repeat([1e-3, 1e-5, 1e-3, 0.3, 5.0], 3)[:, None]
    own = L @ L.T
    if id.startswith("aqe"):
        D = directions(rows["q_wb"])
        P, blocks = D @ own @ D.T, {"attitude": slice(0, 3), "velocity": slice(9, 12), "position": slice(12, 15)}
    else:
        P, blocks = own, {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9)}
    state = model.state.pack(rows | {"covariance": stored(P)})
    shown = outputs_of(model, state)
    C_en = earth_fixed.frame_n(r)
    assert np.allclose(shown["velocity_n"], C_en.T @ v, atol=1e-7)
    assert np.allclose(matrix_of(shown["q_nb"]), C_en.T @ C, atol=1e-9)
    assert np.allclose([shown["latitude"], shown["longitude"], shown["height"]], earth_fixed.geodetic(r), rtol=0, atol=1e-6)
    for name, block in blocks.items():
        assert np.allclose(shown[f"{name}_sigma"], np.sqrt(np.diag(C_nw @ own[block, block] @ C_nw.T)), rtol=1e-9), name


@pytest.mark.parametrize("id", ["loosely-coupled", "smoother", "aqe-ekf", "aqe-sukf"])
@pytest.mark.parametrize(("count", "interval", "age"), [(1, 1.0, 0.0), (8, 1.0, 0.0), (8, 5.0, 0.0), (8, 1.0, 0.4)])
def test_fixes_with_a_slow_error_have_the_information_of_least_squares(id, count, interval, age):
    """A place at rest from fixes whose whole error is a Gauss-Markov process: 1 / (1^T R^-1 1), R = s^2 exp(-|t| / T).

    The age of the fixes does not matter: they are as far apart as their epochs.
    """
    sigma, time, dt, model = 2.0, 4.0, 0.1, get(id).model
    known = {
        "position_sigma": 1e4, "velocity_sigma": 0.0, "tilt_sigma": 0.0, "heading_sigma": 0.0, "gyro_bias_sigma": 0.0,
        "accel_bias_sigma": 0.0, "angle_random_walk": 0.0, "velocity_random_walk": 0.0, "innovation_gate": 0.0,
        "fix_wander_sigma": sigma, "fix_wander_time": time, "standing_window": 0.0, "start_latitude": 0.5,
    }  # fmt: skip
    every = round(interval / dt)
    n = every * count
    columns = samples([1.0, 0, 0, 0], 0.5, n * dt, dt) | {"gnss_valid": (np.arange(1, n + 1) % every == 0).astype(float)}
    columns |= {"gnss_age": np.full(n, age), "gnss_latitude": np.full(n, 0.5), "gnss_position_sigma": np.full((n, 3), sigma)}
    found = fed(model, columns, of_model(model, known), "interpreter").outputs()
    at = interval * np.arange(count)
    R = sigma**2 * np.exp(-np.abs(at[:, None] - at) / time)
    expected = 1 / np.sqrt(np.linalg.inv(R).sum())
    assert np.allclose(found["position_sigma"], expected, rtol=0.002)


DT = 0.05
LEVEL = np.array([0.0, 0.0, -9.8])
PLACES = {
    "loosely-coupled": {
        "position": slice(0, 3), "velocity": slice(3, 6), "tilt": slice(6, 9), "gyro": slice(9, 12), "accel": slice(12, 15),
    },
    "ecef-kf": {"velocity": slice(0, 3), "tilt": slice(3, 6), "accel": slice(6, 9), "gyro": slice(9, 12)},
    "aqe-ekf": {"gyro": slice(4, 7), "accel": slice(7, 10), "velocity": slice(10, 13), "position": slice(13, 16)},
}  # fmt: skip
PLACES |= {"smoother": PLACES["loosely-coupled"], "aqe-sukf": PLACES["aqe-ekf"]}
IDS, QUATERNION = list(PLACES), ("aqe-ekf", "aqe-sukf")
SETTINGS = {
    "loosely-coupled": {"covariance_interval": 0.05, "standing_window": 0.0},
    "smoother": {"covariance_interval": 0.05, "standing_window": 0.0},
    "ecef-kf": {"moving": 1.0, "coarse_time": 0.0, "update_interval": 0.1},
    "aqe-ekf": {"filter_interval": 1.0},
    "aqe-sukf": {"filter_interval": 1.0},
}
NONE = dict.fromkeys(("angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma"), 0.0)


def grown(id, seconds, rate=(0.0, 0.0, 0.0), force=LEVEL, **parameters):
    """Covariance after some time from 0: nothing is uncertain at the start; and the state."""
    model, count = get(id).model, round(seconds / DT)
    given = of_model(model, {**SETTINGS[id], **NONE, **parameters})
    rows = {"covariance": np.zeros(model.state["covariance"].size), **({"fix_sigma": 1.0} if id == "ecef-kf" else {})}
    columns = {"delta_angle": np.tile(np.multiply(rate, DT), (count, 1)), "dt": np.full(count, DT)}
    columns["delta_velocity"] = np.tile(np.multiply(force, DT), (count, 1))
    state = fed(model, columns, given, "interpreter", **rows).state
    n = {"ecef-kf": 12, "aqe-ekf": 16, "aqe-sukf": 16}.get(id, 15)
    return symmetric.full_array(state["covariance"], n), state


def tilt_of(id, P, state):
    """Covariance of the misalignment in the frame of the filter (3x3)."""
    if not id.startswith("aqe"):
        return P[PLACES[id]["tilt"], PLACES[id]["tilt"]]
    return 4 * tangent(state["q_wb"]).T @ P[:4, :4] @ tangent(state["q_wb"])


@pytest.mark.parametrize("id", IDS)
def test_bias_variances_are_those_of_gauss_markov_processes(id):
    """s^2 (1 - exp(-2 t / T)) with a T for each triad, long before it levels off."""
    seconds, gyro, accel = 4.0, (2e-5, 200.0), (3e-3, 500.0)
    P, _ = grown(id, seconds, gyro_bias_sigma=gyro[0], gyro_correlation_time=gyro[1], accel_bias_sigma=accel[0],
                 accel_correlation_time=accel[1])  # fmt: skip
    for name, (sigma, time) in (("gyro", gyro), ("accel", accel)):
        place = PLACES[id][name]
        expected = sigma**2 * (1 - np.exp(-2 * seconds / time)) * np.eye(3)
        assert np.abs(P[place, place] - expected).max() < 0.03 * expected[0, 0]


@pytest.mark.parametrize(("id", "interval", "near"),
    [*((id, {}, 0.03) for id in IDS), *((id, {"filter_interval": 8.0}, 1e-3) for id in QUATERNION)])  # fmt: skip
def test_white_noise_of_the_accelerometers_is_integrated_once_and_twice(id, interval, near):
    """Also within one update of 8 s, whatever is integrated inside."""
    T, V = 8.0, 3e-3
    P, _ = grown(id, T, velocity_random_walk=V, **interval)
    velocity, position = PLACES[id]["velocity"], PLACES[id].get("position")
    pairs = [(velocity, velocity, T)] + ([(position, velocity, T**2 / 2), (position, position, T**3 / 3)] if position else [])
    for order, (rows, columns, size) in enumerate(pairs, 1):
        assert np.allclose(P[rows, columns], V**2 * size * np.eye(3), rtol=0, atol=near * order / 3 * V**2 * size)


@pytest.mark.parametrize("id", IDS)
def test_white_noise_of_the_gyros_turns_the_attitude(id):
    seconds, N = 8.0, 2e-4
    P, state = grown(id, seconds, angle_random_walk=N)
    assert np.allclose(tilt_of(id, P, state), N**2 * seconds * np.eye(3), rtol=0, atol=0.01 * N**2 * seconds)


@pytest.mark.parametrize("id", ["loosely-coupled", "smoother"])
def test_errors_of_manoeuvres_have_the_size_of_one_coherent_manoeuvre(id):
    """A turn by 1 rad leaves rotation_error x 1 rad of tilt, a change of 10 m/s thrust_error x 10 m/s of velocity."""
    P, state = grown(id, 4.0, rate=(0.0, 0.0, 0.25), rotation_error=1e-3)
    assert np.allclose(np.sqrt(np.diag(tilt_of(id, P, state))), 1e-3, rtol=0.01)
    P, _ = grown(id, 4.0, force=LEVEL + [2.5, 0.0, 0.0], thrust_error=1e-3)
    assert np.allclose(np.sqrt(np.diag(P)[PLACES[id]["velocity"]]), 1e-2, rtol=0.02)


@pytest.mark.parametrize("sigma", [1e-3, 0.3, 1.2])
def test_start_covariance_of_a_quaternion_error(sigma):
    """E[sin^2(phi / 2)] of a normal phi, by Gauss's quadrature; heading about Down."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    expected = [weights @ np.sin(s * nodes / 2) ** 2 / weights.sum() for s in (0.1 * sigma, sigma)]
    model = get("aqe-ekf").model
    angles = {"start_roll": 0.3, "start_pitch": -0.5, "start_heading": 2.0}
    runner = make_runner(model, {"tilt_sigma": 0.1 * sigma, "heading_sigma": sigma, **angles}, "interpreter")
    P = symmetric.full_array(runner.state["covariance"], 16)
    true = Rotation.from_euler("ZYX", [2.0, -0.5, 0.3]).as_quat(scalar_first=True)
    assert np.allclose(runner.state["q_wb"], true, atol=1e-12)
    found = tilt_of("aqe-ekf", P, runner.state) / 4
    assert np.allclose(found, np.diag([expected[0], expected[0], expected[1]]), rtol=0, atol=1e-9 + 1e-6 * expected[1])


LATITUDE = 0.5
FADING = {"gyro_bias_sigma": 1e-7, "accel_bias_sigma": 1e-4, "gyro_correlation_time": 600.0, "accel_correlation_time": 200.0}


@pytest.mark.parametrize("id", [id for id in IDS if id != "ecef-kf"])
def test_without_measurements_a_bias_keeps_its_variance_and_its_estimate_fades(id):
    """At rest without a fix: variance sigma^2 as at the start, estimate exp(-t / time) of that at the start."""
    gyro, accel, n = PLACES[id]["gyro"], PLACES[id]["accel"], 16 if id in QUATERNION else 15
    still = {} if id in QUATERNION else {"standing_window": 0.0}  # no detection of rest
    start = {"start_gyro_bias": (3e-7, 0, 0), "start_accel_bias": (0, 2e-4, 0), "start_latitude": LATITUDE}
    model, g = get(id).model, float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))
    inputs = model.inputs.pack({"delta_angle": geodesy.numeric.earth_rate_n(LATITUDE), "delta_velocity": (0, 0, -g), "dt": 1.0})
    runner = make_runner(model, {**FADING, **still, **start}, "interpreter")
    for seconds, done in ((600, 600.0), (6600, 7200.0)):
        runner.run(seconds, inputs, 0)
        P = symmetric.full_array(runner.state["covariance"], n)
        assert np.allclose(np.diag(P[gyro, gyro]), 1e-14, rtol=1e-9) and np.allclose(np.diag(P[accel, accel]), 1e-8, rtol=1e-9)
        assert np.allclose(runner.state["gyro_bias"][0], 3e-7 * np.exp(-done / 600.0), rtol=1e-9)
        assert np.allclose(runner.state["accel_bias"][1], 2e-4 * np.exp(-done / 200.0), rtol=1e-9)
