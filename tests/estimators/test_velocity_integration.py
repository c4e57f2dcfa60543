"""velocity-integration: exact without errors, an independent reference, its stated accuracy by perturbation and by chance."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from simulated_log import simulated_log

from insenv import attitude, geodesy, record, replay, run, write
from insenv.campaigns.block import run_block
from insenv.campaigns.plan import make_plan
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.estimators import get
from insenv.estimators.velocity_integration import estimator as velocity_integration
from insenv.plant.feeding import input_rows
from insenv.runs.ensemble import ensemble
from insenv.runs.replay_start import initial_knowledge
from insenv.scenario import build, load

ID = "velocity-integration"
MODEL = get(ID).model


def perfect(name, **gnss):
    """A scenario with an inertial unit and a receiver without errors."""
    scenario = load(name)
    imu = scenario.imu.model_copy(update={"grade": "perfect"})
    return scenario.model_copy(update={"imu": imu, "gnss": scenario.gnss.model_copy(update={"grade": "perfect", **gnss})})


@cache
def drive(seconds=70.0):
    """Columns of the drive of `car-unknown-heading` without errors, at 100 Hz, and the lever arm."""
    plant = build(perfect("car-unknown-heading").model_copy(update={"rate_hz": 100.0}), seed=1, duration_s=seconds)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, 0.01)
    return columns, plant.knowledge.antenna_lever_arm


QUIET = {"memory_time": 30.0, "gyro_bias_sigma": 0.0, "accel_bias_sigma": 0.0, "angle_random_walk": 0.0}


def found(columns, arm, **parameters):
    """Attitude (4) at the end of columns, and its stated standard deviations (3, rad)."""
    n = len(columns["dt"])
    runner = make_runner(MODEL, {**QUIET, "antenna_lever_arm": arm, **parameters})
    runner.run(n, input_rows(MODEL, columns, n), 0)
    outputs = runner.outputs()
    return outputs["q_nb"], outputs["attitude_sigma"]


def sharp(columns):
    """The columns with fixes whose noise does not count."""
    return {**columns, "gnss_velocity_sigma": np.full_like(columns["gnss_velocity_sigma"], 1e-6)}


@pytest.mark.parametrize(("latency", "bound"), [(0.0, 5e-4), (0.05, 3e-3), (0.4, 3e-2)])
def test_without_errors_the_attitude_is_exact(latency, bound):
    """From an unknown heading, through S-turns, with a lever arm: what is left is the extrapolation of a late fix."""
    e = ensemble(perfect("car-unknown-heading", latency_s=latency), [ID], [1], records=24)
    errors = np.abs(e.attitude_errors_deg(ID)[0, e.time >= 45.0])
    assert errors[:, :2].max() < 0.1 * bound and errors[:, 2].max() < bound


def test_a_lever_arm_that_is_left_out_shows():
    columns, arm = drive()
    right, wrong = (found(columns, a)[0] for a in (arm, np.zeros(3)))
    error = [np.degrees(np.abs(attitude.numeric.error_rotation_vector(q, columns["q_nb"][-1]))[2]) for q in (right, wrong)]
    assert error[0] < 5e-3 and error[1] > 0.05


def test_against_the_formula_of_the_paper_in_the_navigation_frame():
    """Wu and Pan's vectors in n at the start, with the transport rate, and SciPy's solution of Wahba's problem."""
    scenario = perfect("aircraft-inflight-alignment", latency_s=0.0, lever_arm_m=[0.0, 0.0, 0.0])
    plant = build(scenario, seed=1, duration_s=120.0)
    c = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    dt = plant.sample_interval
    C_ib, alpha, C_n0n, part = Rotation.identity(), np.zeros(3), Rotation.identity(), np.zeros(3)
    alphas, betas, rate, before, last = [], [], np.zeros(3), 0.0, np.zeros(3)
    for k in range(plant.samples):
        turn = Rotation.from_rotvec(c["delta_angle"][k])
        alpha = alpha + (C_ib * Rotation.from_rotvec(c["delta_angle"][k] / 2)).apply(c["delta_velocity"][k])
        C_ib = C_ib * turn
        if not c["gnss_valid"][k]:
            continue
        latitude, height, v = c["gnss_latitude"][k], c["gnss_height"][k], c["gnss_velocity_n"][k]
        earth = geodesy.numeric.earth_rate_n(latitude)
        over = earth + geodesy.numeric.transport_rate_n(v, latitude, height)
        step = (k + 1) * dt - before
        C_n0n = C_n0n * Rotation.from_rotvec((rate if alphas else over) * step / 2 + over * step / 2)
        gravity = np.array([0.0, 0.0, float(geodesy.numeric.normal_gravity(np.sin(latitude), height))])
        now = C_n0n.apply(np.cross(earth, v) - gravity)
        part = part + (last + now) * step / 2 if alphas else np.zeros(3)
        last, rate, before = now, over, (k + 1) * dt
        alphas.append(alpha)
        betas.append(C_n0n.apply(v) + part)
    alphas, betas = np.array(alphas), np.array(betas)
    Q, _ = Rotation.align_vectors(betas - betas.mean(axis=0), alphas - alphas.mean(axis=0))
    expected = C_n0n.inv() * Q * C_ib
    arm = {"memory_time": 1e9, "antenna_lever_arm": np.zeros(3)}
    runner = make_runner(MODEL, {**QUIET, **arm})
    runner.run(plant.samples, input_rows(MODEL, {**c, "dt": np.full(plant.samples, dt)}, plant.samples), 0)
    q = runner.outputs()["q_nb"]
    apart = (Rotation.from_quat(q[[1, 2, 3, 0]]) * expected.inv()).as_rotvec()
    assert np.degrees(np.abs(apart)).max() < 2e-3
    error = attitude.numeric.error_rotation_vector(q, c["q_nb"][-1])
    assert np.degrees(np.abs(error)).max() < 2e-3


