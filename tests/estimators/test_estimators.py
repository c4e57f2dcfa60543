"""All estimators: one run beside its theoretical limit, covariances after a day, and a replay to the bit."""

import numpy as np
import pytest
from resting import ATTITUDES, at_rest, attitude_error, drawn

import insenv
from insenv import attitude, geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import get, registered
from insenv.estimators.parts import quaternion_error
from insenv.evaluation.limits import closed_forms
from insenv.plant.feeding import input_rows
from insenv.runs.follower import Follower
from insenv.runs.replay_start import COURSE_SIGMA
from insenv.scenario import build, load

NEAR = {  # scenario, duration (s), largest sigma of roll and pitch and of heading at its end, in units of the smallest possible
    "analytic": ("static-ecef", 300.0, 1.1, 1.1),
    "aqe-ekf": ("large-misalignment", 120.0, 1.1, 1.1),
    "aqe-sukf": ("large-misalignment", 120.0, 1.1, 1.1),
    "aqe-sukf-printed": ("large-misalignment", 120.0, 1.1, 1.1),
    "ecef-kf": ("ship-swaying", 240.0, 2.5, 3.0),
    "ecef-kf-printed": ("static-ecef", 300.0, 1.1, 1.1),
    "fusion": ("car-city-drive", 100.0, 1.1, 1.1),
    "gyrocompass": ("car-parked-paper", 600.0, 1.1, 1.9),
    "inertial-fir": ("ship-swaying", 240.0, 3.5, 1.4),
    "loosely-coupled": ("car-city-drive", 100.0, 1.3, 1.3),
    "lssvm": ("large-misalignment", 240.0, 1.2, 1.5),
    "q-method": ("ship-swaying", 240.0, 1.4, 1.5),
    "qakf": ("ship-swaying", 300.0, 5.0, 9.0),
    "qakf-improved": ("ship-swaying", 240.0, 1.4, 1.4),
    "qakf-improved-printed": ("static-ecef", 200.0, 1.1, 1.1),
    "qakf-printed": ("static-ecef", 200.0, 1.1, 1.1),
    "velocity-integration": ("car-unknown-heading", 100.0, 2.5, 2.8),
}
SMOOTHERS = {"smoother": "loosely-coupled", "fusion-smoother": "fusion"}
WITHOUT_SIGMA = ("wander-sins", "wander-sins-plain")


def test_every_estimator_is_beside_its_limit():
    assert sorted([*NEAR, *SMOOTHERS, *WITHOUT_SIGMA]) == sorted(registered())


@pytest.mark.parametrize("id", NEAR)
def test_one_run_is_near_its_limit_and_states_its_error(id):
    """No sigma below what any estimator can have, but for 20 % of the printed filters and of chance; errors of 3.5 sigma."""
    name, seconds, level, heading = NEAR[id]
    (result,) = insenv.run(name, id, seed=7, duration_s=seconds).results
    for channel, most in (("roll_deg", level), ("pitch_deg", level), ("heading_deg", heading)):
        limit, sigma = result.limit_sigma[channel][-1], result.sigma[channel][-1]
        assert 0.8 * limit < sigma < most * limit, channel
        assert abs(result.errors[channel][-1]) < 3.5 * min(sigma, 3.0 * limit), channel


@pytest.mark.parametrize("id", SMOOTHERS)
def test_a_smoother_is_surer_than_its_filter_and_states_its_error(id):
    filter, smoothed = insenv.run("car-city-drive", [SMOOTHERS[id], id], seed=7, duration_s=80.0).results
    middle = len(smoothed.time) // 2
    for channel, error in smoothed.errors.items():
        assert smoothed.sigma[channel][middle] < 1.01 * filter.sigma[channel][middle], channel
        assert abs(error[middle]) < 3.5 * smoothed.sigma[channel][middle], channel
    assert smoothed.sigma["heading_deg"][middle] < 0.9 * filter.sigma["heading_deg"][middle]


@pytest.mark.parametrize("id", WITHOUT_SIGMA)
def test_free_inertial_navigation_drifts_as_its_unit(id):
    (result,) = insenv.run("aircraft-free-inertial", id, seed=7, duration_s=60.0).results
    for channel, error in result.errors.items():
        assert 0.0 < np.abs(error[-1]) < 3.5 * result.limit_sigma[channel][-1], channel


