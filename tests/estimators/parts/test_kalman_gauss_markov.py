"""Process noise of the filters against closed forms: Gauss-Markov biases, white noise, errors of manoeuvres, start."""

import numpy as np
import pytest
from earth_fixed import tangent
from scipy.spatial.transform import Rotation

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.scenario.chunks import input_rows

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
    given = {name: value for name, value in {**SETTINGS[id], **NONE, **parameters}.items() if name in model.parameters}
    runner = make_runner(model, given, "interpreter")
    rows = {"covariance": np.zeros(model.state["covariance"].size), **({"fix_sigma": 1.0} if id == "ecef-kf" else {})}
    runner.x[:] = model.state.pack(rows, base=runner.x)
    columns = {
        "delta_angle": np.tile(np.multiply(rate, DT), (count, 1)),
        "delta_velocity": np.tile(np.multiply(force, DT), (count, 1)),
    }
    runner.run(count, input_rows(model, columns | {"dt": np.full(count, DT)}, count), 0)
    n = {"ecef-kf": 12, "aqe-ekf": 16, "aqe-sukf": 16}.get(id, 15)
    return symmetric.full_array(runner.state["covariance"], n), runner.state


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


@pytest.mark.parametrize(
    ("id", "interval", "near"), [*((id, {}, 0.03) for id in IDS), *((id, {"filter_interval": 8.0}, 1e-3) for id in QUATERNION)]
)
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