@pytest.mark.parametrize(
    ("row", "sigma"),
    [("gyro_bias_sigma", 2e-6), ("accel_bias_sigma", 1e-3), ("antenna_lever_arm_sigma", 0.05), ("gnss_delay_sigma", 0.01)],
)
def test_what_a_constant_error_does_is_what_is_stated(row, sigma):
    """Each component of the error in turn, in the data: the root of the sum of the squares is the stated sigma."""
    columns, arm = drive(46.0)  # in a turn: the answer is new, and the noise of the fixes decides that
    columns = {**columns, "gnss_velocity_sigma": np.full_like(columns["gnss_velocity_sigma"], 0.05)}
    told = {row: np.full(3, sigma) if row == "antenna_lever_arm_sigma" else sigma}

    def perturbed(i, size):
        if row == "gnss_delay_sigma":
            return found({**columns, "gnss_age": columns["gnss_age"] - size}, arm, **told)[0]
        if row == "antenna_lever_arm_sigma":
            late = 5  # samples
            swing = attitude.numeric.rotate(columns["q_nb"], np.cross(columns["delta_angle"] / 0.01, size * np.eye(3)[i]))
            return found(
                {**columns, "gnss_velocity_n": columns["gnss_velocity_n"] + np.roll(swing, late, axis=0)}, arm, **told
            )[0]
        increment = "delta_angle" if row == "gyro_bias_sigma" else "delta_velocity"
        return found({**columns, increment: columns[increment] + size * 0.01 * np.eye(3)[i]}, arm, **told)[0]

    square = np.zeros(3)
    for i in range(1 if row == "gnss_delay_sigma" else 3):
        up, down = perturbed(i, sigma), perturbed(i, -sigma)
        square += (attitude.numeric.error_rotation_vector(up, down) / 2) ** 2
    stated = np.sqrt(found(columns, arm, **told)[1] ** 2 - found(columns, arm)[1] ** 2)
    assert stated == pytest.approx(np.sqrt(square), rel=0.05, abs=3e-6)


