"""All estimators: one run beside its theoretical limit, the errors of many, any attitude, biases, covariances after a day."""

import os
from unittest import mock

import numpy as np
import pytest
from resting import ATTITUDES, at_rest, attitude_error, drawn, samples

import insenv
from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import Knowledge, get, registered
from insenv.estimators.parts import quaternion_error
from insenv.reproduce.unit_limits import bias_tilts
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows

NEAR = {  # scenario, duration (s), largest sigma of roll and pitch and of heading at its end, in units of the smallest possible
    "analytic": ("static-ecef", 300.0, 1.1, 1.1),
    "aqe-ekf": ("large-misalignment", 120.0, 1.1, 1.1),
    "aqe-sukf": ("large-misalignment", 120.0, 1.1, 1.1),
    "aqe-sukf-printed": ("large-misalignment", 120.0, 1.1, 1.1),
    "ecef-kf": ("ship-swaying", 240.0, 2.5, 3.4),
    "ecef-kf-printed": ("static-ecef", 300.0, 1.1, 1.1),
    "fusion": ("car-city-drive", 100.0, 1.1, 1.1),
    "gyrocompass": ("car-parked-paper", 600.0, 1.1, 1.9),
    "inertial-fir": ("ship-swaying", 240.0, 3.5, 1.4),
    "loosely-coupled": ("car-city-drive", 100.0, 1.3, 1.3),
    "lssvm": ("large-misalignment", 240.0, 1.2, 1.5),
    "q-method": ("ship-swaying", 240.0, 1.7, 1.5),
    "qakf": ("ship-swaying", 300.0, 5.0, 9.0),
    "qakf-improved": ("ship-swaying", 240.0, 1.7, 1.4),
    "qakf-improved-printed": ("static-ecef", 200.0, 1.1, 1.1),
    "qakf-printed": ("static-ecef", 200.0, 1.1, 1.1),
    "velocity-integration": ("car-unknown-heading", 100.0, 2.5, 2.8),
}
RATES = {"ship": 20.0, "static": 20.0, "large": 20.0, "car": 60.0, "aircraft": 80.0}
"""Hz, as low as the vibrations of each vehicle allow: interpreted, a run takes less time than to compile its models."""
SMOOTHERS = {"smoother": "loosely-coupled", "fusion-smoother": "fusion"}
WITHOUT_SIGMA = ("wander-sins", "wander-sins-plain")


def test_every_estimator_is_beside_its_limit():
    assert sorted([*NEAR, *SMOOTHERS, *WITHOUT_SIGMA]) == sorted(registered())


def results(name, ids, seconds):
    scenario = load(name).model_copy(update={"rate_hz": RATES[name.split("-")[0]]})
    with mock.patch.dict(os.environ, INSENV_BACKEND="interpreter"):
        return insenv.run(scenario, ids, seed=7, duration_s=seconds).results


@pytest.mark.parametrize("id", [pytest.param(id, marks=pytest.mark.slow) if id == "gyrocompass" else id for id in NEAR])
def test_one_run_is_near_its_limit_and_states_its_error(id):
    """No sigma below what any estimator can have, but for 20 % of the printed filters and of chance; errors of 3.5 sigma."""
    name, seconds, level, heading = NEAR[id]
    (result,) = results(name, id, seconds)
    for channel, most in (("roll_deg", level), ("pitch_deg", level), ("heading_deg", heading)):
        limit, sigma = result.limit_sigma[channel][-1], result.sigma[channel][-1]
        assert 0.8 * limit < sigma < most * limit, channel
        assert abs(result.errors[channel][-1]) < 3.5 * min(sigma, 3.0 * limit), channel


@pytest.mark.parametrize("id", [id for id in registered() if "fix_common_sigma" in get(id).model.parameters])
def test_what_all_fixes_have_in_common_is_part_of_the_stated_position(id):
    """A filter of fixes does not estimate it: it adds to what the filter states, and to nothing else."""
    model, common = get(id).model, np.array([3.0, 4.0, 12.0])
    known = {"start_latitude": 0.7, "tilt_sigma": 0.01, "heading_sigma": 0.1, "position_sigma": 2.0, "velocity_sigma": 0.3}
    known = {name: value for name, value in known.items() if name in model.parameters}
    told = (known, {**known, "fix_common_sigma": common})
    alone, both = (make_runner(model, parameters, "interpreter").outputs() for parameters in told)
    np.testing.assert_allclose(both["position_sigma"] ** 2 - alone["position_sigma"] ** 2, common**2, rtol=1e-9)
    for name in ("velocity_sigma", "attitude_sigma"):
        np.testing.assert_array_equal(both[name], alone[name])


