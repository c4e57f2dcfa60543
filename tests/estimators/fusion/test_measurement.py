"""Fusion filters: the sensitivities of all aids against differences through the feedback."""

import casadi as ca
import numpy as np
import pytest
from constants import number
from scipy.spatial.transform import Rotation

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.model import Values
from insenv.estimators.fusion import history
from insenv.estimators.fusion.available import all_aids, all_states, composition, states_by_aid
from insenv.estimators.fusion.instruments import EstimatedMotion
from insenv.estimators.fusion.measurement import far, update
from insenv.estimators.fusion.navigation import Navigation, corrected, corrected_increments

UNIT = ("gyro_g_sensitivity", "gyro_scale", "gyro_misalignment", "accel_scale", "accel_misalignment")


def numbers(table, generator, **given):
    """Values by name of a table: plausible ones where they matter, small random ones elsewhere."""
    found = {}
    for row in table:
        value = row.flat_start() + 1e-3 * generator.standard_normal(row.size)
        found[row.name] = given.get(row.name, np.clip(value, row.lower, row.upper).reshape(row.shape))
    return found


STATE = {
    "q_wb": Rotation.from_euler("ZYX", [0.7, 0.2, -0.3]).as_quat(scalar_first=True), "velocity_w": np.array([12.0, -7.0, 1.5]),
    "height": 120.0, "samples": 100.0, "gnss_delay": np.array([0.001]), "magnetometer_misalignment": np.zeros(3),
    "covariance": None,
}  # fmt: skip


def kept_motion():
    """What `history` keeps of a motion at constant velocity and attitude."""
    ages = 0.02 + history.SPACING * np.arange(history.SLOTS)
    return {
        "past_time": 0.02, "past_count": 50.0, "past_age": ages - 0.02, "way_w": np.array([3.0, 2.0, 1.0]),
        "past_way": np.array([3.0, 2.0, 1.0]) - ages[:, None] * STATE["velocity_w"],
        "past_velocity": np.tile(STATE["velocity_w"], (history.SLOTS, 1)),
        "past_attitude": np.tile(STATE["q_wb"], (history.SLOTS, 1)), "past_rate": np.tile([0.4, -0.2, 0.8], (history.SLOTS, 1)),
        "previous_delta_angle": np.array([2e-3, -1e-3, 4e-3]),
    }  # fmt: skip


def constants(**values):
    """Values by name as constants of CasADi; None is left out."""
    return Values(**{k: ca.SX(ca.DM(np.asarray(v, float).tolist())) for k, v in values.items() if v is not None})


def sensitivities(filter, generator, state, inputs):
    """(H, values of the state, functions' symbols and flat values) of the first aid of a filter."""
    tables = (filter.parameters, filter.state, filter.inputs)
    given = (PARAMETERS, {k: v for k, v in state.items() if k in filter.state and v is not None}, inputs)
    values = [numbers(table, generator, **each) for table, each in zip(tables, given, strict=True)]
    flat = [np.concatenate([np.ravel(each[row.name]) for row in table]) for each, table in zip(values, tables, strict=True)]
    symbols = [ca.SX.sym(name, table.size) for name, table in zip("pxu", tables, strict=True)]
    named = [table.symbols(each) for table, each in zip(tables, symbols, strict=True)]
    done, _ = update(filter.aids[0], filter.states, filter.places, filter.n, *named)
    H = np.array(ca.Function("H", symbols, [ca.vertcat(*[ca.densify(s.H) for s in done.scalars])])(*flat))
    return H, values[1], symbols, named, flat


INPUTS = {
    "delta_angle": np.array([2e-3, -1e-3, 4e-3]), "delta_velocity": np.array([3e-3, -5e-3, -0.049]), "dt": 0.005,
    "gnss_valid": 1.0, "gnss_velocity_valid": 1.0, "gnss_age": 0.08, "gnss_latitude": 0.8, "gnss_longitude": 0.3,
    "gnss_height": 121.0, **{f"{id}_new": 1.0 for id in ("barometer", "magnetometer", "odometer", "dvl", "heading")},
    **{f"{id}_age": 0.05 for id in ("barometer", "magnetometer", "odometer", "dvl", "heading")}, "heading_azimuth_sigma": 0.01,
}  # fmt: skip
PARAMETERS = {
    "antenna_lever_arm": np.array([1.2, -0.4, -0.9]), "odometer_lever_arm_b": np.array([-1.0, 0.6, 0.8]),
    "odometer_mounting": np.array([0.01, 0.03, -0.05]), "dvl_lever_arm_b": np.array([4.0, 0.0, 3.0]),
    "heading_baseline_b": np.array([0.4, 1.3, 0.1]), "magnetic_field_n": np.array([2.1e-5, 1e-6, 4.2e-5]),
    "start_latitude": 0.8, "start_longitude": 0.3, "start_height": 100.0,
}  # fmt: skip