@pytest.mark.parametrize("kind", ["fixes", "gyros", "accelerometers"])
def test_what_white_noise_does_is_what_is_stated(kind):
    columns, arm = drive()
    n, count, rng, truth = len(columns["dt"]), 192, np.random.default_rng(4), columns["q_nb"][-1]
    columns = {name: columns[name] for name in MODEL.inputs.names}
    parameters = {**QUIET, "antenna_lever_arm": arm}
    if kind == "fixes":
        columns = {**columns, "gnss_velocity_sigma": np.full((n, 3), 0.05)}
    else:
        columns = sharp(columns)
        parameters["angle_random_walk" if kind == "gyros" else "velocity_random_walk"] = 2e-5 if kind == "gyros" else 1e-2
    u = np.broadcast_to(input_rows(MODEL, columns, n), (count, n, MODEL.inputs.size)).copy()
    name, size = {
        "fixes": ("gnss_velocity_n", 0.05),
        "gyros": ("delta_angle", 2e-5 * 0.1),
        "accelerometers": ("delta_velocity", 1e-2 * 0.1),
    }[kind]
    u[:, :, MODEL.inputs.slice(name)] += size * rng.normal(size=(count, n, 3))
    batch = make_batch(MODEL, count, np.tile(MODEL.parameters.pack(parameters), (count, 1)))
    shown = MODEL.outputs.unpack(batch.run(n, u, every=n)[:, -1])
    errors = np.array([attitude.numeric.error_rotation_vector(q, truth) for q in shown["q_nb"]])
    rms = np.sqrt(np.mean(errors**2, axis=0))
    # 192 runs: 15 % are three standard deviations
    assert rms / shown["attitude_sigma"].mean(axis=0) == pytest.approx(np.ones(3), abs=0.15)


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("car-unknown-heading", None),
        pytest.param("aircraft-inflight-alignment", 120.0, marks=pytest.mark.slow),
        pytest.param("ship-at-sea", 240.0, marks=pytest.mark.slow),
    ],
)
def test_stated_sigmas_cover_the_errors(name, seconds):
    plan = make_plan(name, ID, 16, first_seed=40000, duration_s=seconds)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    error, sigma = (np.concatenate([block[part] for block in blocks]) for part in ("error", "sigma"))
    assert (np.mean(np.abs(error) > 3 * sigma, axis=(0, 1)) <= 0.01).all()
    ratio = np.sqrt(np.mean(error[:, -1, 2] ** 2) / np.mean(sigma[:, -1, 2] ** 2))
    assert 0.5 < ratio < 1.5 and sigma[:, -1, 2].max() < 2.0


def test_a_straight_line_shows_no_heading_and_the_run_says_so():
    result = run("car-unknown-heading", ID, seed=3, duration_s=28.0).results[0]
    assert result.sigma["heading_deg"].min() > 90.0 and result.sigma["roll_deg"][-1] < 0.2
    assert any("heading is unknown at the end" in note for note in result.notes)
    assert not any("heading found" in note for note in result.notes)  # as it is lost again


def test_gyros_that_lose_the_heading_are_named():
    """0.35 rad at 3600 deg/h, 1 deg/s, take 20 s; a tactical unit keeps the heading for hours and is not named."""
    unknown = {"attitude_sigma": np.array([[0.1, 0.1, np.pi / np.sqrt(3)]])}

    def note(bias, at_rest=0.0):
        rows = {"gyro_bias_sigma": bias, "start_gyro_bias_error": at_rest}
        (said,) = get(ID).found(rows, unknown)
        assert said.startswith("the heading is unknown at the end")
        return said

    assert "a bias of 3600 deg/h (gyro_bias_sigma) lose it again in 20 s" in note(np.radians(1.0))
    assert note(np.radians(1.0) / 3600) and "gyro_bias_sigma" not in note(np.radians(1.0) / 3600)
    assert "lose it" not in note(np.radians(1.0), np.radians(100.0) / 3600)
    assert "a bias of 360 deg/h (start_gyro_bias_error)" in note(np.radians(1.0), np.radians(0.1))


def test_a_run_without_fixes_gives_no_attitude():
    scenario = load("car-unknown-heading")
    lost = scenario.gnss.model_copy(update={"outages_s": ((0.0, 30.0),)})
    result = run(scenario.model_copy(update={"gnss": lost}), ID, duration_s=20.0).results[0]
    assert result.sigma["roll_deg"][-1] > 90.0 and any("no attitude was found" in note for note in result.notes)


