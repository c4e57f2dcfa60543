"""A day of simulated time leaves covariances positive definite; a replayed recording is bit-identical to the run."""

import numpy as np
import pytest

from insenv import attitude, geodesy, replay
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.estimators.parts import quaternion_error
from insenv.plant.feeding import input_rows
from insenv.runs.follower import Follower
from insenv.runs.replay_start import COURSE_SIGMA
from insenv.scenario import build, load

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


@pytest.fixture(scope="module")
def recorded():
    """(plant, columns by name) of a minute of sway; its interval is a binary fraction, exact in time stamps."""
    plant = build(load("ship-swaying").model_copy(update={"rate_hz": 64.0}), seed=9, duration_s=60.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    return plant, columns


ALIGNMENTS = ["q-method", "qakf-improved", "ecef-kf", "gyrocompass", "inertial-fir", "analytic"]


def test_a_replayed_log_is_bit_identical_to_the_run(recorded, tmp_path):
    """Increments written as text and read by `replay`, against the same estimators on the outputs of the plant."""
    plant, columns = recorded
    table = np.column_stack([columns["time"], columns["delta_angle"], columns["delta_velocity"]])
    lines = [",".join(repr(float(value)) for value in row) for row in table]
    (tmp_path / "imu.csv").write_text("t,gx,gy,gz,ax,ay,az\n" + "\n".join(lines) + "\n")
    path = tmp_path / "log.toml"
    path.write_text(
        'title = "recorded"\n[imu]\nfile = "imu.csv"\ntime = "t"\ngrade = "marine"\ngyro = ["gx", "gy", "gz"]\n'
        'accel = ["ax", "ay", "az"]\nkind = "increment"\nstamp = "interval_end"\ngyro_unit = "rad"\naccel_unit = "m/s"\n'
        'axes = "FRD"\n[initial]\nlatitude_deg = 30.0\nlongitude_deg = 114.0\nheading_deg = 30.0\n'
    )
    report = replay(path, ALIGNMENTS)
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


def test_inputs_from_a_file_give_a_bit_identical_run(tmp_path):
    """A drive with fixes: NumPy's file of columns, both backends."""
    plant = build(load("car-city-drive"), seed=4, duration_s=40.0)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    np.savez_compressed(tmp_path / "inputs.npz", **columns)
    with np.load(tmp_path / "inputs.npz") as kept:
        read = dict(kept)
    estimator = get("loosely-coupled")
    runs = []
    for source, backend in ((columns, "native"), (read, "native"), (read, "interpreter")):
        runner = make_runner(estimator.model, estimator.parameters(plant.knowledge), backend)
        runs.append(runner.run(plant.samples, input_rows(estimator.model, source, plant.samples), 100))
    assert np.array_equal(runs[0], runs[1]) and np.array_equal(runs[0], runs[2])