def test_the_states_of_the_unit_take_out_what_the_simulated_unit_puts_in():
    """Each sign and place, by the matrices that tests/sensors/test_imu.py holds the simulated unit against."""
    angle, velocity, dt = np.array([0.01, -0.02, 0.03]), np.array([0.5, 0.1, -0.05]), 0.005
    scale, couplings, constant = np.array([1.0, 2.0, 3.0]) * 1e-6, np.arange(1, 7) * 1e-6, np.array([4.0, -5.0, 6.0]) * 1e-6
    M = np.eye(3) + np.diag(scale)
    M[~np.eye(3, dtype=bool)] = couplings
    values = {"gyro_bias": constant, "accel_bias": -constant, "gyro_g_sensitivity": 2 * constant}
    values |= {
        f"{triad}_{kind}": size for triad in ("gyro", "accel") for kind, size in (("scale", scale), ("misalignment", couplings))
    }
    measured_angle, measured_velocity = M @ angle + constant * dt + 2 * constant * velocity, M @ velocity - constant * dt
    measured = Values(delta_angle=ca.DM(measured_angle), delta_velocity=ca.DM(measured_velocity), dt=dt)
    states = [all_states()[name] for name in ("gyro_bias", "accel_bias", *UNIT)]
    correct = corrected_increments(states, {name: ca.DM(value) for name, value in values.items()}, measured)
    found = [number(each) for each in correct]
    np.testing.assert_allclose(found[0], angle, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found[1], velocity, rtol=0, atol=1e-10)


@pytest.mark.parametrize("age", [0.0, 0.05])
@pytest.mark.parametrize("id", all_aids())
def test_sensitivities_equal_differences_through_the_feedback(id, age):
    """H of every aid with all its states and those of the unit: the residual with an error fed back, by differences."""
    generator = np.random.default_rng(5)
    filter = composition("all", [*UNIT, *(state.name for state in states_by_aid().get(id, ()))], [id])
    aid = filter.aids[0]
    state = {**STATE, **kept_motion(), "q_ew": np.ravel(geodesy.numeric.q_ew_from_geodetic(0.8, 0.3, 0.4))}
    inputs = {k: age if k.endswith("_age") else value for k, value in INPUTS.items()}
    H, _, symbols, (P, X, U), flat = sensitivities(filter, generator, state, inputs)
    error = ca.SX.sym("error", filter.n)
    fed_back = Values(**{**vars(X), **corrected(X, error, filter.states, filter.places)})
    residual = aid.residual(P, Navigation(fed_back, U, filter.states, filter.places, ca.SX.zeros(filter.n)), U)
    after = ca.Function("after", [*symbols, error], [residual])
    step = np.full(filter.n, 1e-6)
    step[:3] = 0.05
    # accelerometer errors are fed back into the motion to come, not into that which is kept
    left_out = [filter.places[name] for name in filter.places if name.startswith("accel")] if age or id == "gnss" else []
    for k in range(filter.n):
        if any(part.start <= k < part.stop for part in left_out):
            continue
        direction = np.eye(filter.n)[k] * step[k]
        change = np.array(after(*flat, direction) - after(*flat, -direction)).ravel() / (2 * step[k])
        # the turn of the computed frame by a position error is left out of the sensitivities: 1.6e-7 rad per metre
        allowed = 2e-5 * max(1.0, np.abs(H).max()) if k < 3 else 2e-6 * max(1.0, np.abs(H).max()) + 2e-4 * np.abs(change)
        assert np.all(np.abs(-change - H[:, k]) < allowed), (id, k, -change, H[:, k])
    assert np.abs(H).max() > 0