def test_fixes_without_a_velocity_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"velocity of GNSS or .*: the fixes of scenario 'car-survey' have no velocity"):
        run("car-survey", ID, duration_s=20.0)
    (log, *_) = write(record("car-survey", duration_s=20.0), tmp_path, ["log"])
    with pytest.raises(InputError, match=r"velocity of GNSS or .*: the fixes of the log have no velocity"):
        replay(log, ID)


def test_a_replay_is_told_and_judged_as_the_run(tmp_path):
    """The lever arm of the antenna and the scale factors of the unit too, though the attitude at the start is not used."""
    ran = run("car-unknown-heading", ID).results[0]
    (log, *_) = write(record("car-unknown-heading"), tmp_path, ["log"])
    replayed = replay(log, ID).results[0]
    assert replayed.from_s == ran.from_s == 90.0
    assert replayed.statistics()["rms"] == pytest.approx(ran.statistics()["rms"], rel=0.01)  # of other records
    assert replayed.sigma["heading_deg"][-1] == pytest.approx(ran.sigma["heading_deg"][-1], rel=1e-6)


@pytest.mark.parametrize("grade", ["", "consumer"])
def test_a_rest_at_the_start_of_a_log_shows_the_bias_of_poor_gyros(grade):
    """Of a unit without a grade 3600 deg/h are assumed: the heading was stated as unknown, at an error of 3 deg."""
    scenario = load("car-city-drive")
    scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": "consumer"})})
    for seed in (31, 32):
        log = simulated_log(scenario, seed=seed, duration_s=240.0, grade=grade, initial={"static_until_s": 30.0})
        result = replay(log, ID).results[0]
        late = result.time > 120.0
        for name in ("roll_deg", "pitch_deg", "heading_deg"):
            assert np.all(np.abs(result.errors[name][late]) < 3 * result.sigma[name][late]), name
        assert np.max(np.abs(result.errors["heading_deg"][late])) < 2.0  # a bias of the other sign leaves 5 and 13 deg
        assert result.sigma["heading_deg"][-1] < 10.0 and all("heading found" in note for note in result.notes)
    good = simulated_log("car-city-drive", seed=31, duration_s=60.0, grade="navigation", initial={"static_until_s": 30.0})
    known = initial_knowledge(good, get(ID), "coarse", 0).knowledge
    assert known.gyro_bias_error in (
        0.0,
        pytest.approx(known.sensors.gyro_bias_sigma, rel=0.1),
    )  # the data sheet knows it as well


def test_a_vehicle_in_place_is_refused():
    with pytest.raises(InputError, match="needs a vehicle that moves"):
        run("large-misalignment", ID)


def test_the_memory_balances_fixes_and_gyros():
    """The time after which a drift bends alpha by as much as the noise of the fixes moves its mean, by least squares."""
    bias = 2e-5
    memory = velocity_integration.memory_time(bias, 0.0)
    T = memory * np.sqrt(12)
    t = (np.arange(4000) + 0.5) * T / 4000
    bent = geodesy.NOMINAL_GRAVITY * bias * t**2 / 2
    left = bent - np.polyval(np.polyfit(t, bent, 1), t)
    assert np.sqrt(np.mean(left**2)) == pytest.approx(velocity_integration.FIX_NOISE / np.sqrt(T), rel=1e-3)
    assert velocity_integration.memory_time(bias, 1e-3) < memory
    assert velocity_integration.memory_time(0.0, 0.0) == velocity_integration.LONGEST
    assert velocity_integration.memory_time(1.0, 0.0) == velocity_integration.SHORTEST


@pytest.mark.parametrize("outage", [(60.0, 160.0), (100.0, 110.0)])
def test_an_outage_in_a_turn_makes_no_error_that_is_not_stated(outage):
    """8 runs of an aircraft that turns: with one integral over 100 s and the last fix's place the level was 8 sigma off."""
    scenario = load("aircraft-inflight-alignment")
    gnss = scenario.gnss.model_copy(update={"outages_s": (outage,)})
    plan = make_plan(scenario.model_copy(update={"gnss": gnss}), ID, 8, first_seed=10000, duration_s=190.0)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    error, sigma = (np.concatenate([block[part] for block in blocks])[:, plan.times > outage[0]] for part in ("error", "sigma"))
    assert (np.abs(error) < 4.0 * sigma).all() and sigma[:, -1].max() < 0.2  # deg