@pytest.mark.parametrize("id", ["smoother", pytest.param("fusion-smoother", marks=pytest.mark.slow)])
def test_a_smoother_is_surer_than_its_filter_and_states_its_error(id):
    filter, smoothed = results("car-city-drive", [SMOOTHERS[id], id], 50.0)
    middle = len(smoothed.time) // 2
    for channel, error in smoothed.errors.items():
        assert smoothed.sigma[channel][middle] < 1.01 * filter.sigma[channel][middle], channel
        assert abs(error[middle]) < 3.5 * smoothed.sigma[channel][middle], channel
    assert smoothed.sigma["heading_deg"][middle] < 0.9 * filter.sigma["heading_deg"][middle]


@pytest.mark.parametrize("id", WITHOUT_SIGMA)
def test_free_inertial_navigation_drifts_as_its_unit(id):
    (result,) = results("aircraft-free-inertial", id, 60.0)
    for channel, error in result.errors.items():
        assert 0.0 < np.abs(error[-1]) < 3.5 * result.limit_sigma[channel][-1], channel


@pytest.mark.parametrize("latitude_deg", [-85.0, -40.0, 1.0, 70.0])
@pytest.mark.parametrize(("id", "seconds", "bound", "given"), [
    ("analytic", 60.0, 1e-9, {}),
    ("ecef-kf", 120.0, 2e-5, {"coarse_time": 90.0, "tilt_sigma": 0.002, "heading_sigma": 0.03, "velocity_random_walk": 1e-5}),
    ("q-method", 120.0, 1e-6, {}),
    ("qakf", 120.0, 1e-4, {"start_quaternion": [0.9, -0.3, 0.2, 0.1]}),
    ("qakf-improved", 120.0, 1e-4, {"start_quaternion": [0.9, -0.3, 0.2, 0.1]}),
])  # fmt: skip
def test_any_attitude_in_both_hemispheres(id, seconds, bound, given, latitude_deg):
    latitude = np.radians(latitude_deg)
    for q_nb in [*ATTITUDES, drawn(1), drawn(2)]:
        found = attitude_error(at_rest(id, q_nb, latitude, seconds, parameters=given), q_nb)
        assert np.abs(found).max() < bound, q_nb


VAGUE = {"tilt_sigma": 0.02, "heading_sigma": 0.2, "gyro_bias_sigma": 5e-8, "accel_bias_sigma": 5e-4}
VAGUE |= {"angle_random_walk": 1e-8, "velocity_random_walk": 1e-6}


@pytest.mark.parametrize("latitude_deg", [-50.0, 70.0])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(  # level: what the Earth turns in half the time of a mean
    ("id", "seconds", "level", "given"),
    [
        ("analytic", 120.0, 2.5e-7, {}), ("q-method", 120.0, 2.5e-7, {}), ("ecef-kf", 300.0, 1e-6, VAGUE),
        ("inertial-fir", 240.0, 1.5e-6, {"block_samples": 2}), ("gyrocompass", 900.0, 1.5e-6, {"block_samples": 2}),
    ],
)  # fmt: skip
def test_errors_from_biases_are_those_of_theory(id, seconds, level, given, axis, latitude_deg):
    """Body axes north, east and down: equations (42) of the ECEF paper, (15) of the paper on swaying bases."""
    latitude, bias = np.radians(latitude_deg), np.eye(3)[axis]
    drifted = 3.9e-8 * min(seconds, 250.0) * max(1.0, abs(np.tan(latitude)))
    for gyro_bias, accel_bias, near in ((np.radians(0.008) / 3600, 0.0, drifted), (0.0, 5e-5 * 9.8, level)):
        gyro, accel = gyro_bias * bias, accel_bias * bias
        runner = at_rest(id, [1.0, 0, 0, 0], latitude, seconds, gyro_bias=gyro, accel_bias=accel, parameters=given)
        expected = bias_tilts(gyro, accel, latitude, 0.0)
        assert np.allclose(attitude_error(runner, [1.0, 0, 0, 0]), expected, rtol=0.02, atol=near)


DAY, LATITUDE, HEADING = 86400, 0.6, 0.7