@pytest.mark.parametrize(("off_deg", "age"), [(30.0, 0.0), (30.0, 0.05), (-130.0, 0.0), (172.0, 0.05)])
def test_one_field_shows_a_heading_far_off_and_leaves_the_iron_alone(off_deg, age):
    """30 deg off: to a first order the field along its direction is 13 % longer than it is, 2.5 sigmas of the hard iron."""
    filter = composition("field", ["hard_iron"], ["magnetometer"])
    sigma = {"attitude": np.radians([0.5, 0.5, 14.9 if off_deg == 30.0 else 180.0]), "hard_iron": np.full(3, 1e-6)}
    variance = np.full(filter.n, 1e-12)
    variance[6:9], variance[filter.places["hard_iron"]] = sigma["attitude"] ** 2, sigma["hard_iron"] ** 2
    field_n = PARAMETERS["magnetic_field_n"]
    truth = Rotation.from_quat(STATE["q_wb"], scalar_first=True)
    off = Rotation.from_rotvec([0.0, 0.0, np.radians(off_deg)]) * truth
    kept = kept_motion()
    kept["past_attitude"] = np.tile(off.as_quat(scalar_first=True), (history.SLOTS, 1))
    x = {row.name: np.zeros(row.shape) for row in filter.state}
    x |= {k: v for k, v in {**STATE, **kept}.items() if k in filter.state} | {
        "q_wb": off.as_quat(scalar_first=True), "q_ew": np.ravel(geodesy.numeric.q_ew_from_geodetic(0.8, 0.3, 0.0)),
        "covariance": symmetric.triangle_of_diagonal(variance),
    }  # fmt: skip
    p = {**{row.name: row.flat_start().reshape(row.shape) for row in filter.parameters}, "magnetometer_noise": 1e-7}
    p |= {k: v for k, v in PARAMETERS.items() if k in filter.parameters}
    u = {row.name: np.zeros(row.shape) for row in filter.inputs} | {"dt": 0.005, "magnetometer_new": 1.0}
    u |= {"magnetometer_age": age, "magnetometer_field_b": truth.as_matrix().T @ field_n}
    known = (constants(**p), constants(**u))
    assert number(far(constants(**x))) == (off_deg != 30.0)
    if off_deg != 30.0:
        turned = filter.headed(filter.aids[0])(known[0], constants(**x), known[1])
        x |= {name: number(value).reshape(filter.state[name].shape) for name, value in turned.items()}
        left = Rotation.from_quat(x["q_wb"], scalar_first=True) * truth.inv()
        assert left.magnitude() <= np.radians(7.6)  # half of what lies between two of the 24
    found = filter.shown(filter.aids[0])(known[0], constants(**x), known[1])
    state = constants(**x | {name: number(value) for name, value in found.items()})
    done, _ = update(filter.aids[0], filter.states, filter.places, filter.n, known[0], state, known[1])
    after = corrected(state, done.correction, filter.states, filter.places)
    turned = Rotation.from_quat(number(after["q_wb"]), scalar_first=True) * truth.inv()
    assert np.all(np.abs(np.degrees(turned.as_rotvec())) < [0.1, 0.1, 1.2])  # a third of what remains uncertain
    assert np.all(np.abs(number(after["hard_iron"])) < 0.3 * sigma["hard_iron"])


def test_instruments_see_the_estimated_motion():
    """Displacement from the start, and a velocity through water that flows, in closed form."""
    q_ew = np.ravel(geodesy.numeric.q_ew_from_geodetic(0.8, 0.3, 0.4))
    x, u = constants(**{**STATE, **kept_motion(), "q_ew": q_ew}), constants(**INPUTS)
    height, R_M = float(STATE["height"]), float(geodesy.numeric.radii(np.sin(0.8))[0])
    p = Values(start_latitude=0.8 - 1e-5, start_longitude=0.3, start_height=height - 5.0)
    motion = EstimatedMotion(Navigation(x, u, (), {}, ca.SX.zeros(9)), 0.0, p)
    np.testing.assert_allclose(number(motion.displacement_n), [1e-5 * (R_M + height), 0.0, -5.0], atol=1e-3)
    C_nb = number(motion.to_navigation(ca.SX.eye(3))).reshape(3, 3)
    arm, flow = ca.DM([1.0, 2.0, 3.0]), np.array([0.3, -0.2, 0.0])
    through, over = (number(motion.body_velocity(arm, each)) for each in (ca.DM(flow), None))
    np.testing.assert_allclose(through, over - C_nb.T @ flow, atol=1e-12)


def test_a_late_fix_shows_the_accelerometers():
    """After an age t an error b of the accelerometers is C b t^2 / 2 of position and -C b t of velocity."""
    age, generator = 0.3, np.random.default_rng(6)
    filter = composition("late", ["accel_scale"], ["gnss"])
    state = {**STATE, **kept_motion(), "q_ew": np.ravel(geodesy.numeric.q_ew_from_geodetic(0.8, 0.3, 0.0))}
    H, values, *_ = sensitivities(filter, generator, state, {**INPUTS, "gnss_age": age})
    bias = H[:, filter.places["accel_bias"]]
    C_nb = Rotation.from_quat(STATE["q_wb"], scalar_first=True).as_matrix()
    gain = 1 - np.ravel(values["accel_scale"])
    np.testing.assert_allclose(bias[:3], C_nb * gain * age**2 / 2, atol=1e-9)
    np.testing.assert_allclose(bias[3:], -C_nb * gain * age, atol=1e-9)
    force = INPUTS["delta_velocity"] / INPUTS["dt"] - np.ravel(values["accel_bias"])
    np.testing.assert_allclose(H[3:, filter.places["accel_scale"]], -C_nb * force * age, atol=1e-7)