@pytest.mark.slow
@pytest.mark.parametrize(
    ("id", "name", "runs", "seconds", "settings"),
    [
        ("aqe-ekf", "large-misalignment", 8, 120.0, {}),
        ("aqe-sukf", "large-misalignment-extreme", 8, 120.0, {}),
        ("aqe-sukf", "aircraft-inflight-alignment", 8, 120.0, {}),
        ("ecef-kf", "ship-swaying", 8, 300.0, {}),
        ("ecef-kf", "ship-irregular-sea", 6, 600.0, {"sway_sigma_mps": 0.3}),
        ("ecef-kf", "ship-underway", 8, 300.0, {"moving": 1}),
        ("inertial-fir", "car-parked-paper", 12, 240.0, {}),
        ("inertial-fir", "ship-moored-paper", 12, 240.0, {}),
        ("inertial-fir", "ship-swaying", 12, 240.0, {}),
        ("lssvm", "large-misalignment-extreme", 8, 200.0, {}),
        ("q-method", "aircraft-parked", 8, 300.0, {}),
        ("q-method", "car-parked", 8, 300.0, {}),
        ("q-method", "ship-swaying", 16, 300.0, {}),
        ("qakf-improved", "ship-swaying", 16, 300.0, {}),
        ("velocity-integration", "aircraft-inflight-alignment", 16, 120.0, {}),
        ("velocity-integration", "car-unknown-heading", 16, 120.0, {}),
        ("velocity-integration", "ship-at-sea", 16, 240.0, {}),
        ("velocity-integration", "ship-log-alignment", 16, 400.0, {}),
        ("fusion", "ship-log-alignment", 16, 400.0, {}),
        ("fusion", "ship-at-sea", 16, 60.0, {}),
    ],
)
def test_errors_of_many_runs_are_as_stated(id, name, runs, seconds, settings):
    scenario = load(name).model_copy(update={"estimator": {id: settings}})
    found = insenv.campaign(scenario, id, runs, seed=40000, duration_s=seconds)
    courses = [found.courses[channel] for channel in ("roll_deg", "pitch_deg", "heading_deg")]
    rms, stated = (np.array([getattr(course, of)[-1] for course in courses]) for of in ("rms", "stated"))
    assert np.sqrt(np.mean((rms / stated) ** 2)) < 1.5 and rms[2] > 0.15 * stated[2]
    assert (rms < 1.9 * stated).all()


COARSE = {"coarse_time": 90.0, "tilt_sigma": 0.002, "heading_sigma": 0.03, "velocity_random_walk": 1e-5}


@pytest.mark.parametrize("latitude_deg", [-85.0, -40.0, 1.0, 70.0])
@pytest.mark.parametrize(
    ("id", "seconds", "bound", "given"),
    [
        ("analytic", 60.0, 1e-9, {}),
        ("ecef-kf", 120.0, 2e-5, COARSE),
        ("q-method", 120.0, 1e-6, {}),
        ("qakf", 120.0, 1e-4, {"start_quaternion": [0.9, -0.3, 0.2, 0.1]}),
        ("qakf-improved", 120.0, 1e-4, {"start_quaternion": [0.9, -0.3, 0.2, 0.1]}),
    ],
)
def test_any_attitude_in_both_hemispheres(id, seconds, bound, given, latitude_deg):
    latitude = np.radians(latitude_deg)
    for q_nb in [*ATTITUDES, drawn(1), drawn(2)]:
        found = attitude_error(at_rest(id, q_nb, latitude, seconds, parameters=given), q_nb)
        assert np.abs(found).max() < bound, q_nb