def fixes(count, dt, every):
    """Columns of a vehicle at rest with noisy fixes every `every` samples."""
    rng = np.random.default_rng(1)
    still = samples(attitude.numeric.from_euler(0.0, 0.0, HEADING), LATITUDE, count * dt, dt)
    due = np.arange(1, count + 1) % every == 0
    return {
        "delta_angle": still["delta_angle"] + rng.normal(size=(count, 3)) * 1e-6 * np.sqrt(dt),
        "delta_velocity": still["delta_velocity"] + rng.normal(size=(count, 3)) * 1e-4 * np.sqrt(dt), "dt": still["dt"],
        "gnss_valid": due.astype(float), "gnss_latitude": LATITUDE + rng.normal(size=count) / geodesy.A,
        "gnss_longitude": rng.normal(size=count) / geodesy.A / np.cos(LATITUDE), "gnss_height": rng.normal(size=count),
        "gnss_position_sigma": np.ones((count, 3)), "gnss_velocity_valid": due.astype(float),
        "gnss_velocity_n": rng.normal(size=(count, 3)) * 0.05, "gnss_velocity_sigma": np.full((count, 3), 0.05),
        "standing": np.zeros(count),
    }  # fmt: skip


def smallest_eigenvalue(id, state):
    """Smallest eigenvalue of the correlation matrix; of the quaternion filters on the tangent of the unit sphere."""
    n = quaternion_error.N if id.startswith("aqe") else 15
    P = symmetric.full_array(state["covariance"], n)
    if n == quaternion_error.N:
        onto = np.zeros((n, n - 1))
        onto[:4, :3] = np.linalg.svd(state["q_wb"][None])[2][1:].T
        onto[4:, 3:] = np.eye(12)
        P = onto.T @ P @ onto
    D = np.sqrt(np.diag(P))
    assert np.isfinite(D).all() and (D > 0).all()
    return np.linalg.eigvalsh(P / np.outer(D, D)).min()


@pytest.mark.parametrize(("id", "n", "q_nb", "noise", "given"), [
    ("qakf", 3, [0.6, 0.0, 0.8, 0.0], 1e-3, {}),
    ("qakf-improved", 3, [0.6, 0.0, 0.8, 0.0], 1e-3, {}),
    ("ecef-kf", 12, [1.0, 0.0, 0.0, 0.0], 0.0, {"angle_random_walk": 1e-9, "velocity_random_walk": 1e-7}),
])  # fmt: skip
def test_a_day_at_rest_keeps_the_covariance_positive_definite(id, n, q_nb, noise, given):
    runner = at_rest(id, q_nb, 0.5, DAY, dt=1.0, parameters=given, accel_noise=noise)
    assert np.linalg.eigvalsh(symmetric.full_array(runner.state["covariance"], n)).min() > 0
    assert np.abs(attitude_error(runner, q_nb)).max() < 1e-4


@pytest.mark.parametrize("id", ["loosely-coupled", "aqe-sukf"])
def test_a_day_keeps_the_covariance_positive_definite(id):
    """One sample per second, a fix every ten, a third of the day with rest instead of fixes; checked every hour."""
    model, dt, hour = get(id).model, 1.0, 3600
    columns = fixes(DAY, dt, 10)
    columns["gnss_valid"][DAY // 3 : DAY * 2 // 3] = 0.0
    # with neither, the vertical channel grows e-fold every 10 minutes: hours of that leave no digits
    columns["standing"][DAY // 3 : DAY * 2 // 3 : 60] = 1.0
    known = {"start_latitude": LATITUDE, "start_heading": HEADING, "heading_sigma": 0.05, "gyro_bias_sigma": 1e-7}
    known |= {"angle_random_walk": 1e-6, "velocity_random_walk": 1e-4, "accel_bias_sigma": 1e-4, "tilt_sigma": 1e-3}
    runner = make_runner(model, known)
    rows = input_rows(model, columns, DAY)
    for begin in range(0, DAY, hour):
        runner.run(hour, rows[begin : begin + hour], 0)
        assert smallest_eigenvalue(id, runner.state) > 1e-9, begin
    moved = runner.outputs()
    assert abs(moved["latitude"] - LATITUDE) * geodesy.A < 5.0
    assert np.abs(moved["velocity_n"]).max() < 0.1


def test_the_former_fields_of_a_receiver_are_read_with_a_warning():
    known = build(load("car-odometer")).knowledge
    for name in ("antenna_lever_arm", "fix_wander_sigma", "fix_wander_time"):
        with pytest.warns(FutureWarning, match=rf"is now Knowledge.instruments\['{name}'\]"):
            assert np.array_equal(getattr(known, name), known.instruments[name])
    with pytest.warns(FutureWarning):
        assert Knowledge(0.1, 0.2, 3.0, 0.01).fix_wander_time == 60.0
    with pytest.raises(AttributeError, match="no attribute 'lever_arm'"):
        _ = known.lever_arm
