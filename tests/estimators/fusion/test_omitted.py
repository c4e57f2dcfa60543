"""What first order omits of a covariance while the attitude is sought, against moments of drawn errors and closed forms."""

import casadi as ca
import numpy as np
import pytest
from constants import constants, number
from earth_fixed import stored
from scipy.spatial.transform import Rotation

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.model import Values
from insenv.estimators.fusion import history, omitted, unknown_start
from insenv.estimators.fusion.available import all_aids, composition
from insenv.estimators.fusion.ways import BY_FIXES
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY

FEW = composition("few", ("gnss_wander",), ("gnss",))
SEEKING = unknown_start.model_of(FEW, BY_FIXES)
C_WB = Rotation.from_euler("ZYX", [0.7, 0.2, -0.3])
ARM = np.array([3.0, -1.0, -15.0])


def added(step, level, heading, **rows):
    """What a step adds to the variances (n) of the same step of the filter alone; sigmas of level and heading in rad."""
    P, q_wb = np.r_[np.full(6, 1.0), [level**2, level**2, heading**2], np.full(FEW.n - 9, 1e-8)], C_WB.as_quat()[[3, 0, 1, 2]]
    state = {
        "covariance": stored(np.diag(P)), "q_wb": q_wb, "samples": 100.0, unknown_start.SEEKING: 1.0,
        "velocity_w": [30.0, -40.0, 2.0],
        "q_ew": np.ravel(geodesy.numeric.q_ew_from_geodetic(0.8, 0.3, 0.4)), "past_time": 0.02, "past_count": 50.0,
        "past_age": history.SPACING * np.arange(history.SLOTS), "past_attitude": np.tile(q_wb, (history.SLOTS, 1)), **rows,
    }  # fmt: skip
    u = {
        "delta_angle": [2e-3, -1e-3, 4e-3], "delta_velocity": [3e-3, -5e-3, -0.049], "dt": 0.005, "gnss_age": 0.2,
        "gnss_valid": 1.0, "gnss_latitude": 0.8, "gnss_longitude": 0.3, "gnss_velocity_valid": 1.0,
        "gnss_position_sigma": np.ones(3), "gnss_velocity_sigma": np.ones(3),
    }  # fmt: skip
    found = []
    for model in (SEEKING, FEW.model):
        own = {name: value for name, value in state.items() if name in model.state}
        p, x = constants(model.parameters, antenna_lever_arm=ARM), constants(model.state, **own)
        changed = model.steps[step].function(p, x, constants(model.inputs, **u))
        found.append(np.diag(symmetric.full_array(number(changed["covariance"]), FEW.n)))
    return found[0] - found[1]


def moment(sigma):
    """Of 1 - cos psi, for a small normal psi."""
    return 0.75 * sigma**4


@pytest.mark.parametrize(("level", "heading"), [(0.02, 0.1), (0.05, 0.2), (0.0, 0.1)])
def test_second_order_of_a_turned_vector_has_the_moment_of_drawn_errors(level, heading):
    """The part of the heading exactly; of the level as much as the whole vector may lose, in each axis."""
    rng, vector = np.random.default_rng(2), np.array([3.0, -4.0, 12.0])
    P = ca.SX(ca.DM(np.diag([*np.zeros(6), level**2, level**2, heading**2])))
    found = number(omitted.variances(symmetric.triangle(P), ca.SX(vector)))
    drawn = 1 - np.cos(heading * rng.normal(size=400_000))
    assert found[:2] == pytest.approx(np.mean(drawn**2) * vector[:2] ** 2 + moment(2**0.5 * level) * 169.0, rel=0.03)
    assert found[2] == pytest.approx(moment(2**0.5 * level) * 169.0, abs=1e-12)