@pytest.mark.parametrize("age", [0.0, 0.013, 0.08, 0.31])
def test_the_rate_of_a_past_time_is_that_of_this_time(age):
    """Each sample shows the rate of its middle.  Half a sample of lag made the height of a lever arm 1.3 sigma wrong."""
    now, dt, growth = 7.0, 0.01, np.array([2.0, -1.0, 0.5])
    ages = 0.03 + history.SPACING * np.arange(history.SLOTS)
    kept = {
        **STATE, **kept_motion(), "past_time": 0.03, "past_age": ages - 0.03,
        "past_rate": (now - ages[:, None] - dt / 2) * growth,
    }  # fmt: skip
    u = constants(delta_angle=(now - dt / 2) * growth * dt, dt=dt)
    seen = number(history.past(constants(**kept), u, ca.SX(age)).rate_b)
    np.testing.assert_allclose(seen, (now - age) * growth, atol=1e-9)


@pytest.mark.parametrize("age", [0.4, 0.93, 1.03, 1.6])
def test_a_late_measurement_sees_the_motion_of_its_time(age):
    """At constant velocity the way back is velocity times age, for measurements older than what is kept too."""
    u = constants(delta_angle=INPUTS["delta_angle"], dt=INPUTS["dt"])
    way = number(history.past(constants(**STATE, **kept_motion()), u, ca.SX(age)).way_w)
    np.testing.assert_allclose(way, STATE["velocity_w"] * age, atol=1e-9)


@pytest.mark.parametrize("age", [0.0, 0.2])
def test_a_point_of_a_body_at_rest_does_not_move_over_the_earth(age):
    """The gyros show the Earth's rate alone, which turns the body with the Earth."""
    q_ew = np.array(geodesy.numeric.q_ew_from_geodetic(0.8, 0.3, 0.0)).ravel()
    earth_rate_b = Rotation.from_quat(STATE["q_wb"], scalar_first=True).inv().apply(geodesy.numeric.earth_rate_n(0.8))
    still = {"velocity_w": np.zeros(3), "way_w": np.zeros(3), "past_way": np.zeros((history.SLOTS, 3)), "q_ew": q_ew}
    still |= {"past_velocity": np.zeros((history.SLOTS, 3)), "past_rate": np.tile(earth_rate_b, (history.SLOTS, 1))}
    x = constants(**{**STATE, **kept_motion(), **still, "previous_delta_angle": earth_rate_b * INPUTS["dt"]})
    u = constants(**{**INPUTS, "delta_angle": earth_rate_b * INPUTS["dt"]})
    velocity_w = Navigation(x, u, (), {}, ca.SX.zeros(9)).point(ca.DM([10.0, -20.0, 30.0]), ca.SX(age))[1]
    np.testing.assert_allclose(number(velocity_w), 0.0, atol=1e-12)


@pytest.mark.parametrize("scale", [0.0, 0.02])
def test_an_unknown_scale_of_a_barometer_does_not_measure_the_height(scale):
    """The height's own column is that of a plain barometer; by (height - start) scale, sigma was 0.82 times the limit."""
    filter = composition("height", [state.name for state in states_by_aid()["barometer"]], ["barometer"])
    x = {**STATE, **kept_motion(), "q_ew": [1.0, 0.0, 0.0, 0.0], "height": 160.0, "barometer_scale": [scale]}
    kept = filter.state.pack({k: v for k, v in x.items() if k in filter.state and v is not None})
    state, p = constants(**filter.state.unpack(kept)), constants(**{row.name: row.flat_start() for row in filter.parameters})
    u = constants(**{row.name: row.flat_start() for row in filter.inputs} | {"dt": 0.01})
    done, _ = update(filter.aids[0], filter.states, filter.places, filter.n, p, state, u)
    H = number(done.scalars[0].H)
    assert H[2] == -1.0  # down
    gained = -kept_motion()["way_w"][2]
    np.testing.assert_allclose(H[filter.places["barometer_scale"]], -gained, rtol=1e-12)
