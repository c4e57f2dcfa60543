"""A velocity that was gained with a wrong heading lies on an arc, and the filter that knows it is honest at departure."""

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from constants import constants, number
from scipy.spatial.transform import Rotation

from insenv import geodesy
from insenv.core import symmetric
from insenv.estimators.fusion import arc
from insenv.estimators.loosely_coupled import SMOOTHING
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY
from insenv.evaluation.errors import CHANNELS
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

PSI, GAINED, PLACE = np.array([0.01, -0.02, 0.12]), np.array([12.0, 3.0, -1.0]), np.array([-40.0, 9.0, 5.0])


def covariance(sigma):
    """Of an attitude (sigma: 3, rad) with which velocity and place were gained, and small errors that do not come with it."""
    G = np.zeros((9, 3))
    for part, vector in ((POSITION, PLACE), (VELOCITY, GAINED)):
        G[part] = -np.cross(np.eye(3), vector).T  # psi x vector, the first order of what a turn changes
    G[TILT] = np.eye(3)
    return G @ np.diag(np.square(sigma)) @ G.T + np.diag([1e-4] * 6 + [0.0] * 3)


def stored(P):
    """Its upper triangle as the state has it."""
    triangle = np.zeros(symmetric.triangle_size(9))
    for i, j in np.ndindex(9, 9):
        triangle[symmetric.place(i, j)] = P[i, j]
    return ca.DM(triangle)


def test_a_correction_turns_what_the_attitude_turned_and_nothing_else():
    P, turn = covariance([0.02, 0.03, 0.1]), Rotation.from_rotvec(PSI).as_matrix()
    error = np.concatenate([np.cross(PLACE, PSI), np.cross(GAINED, PSI), PSI])
    for parts, moved in ((arc.WITH_VELOCITY, (VELOCITY,)), (arc.WITH_PLACE, (POSITION, VELOCITY))):
        along = np.array(ca.evalf(arc.along(ca.DM(error), stored(P), parts))).ravel()
        for part, vector in ((POSITION, PLACE), (VELOCITY, GAINED)):
            exact = vector - turn @ vector if part in moved else error[part]
            assert along[part] == pytest.approx(exact, abs=1e-3 * np.linalg.norm(vector) * 0.12)
    independent = np.diag(np.square([1.0] * 6 + [0.1] * 3))
    assert np.array(ca.evalf(arc.along(ca.DM(error), stored(independent)))).ravel() == pytest.approx(error)
    there = arc.along(ca.DM(error), stored(P))
    assert np.array(ca.evalf(arc.back(there, stored(P)))).ravel() == pytest.approx(error, abs=1e-4)


def test_a_smoother_turns_the_velocity_and_not_the_place():
    """The place of a fix after an outage is measured, without an arc."""
    n, state = SMOOTHING.n, SMOOTHING.forward.state
    P, error, plain = np.eye(n), np.zeros(n), np.zeros(n)
    P[:9, :9] = covariance([0.02, 0.03, 0.1])
    error[:9] = np.concatenate([np.cross(PLACE, PSI), np.cross(GAINED, PSI), PSI])
    plain[:6] = error[:6]
    x = constants(state, covariance=symmetric.triangle(ca.DM(P)).full().ravel())
    one, other = (SMOOTHING.corrected(x, ca.SX(each)) for each in (error, plain))
    q_one, q_other, turned = (np.array(ca.evalf(ca.SX(row))).ravel() for row in (one["q_ew"], other["q_ew"], one["velocity_w"]))
    assert q_one == pytest.approx(q_other, rel=0.0, abs=1e-4 / geodesy.A)
    assert number(one["height"]) == pytest.approx(number(other["height"]), abs=1e-4)
    exact = Rotation.from_rotvec(PSI).apply(GAINED) - GAINED
    assert turned == pytest.approx(exact, abs=2e-3) and np.abs(exact + error[VELOCITY]).max() > 0.05


def test_the_moment_is_that_of_half_the_product_of_the_attitude_and_what_comes_with_it():
    P, rng = covariance([0.02, 0.03, 0.1]), np.random.default_rng(0)
    psi = rng.normal(size=(400_000, 3)) * [0.02, 0.03, 0.1]
    half = 0.5 * np.cross(psi, np.cross(GAINED, psi))
    moment = np.array(ca.evalf(arc.moment(stored(P))))
    assert moment == pytest.approx(half.T @ half / len(psi), abs=0.02 * np.trace(moment))
    assert np.array(ca.evalf(arc.moment(stored(covariance([0.0, 0.0, 0.0]))))) == pytest.approx(np.zeros((3, 3)), abs=1e-12)


@pytest.mark.slow
def test_a_car_that_leaves_with_a_heading_of_two_sigmas_is_as_sure_of_its_speed_as_it_can_be():
    """Fixes each 5 s: the speed along the track was up to 10 sigmas off between the first of them."""
    scenario = changed(
        "car-city-drive",
        gnss={"interval_s": 5.0, "outages_s": []},
        knowledge={"heading_sigma_deg": 2.84, "heading_error_deg": 5.4},
    )
    plan = make_plan(scenario, "fusion", 24, first_seed=30000, duration_s=45.0)
    (block,) = [run_block(plan, number) for number in range(len(plan.blocks))]
    departed = plan.times > 30.5
    ratio = np.abs(block["error"] / block["sigma"])[:, departed, CHANNELS.index("ve_mps")]
    assert np.mean(ratio > 3.0) < 0.01
    assert np.mean(block["nees"][:, 2]) < 15.0  # just after the first fix, which an arc is counted for
    assert 7.0 < np.mean(block["nees"][:, departed]) < 13.0  # 1.9 sigmas of heading are 2.6 above 9 until it is found