def test_a_fix_counts_the_turn_of_its_arm_and_of_the_specific_force_over_its_age():
    level, heading, age = 0.05, 0.4, 0.2
    force, rate = np.array([3e-3, -5e-3, -0.049]) / 0.005, np.array([2e-3, -1e-3, 4e-3]) / 0.005
    place, speed = C_WB.apply([ARM + force * age**2 / 2, np.cross(rate, ARM) + force * age])
    found = added("gnss", level, heading, gnss_due=1.0)
    for part, vector in ((POSITION, place), (VELOCITY, speed)):
        expected = moment(heading) * np.r_[vector[:2] ** 2, 0.0] + moment(2**0.5 * level) * vector @ vector
        assert found[part] == pytest.approx(expected, rel=1e-6)


def test_between_fixes_gravity_the_way_and_the_earth_rate_turn_with_the_attitude():
    """The velocity by what has grown since the filter was started anew; place and level by the time without a velocity."""
    level, heading, since_propagation, since = 0.05, 0.4, 0.1, 12.0
    force, before, rate = np.array([0.3, -0.2, -0.98]), np.array([1.0, 2.0, -49.0]), np.array([3e-5, -5e-5, 1e-5])
    found = added(
        "covariance", level, heading, since_propagation=since_propagation, since_propagation_velocity_w=force, omega_ie_w=rate,
        gnss_since=since,
        **{unknown_start._GAINED: before},
    )  # fmt: skip
    after, tilted = before + force, moment(2**0.5 * level)
    grown = moment(heading) * np.r_[(after**2 - before**2)[:2], 0.0] + tilted * (after @ after - before @ before)
    unmeasured = 2 * (since - omitted.MEASURED_OFTEN) * since_propagation * moment(heading)
    assert found[VELOCITY] == pytest.approx(np.maximum(grown, 0.0), rel=1e-6)
    assert found[POSITION] == pytest.approx(unmeasured * 2500.0 * np.array([1.0, 1.0, 0.0]), rel=1e-6)
    assert found[TILT] == pytest.approx(unmeasured * omitted.BY_RATE * (rate[:2] @ rate[:2]) * np.array([1, 1, 0]), rel=1e-6)


@pytest.mark.parametrize(("level", "due"), [(1.0, 1.0), (0.01, 0.0)])
def test_while_the_level_is_sought_the_covariance_follows_each_sample(level, due):
    P = np.diag(np.full(FEW.n, 1e-4)) + np.diag(np.r_[np.zeros(6), level**2, level**2, 0.0, np.zeros(FEW.n - 9)])
    covariance = stored(P)
    x = constants(SEEKING.state, covariance=covariance, **{unknown_start.SEEKING: 1.0})
    p, u = constants(SEEKING.parameters, covariance_interval=1.0), constants(SEEKING.inputs, dt=0.005)
    assert number(SEEKING.steps["sample"].function(p, x, u)["covariance_due"]) == due


def test_a_log_counts_the_product_of_two_errors():
    """E |psi|^2 |xi|^2 of drawn errors of attitude and velocity; nothing where the log starts the filter."""
    rng, velocity = np.random.default_rng(3), np.array([6.0, 2.0, -0.5])
    L = rng.normal(size=(9, 9)) * np.repeat([1.0, 0.8, 0.05], 3)[:, None]
    covariance = stored(L @ L.T)
    drawn = rng.normal(size=(100_000, 9)) @ L.T
    xi = drawn[:, VELOCITY] - np.cross(velocity, drawn[:, TILT])
    expected = np.mean(np.sum(xi**2, axis=1) * np.sum(drawn[:, TILT] ** 2, axis=1))
    for count, wanted in ((1.0, expected), (0.0, 0.01**2)):
        x = Values(covariance=ca.SX(ca.DM(covariance)), velocity_w=ca.SX(ca.DM(velocity)), dvl_count=ca.SX(count))
        found = number(all_aids()["dvl"].variance(Values(dvl_noise=0.01), x, None, lambda name: ca.SX.zeros(3)))
        assert found == pytest.approx(np.full(3, wanted), rel=0.03)