@pytest.mark.parametrize("latitude_deg", [-50.0, 28.2, 70.0])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(
    ("id", "seconds", "level"),
    [("analytic", 120.0, 2.5e-7), ("q-method", 120.0, 2.5e-7), ("inertial-fir", 240.0, 1.5e-6), ("gyrocompass", 900.0, 1.5e-6)],
)
def test_errors_from_biases_are_those_of_theory(id, seconds, level, axis, latitude_deg):
    """Body axes north, east and down: equations (42) of the ECEF paper, (15) of the paper on swaying bases."""
    latitude, bias = np.radians(latitude_deg), np.eye(3)[axis]
    given = {"block_samples": 2} if id in ("inertial-fir", "gyrocompass") else {}
    for gyro, accel, near in (
        (
            np.radians(0.008) / 3600 * bias,
            0 * bias,
            3.9e-8 * min(seconds, 250.0) * max(1.0, abs(np.tan(latitude))),
        ),  # its drift
        (0 * bias, 5e-5 * 9.8 * bias, level),  # what the Earth turns in half the time of a mean
    ):
        runner = at_rest(id, [1.0, 0, 0, 0], latitude, seconds, gyro_bias=gyro, accel_bias=accel, parameters=given)
        expected = closed_forms.bias_tilts(gyro, accel, latitude, 0.0)
        assert np.allclose(attitude_error(runner, [1.0, 0, 0, 0]), expected, rtol=0.02, atol=near)


DAY, LATITUDE, HEADING = 86400, 0.6, 0.7


def fixes(count, dt, every):
    """Columns of a vehicle at rest with noisy fixes every `every` samples."""
    rng = np.random.default_rng(1)
    C_nb = attitude.numeric.to_dcm(attitude.numeric.from_euler(0.0, 0.0, HEADING))
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE)
    force = C_nb.T @ [0, 0, -float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))]
    due = np.arange(1, count + 1) % every == 0
    return {
        "delta_angle": rate * dt + rng.normal(size=(count, 3)) * 1e-6 * np.sqrt(dt),
        "delta_velocity": force * dt + rng.normal(size=(count, 3)) * 1e-4 * np.sqrt(dt),
        "dt": np.full(count, dt),
        "gnss_valid": due.astype(float),
        "gnss_latitude": LATITUDE + rng.normal(size=count) / geodesy.A,
        "gnss_longitude": rng.normal(size=count) / geodesy.A / np.cos(LATITUDE),
        "gnss_height": rng.normal(size=count),
        "gnss_position_sigma": np.ones((count, 3)),
        "gnss_velocity_valid": due.astype(float),
        "gnss_velocity_n": rng.normal(size=(count, 3)) * 0.05,
        "gnss_velocity_sigma": np.full((count, 3), 0.05),
        "standing": np.zeros(count),
    }


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


@pytest.mark.parametrize("id", ["loosely-coupled", "aqe-ekf", "aqe-sukf"])
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


def test_a_replayed_log_is_bit_identical_to_the_run(tmp_path):
    """Increments written as text and read by `replay`, against the same estimators on the outputs of the plant."""
    # the interval is a binary fraction, exact in time stamps
    plant = build(load("ship-swaying").model_copy(update={"rate_hz": 64.0}), seed=9, duration_s=20.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    table = np.column_stack([columns["time"], columns["delta_angle"], columns["delta_velocity"]])
    lines = [",".join(repr(float(value)) for value in row) for row in table]
    (tmp_path / "imu.csv").write_text("t,gx,gy,gz,ax,ay,az\n" + "\n".join(lines) + "\n")
    path = tmp_path / "log.toml"
    path.write_text(
        'title = "recorded"\n[imu]\nfile = "imu.csv"\ntime = "t"\ngrade = "marine"\ngyro = ["gx", "gy", "gz"]\n'
        'accel = ["ax", "ay", "az"]\nkind = "increment"\nstamp = "interval_end"\ngyro_unit = "rad"\naccel_unit = "m/s"\n'
        'axes = "FRD"\n[initial]\nlatitude_deg = 30.0\nlongitude_deg = 114.0\nheading_deg = 30.0\n'
    )
    report = insenv.replay(path, ["q-method", "qakf-improved", "ecef-kf", "gyrocompass", "inertial-fir", "analytic"])
    assert report.imu_samples == plant.samples
    known = plant.knowledge.__class__(
        latitude=float(np.radians(30.0)), longitude=float(np.radians(114.0)), height=0.0, sample_interval=plant.sample_interval,
        heading=float(np.radians(30.0)), heading_sigma=COURSE_SIGMA, tilt_sigma=np.pi, sensors=plant.knowledge.sensors,
    )  # fmt: skip
    for result in report.results:
        every = plant.samples // len(result.time)
        follower = Follower.started(get(result.estimator), get(result.estimator).parameters(known), every)
        follower.follow(columns, plant.samples)
        for name, value in follower.named().items():
            assert np.array_equal(value, result.outputs[name]), (result.estimator, name)
