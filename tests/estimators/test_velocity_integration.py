"""velocity-integration by GNSS and by a Doppler log: exact without errors, stated accuracy."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from constants import constants, number
from driven import columns_of, fed, of_model
from scipy.spatial.transform import Rotation
from simulated_log import simulated_log

from insenv import attitude, geodesy, replay, run
from insenv.core.batch import make_batch
from insenv.estimators.parts.rows import MOTION_ERRORS, NOISES
from insenv.estimators.velocity_integration import estimator as velocity_integration
from insenv.estimators.velocity_integration.estimator import BY_FIXES, BY_LOG
from insenv.estimators.velocity_integration.source import ALPHA, DRIFT, OF_SCALAR, OF_VECTOR
from insenv.scenario import build
from insenv.scenario.inputs import input_rows
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

ID = "velocity-integration"
CAR, SHIP = "car-unknown-heading", "ship-log-alignment"
ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")


def perfect(name, sensor, **keys):
    return changed(name, imu={"grade": "perfect"}, **{sensor: {"grade": "perfect", **keys}})


@cache
def driven(name, seconds):
    """(model, columns, parameters) of a drive at 100 Hz or 50 Hz without errors, and of an alignment that knows it.

    Late fixes, and velocities of a log on time: its age is that of an extrapolation only.
    """
    sensor, keys, rate = ("gnss", {}, 100.0) if name == CAR else ("dvl", {"latency_s": 0.0}, 50.0)
    plant = build(perfect(name, sensor, **keys).model_copy(update={"rate_hz": rate}), seed=1, duration_s=seconds)
    columns = columns_of(plant)
    model = (BY_FIXES if name == CAR else BY_LOG).model
    known = plant.knowledge.rows_of(model.parameters) | dict.fromkeys((*NOISES.names, *MOTION_ERRORS.names), 0.0)
    known |= {"memory_time": 30.0} if name == CAR else {"memory_time": 3600.0, "dvl_noise": 0.05}
    if name == CAR:
        columns["gnss_velocity_sigma"] = np.full((plant.samples, 3), 0.05)
    return model, columns, known


def found(model, columns, parameters, **told):
    """Attitude (4) at the end of columns, and its stated standard deviations (3, rad)."""
    outputs = fed(model, columns, of_model(model, {**parameters, **told})).outputs()
    return outputs["q_nb"], outputs["attitude_sigma"]


def errors_of(result, from_s):
    """Largest errors of roll and pitch, and of heading, from a time on, deg."""
    late = result.time >= from_s
    roll, pitch, heading = (np.abs(result.errors[name][late]).max() for name in ATTITUDE)
    return max(roll, pitch), heading


@pytest.mark.parametrize(("name", "sensor", "latency", "seconds", "from_s", "level", "heading"), [
    (CAR, "gnss", 0.0, 90.0, 45.0, 5e-5, 5e-4),
    (CAR, "gnss", 0.05, 90.0, 45.0, 3e-4, 3e-3),
    pytest.param(CAR, "gnss", 0.4, 90.0, 45.0, 3e-3, 3e-2, marks=pytest.mark.slow),
    ("aircraft-inflight-alignment", "gnss", 0.0, 80.0, 60.0, 2e-3, 2e-3),
    (SHIP, "dvl", 0.0, 340.0, 300.0, 1e-3, 5e-3),
    (SHIP, "dvl", 0.2, 340.0, 300.0, 1e-3, 2e-2),
])  # fmt: skip
def test_without_errors_the_attitude_is_exact(name, sensor, latency, seconds, from_s, level, heading):
    """From an unknown heading, in turns and waves, with a lever arm; what is left is the extrapolation of a late velocity."""
    (result,) = run(perfect(name, sensor, latency_s=latency), ID, seed=1, duration_s=seconds).results
    largest = errors_of(result, from_s)
    assert largest[0] < level and largest[1] < heading


@pytest.mark.parametrize(("name", "row", "sigma"), [
    (CAR, "gyro_bias_sigma", 2e-6), (CAR, "accel_bias_sigma", 1e-3), (CAR, "antenna_lever_arm_sigma", 0.05),
    (CAR, "gnss_delay_sigma", 0.01), (SHIP, "gyro_bias_sigma", 5e-8), (SHIP, "accel_bias_sigma", 5e-4),
    (SHIP, "dvl_scale_factor_sigma", 0.002), (SHIP, "dvl_misalignment_sigma", 0.001),
])  # fmt: skip
def test_what_a_constant_error_does_is_what_is_stated(name, row, sigma):
    """Each component of the error in turn, in the data: the root of the sum of the squares is the stated sigma."""
    model, columns, known = driven(name, 46.0 if name == CAR else 170.0)  # in a turn: the answer is new
    told = {row: np.full(3, sigma) if row == "antenna_lever_arm_sigma" else sigma}
    velocity, dt, late = columns["dvl_velocity_b"] if name == SHIP else None, columns["dt"][0], 5  # samples

    def swing(arm):
        turning = attitude.numeric.rotate(columns["q_nb"], np.cross(columns["delta_angle"] / dt, arm))
        return columns["gnss_velocity_n"] + np.roll(turning, late, axis=0)

    perturb = {
        "gyro_bias_sigma": lambda e: {"delta_angle": columns["delta_angle"] + e * dt},
        "accel_bias_sigma": lambda e: {"delta_velocity": columns["delta_velocity"] + e * dt},
        "antenna_lever_arm_sigma": lambda e: {"gnss_velocity_n": swing(e)},
        "gnss_delay_sigma": lambda e: {"gnss_age": columns["gnss_age"] - e[0]},
        "dvl_scale_factor_sigma": lambda e: {"dvl_velocity_b": velocity * (1 + e[0])},
        "dvl_misalignment_sigma": lambda e: {"dvl_velocity_b": velocity + np.cross(velocity, e)},
    }[row]
    square = np.zeros(3)
    for error in np.eye(3)[: 1 if row in ("gnss_delay_sigma", "dvl_scale_factor_sigma") else 3] * sigma:
        up, down = (found(model, {**columns, **perturb(sign * error)}, known, **told)[0] for sign in (1, -1))
        square += (attitude.numeric.error_rotation_vector(up, down) / 2) ** 2
    stated = np.sqrt(found(model, columns, known, **told)[1] ** 2 - found(model, columns, known)[1] ** 2)
    assert stated == pytest.approx(np.sqrt(square), rel=0.05, abs=3e-6)


def test_errors_of_a_velocity_of_the_log_against_differences():
    """Of a drift of the attitude to i, of the mounting, and of the scale factor."""
    model, step, C_ib = BY_LOG.model, 1e-6, Rotation.random(random_state=3)
    velocity = np.array([6.0, -1.0, 0.5])

    def seen(drift=(0, 0, 0), mounting=(0, 0, 0), scale=0.0):
        q_ib = (Rotation.from_rotvec(drift) * C_ib).as_quat(scalar_first=True)
        measured = (1 + scale) * (velocity + np.cross(velocity, mounting))
        state = {"q_ib": q_ib, "alpha": [1.0, 2.0, -50.0], "dt": 0.01, "time": 30.0, "latitude": 0.8}
        values = ((model.parameters, {}), (model.state, state), (model.inputs, {"dvl_velocity_b": measured, "dvl_new": 1.0}))
        p, x, u = (constants(table, **each) for table, each in values)
        return BY_LOG.source.measurement(p, x, u, lambda p, x: (ca.SX([1, 0, 0, 0]), ca.SX(0)))

    def alpha(**errors):
        return number(seen(**errors).alpha)

    stated = number(seen().error)
    for part, name in ((DRIFT, "drift"), (OF_VECTOR, "mounting")):
        slopes = [(alpha(**{name: step * axis}) - alpha(**{name: -step * axis})) / (2 * step) for axis in np.eye(3)]
        assert stated[:, part] == pytest.approx(np.transpose(slopes), abs=1e-7)
    assert stated[:, OF_SCALAR] == pytest.approx((alpha(scale=step) - alpha(scale=-step)) / (2 * step), abs=1e-7)
    assert stated[:, ALPHA] == pytest.approx(np.eye(3))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "column", "size", "told"), [
    (CAR, "gnss_velocity_n", 0.05, {}),
    (CAR, "delta_angle", 2e-6, {"angle_random_walk": 2e-5}),
    (CAR, "delta_velocity", 1e-3, {"velocity_random_walk": 1e-2}),
    (SHIP, "dvl_velocity_b", 0.05, {}),
])  # fmt: skip
def test_what_white_noise_does_is_what_is_stated(name, column, size, told):
    model, columns, known = driven(name, 70.0 if name == CAR else 170.0)
    if name == CAR and told:
        columns = {**columns, "gnss_velocity_sigma": np.full_like(columns["gnss_velocity_sigma"], 1e-6)}
    n, count, rng = len(columns["dt"]), 192, np.random.default_rng(4)
    u = np.broadcast_to(input_rows(model, columns, n), (count, n, model.inputs.size)).copy()
    u[:, :, model.inputs.slice(column)] += size * rng.normal(size=(count, n, 3))
    parameters = of_model(model, {**known, **told})
    batch = make_batch(model, count, np.tile(model.parameters.pack(parameters), (count, 1)))
    shown = model.outputs.unpack(batch.run(n, u, every=n)[:, -1])
    errors = np.array([attitude.numeric.error_rotation_vector(q, columns["q_nb"][-1]) for q in shown["q_nb"]])
    if name == SHIP:  # of the time before the heading was known neither the way nor the Coriolis term counts
        mean = errors.mean(axis=0)
        assert abs(mean[2]) < 0.4 * shown["attitude_sigma"][:, 2].mean() and np.degrees(np.abs(mean[:2])).max() < 1.5e-3
        errors = errors - mean
    # 192 runs: 15 % are three standard deviations
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert rms / shown["attitude_sigma"].mean(axis=0) == pytest.approx(np.ones(3), abs=0.15)


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


@pytest.mark.parametrize("latitude", [-1.2, 0.3, 1.2])
def test_an_unmeasured_way_turns_north_and_the_vertical_by_what_is_stated(latitude):
    """A way east of 20 km, a minute after the last measurement: against the axes n at both of its ends."""
    way = np.array([0.0, 20e3, 0.0])
    known = {"latitude": latitude, "time": 63.0, "epoch": 0.0, "count": 1.0, "velocity_n": way / 60.0}
    found = number(BY_FIXES.place_sigma(constants(BY_FIXES.model.state, **known)))
    there = geodesy.numeric.geodetic_from_ned_offset(way, latitude, 0.0, 0.0)
    before, after = (geodesy.numeric.C_en(*np.ravel(place)[:2]) for place in ((latitude, 0.0), there))
    turn = Rotation.from_matrix(before.T @ after).as_rotvec()
    assert np.abs(found[[0, 2]]) == pytest.approx(np.abs(turn[[0, 2]]), rel=0.01)
    assert found[1] == pytest.approx(abs(found[0]))  # the direction of an error is not known


def test_a_straight_line_shows_no_heading_and_a_run_without_fixes_no_attitude():
    result = run("car-unknown-heading", ID, seed=3, duration_s=28.0).results[0]
    assert result.sigma["heading_deg"].min() > 90.0 and result.sigma["roll_deg"][-1] < 0.2
    assert any("heading is unknown at the end" in note for note in result.notes)
    assert not any("heading found" in note for note in result.notes)  # as it is lost again
    (result,) = run(changed(CAR, gnss={"outages_s": ((0.0, 30.0),)}), ID, duration_s=20.0).results
    assert result.sigma["roll_deg"][-1] > 90.0 and any("no attitude was found" in note for note in result.notes)


@pytest.mark.parametrize("grade", ["", "consumer"])
def test_a_rest_at_the_start_of_a_log_shows_the_bias_of_poor_gyros(grade):
    """Of a unit without a grade 3600 deg/h are assumed: the heading was stated as unknown, at an error of 3 deg."""
    scenario = changed("car-city-drive", imu={"grade": "consumer"})
    log = simulated_log(scenario, seed=31, duration_s=180.0, grade=grade, initial={"static_until_s": 30.0})
    result = replay(log, ID).results[0]
    late = result.time > 120.0
    for name in ATTITUDE:
        assert np.all(np.abs(result.errors[name][late]) < 3 * result.sigma[name][late]), name
    assert np.max(np.abs(result.errors["heading_deg"][late])) < 2.0  # a bias of the other sign leaves 5 and 13 deg
    assert result.sigma["heading_deg"][-1] < 10.0


def test_an_outage_in_a_turn_makes_no_error_that_is_not_stated():
    """Of an aircraft that turns: with one integral over 100 s and the last fix's place the level was 8 sigma off."""
    scenario = changed("aircraft-inflight-alignment", gnss={"outages_s": ((60.0, 160.0),)})
    for seed in (10000, 10001):
        (result,) = run(scenario, ID, seed=seed, duration_s=190.0).results
        for name in ATTITUDE:
            late = result.time > 60.0
            assert (np.abs(result.errors[name]) < 4.0 * result.sigma[name])[late].all() and result.sigma[name][-1] < 0.2


@pytest.mark.parametrize("id", [ID, "fusion"])
def test_gyros_that_cannot_find_north_are_told(id, monkeypatch):
    """Of 4.2 deg/h against 8.8 deg/h: one run in 32 stated 3.4 deg for an error of 20 deg."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    (result,) = run(changed(SHIP, imu={"grade": "tactical"}), id, seed=10006, duration_s=160.0 if id == ID else 60.0).results
    assert result.sigma["heading_deg"].min() > 90.0
    said = [note for note in result.notes if "the rotation of the Earth" in note]
    assert len(said) == 1 and (id == "fusion" or "gyro_bias_sigma is 4.2 deg/h" in said[0])
    if id == "fusion":
        assert np.all(np.abs(result.errors["east_m"]) < 3 * result.sigma["east_m"])
    else:  # and the level is shown all the same
        assert result.sigma["roll_deg"][-1] < 10.0 and abs(result.errors["roll_deg"][-1]) < 3.0 * result.sigma["roll_deg"][-1]


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "end"), [(50.0, 250.0), (70.0, 470.0)])
def test_a_log_that_fails_before_or_after_the_heading_is_found(begin, end):
    """16 runs.  To first order the level is up to 14 sigma off in the first gap, the velocity up to 19 after the second."""
    scenario = changed(SHIP, dvl={"outages_s": ((begin, end),)})
    plan = make_plan(scenario, "fusion", 16, first_seed=40000, duration_s=end + 30.0)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    error, sigma, nees = (np.concatenate([block[part] for block in blocks]) for part in ("error", "sigma", "nees"))
    late = plan.times > begin
    assert (np.abs(error) < 5.0 * sigma)[:, late].all()
    assert nees[:, late].mean(axis=0).max() < 9.0 + 5.0  # 16 runs: the 99.9 % bound of their mean is 12.6
