"""`fusion` at a mooring: the sway as oscillators among the states, the heading by the Earth's rotation from any heading."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from constants import number
from scipy.linalg import block_diag, expm
from scipy.spatial.transform import Rotation

import insenv
from insenv import InputError, fusion
from insenv.core import symmetric
from insenv.core.model import Values
from insenv.estimators.fusion import azimuth, moored
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.kalman import elementary, propagate
from insenv.geodesy import OMEGA_IE, q_ew_from_geodetic

PERIODS, SIGMAS, DAMPING = (90.0, 40.0, 20.0, 9.0, 6.0), np.array([0.1, 0.4, 0.3, 0.2, 0.5]), 0.2
PARAMETERS = Values(sway_period=ca.SX(PERIODS), sway_damping=DAMPING, sway_sigma=ca.SX(SIGMAS))


@pytest.mark.parametrize("duration", [0.01, 0.05, 1.0])
def test_oscillators_follow_their_equation(duration):
    pairs = [2 * np.pi / period * np.array([[-2 * DAMPING, -1.0], [1.0, 0.0]]) for period in PERIODS]
    Phi = number(moored.oscillation(PARAMETERS, duration))
    assert expm(block_diag(*pairs * 3) * duration) == pytest.approx(Phi, abs=1e-12)
    variance = np.tile(np.repeat(SIGMAS, 2), 3) ** 2  # stationary: nothing is lost and nothing grows
    noise = number(moored.SWAY.process.noise(PARAMETERS, duration))
    assert np.diag(Phi @ np.diag(variance) @ Phi.T) + noise == pytest.approx(variance, rel=1e-9)


def test_a_transition_of_any_form_propagates_exactly():
    Phi, root = np.random.default_rng(1).normal(size=(2, 5, 5)) + np.array([3.0, 0.0])[:, None, None] * np.eye(5)
    found = propagate(symmetric.triangle(ca.SX(root @ root.T)), elementary(ca.SX(Phi)), ca.SX.ones(5))
    assert Phi @ root @ root.T @ Phi.T + np.eye(5) == pytest.approx(number(symmetric.full(found, 5)), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("heading", [0.3, 2.0, -2.5])
def test_the_azimuth_is_that_of_the_estimated_rotation(heading):
    """The fold gives w the azimuth of h, with the displacement turned; its error is that across h, with the sign of psi."""
    full = OMEGA_IE * np.cos(0.8)
    across, P = full * 1e-3 * np.array([-np.sin(heading), np.cos(heading)]), np.zeros((11, 11))
    P[9:, 9:] = np.outer(across, across)
    rate = full * np.array([np.cos(heading) - 1, np.sin(heading)])
    start = {"q_ew": q_ew_from_geodetic(0.8, 0.2, 0), "height": ca.SX(0), "velocity_w": ca.SX([0.5, 0.2, 0])}
    x = Values(
        **start, azimuth_rate=ca.SX(rate), sway=ca.SX.zeros(6 * moored.COUNT), mooring_centre=ca.SX([1.0, 0, 0]),
        q_wb=ca.SX([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]), mooring_axes=ca.SX([1.0, 0]), sway_arm=ca.SX([-2.0, 0, 0, 0, 0, 0]),
    )  # fmt: skip
    x, P9 = azimuth.folded(x, ca.SX(P), {azimuth.STATE.name: slice(9, 11)})
    assert np.arctan2(*number(strapdown.C_nw(x.q_ew))[[1, 0], 0]) == pytest.approx(-heading, abs=1e-6)
    assert number(P9)[[0, 1, 3, 4, 8], 8] == pytest.approx(np.array([0.0, -3.0, 0.2, -0.5, 1.0]) * 1e-6, abs=1e-11)


@pytest.mark.parametrize("sigma", [0.03, 0.5, np.pi])
def test_the_start_has_the_moments_of_the_rotation_in_an_uncertain_heading(sigma):
    turns = sigma * np.random.default_rng(2).normal(size=400_000)
    e = OMEGA_IE * np.cos(0.8) * np.array([np.cos(turns) - 1, np.sin(turns)])
    p = Values(heading_sigma=ca.SX(sigma), start_latitude=ca.SX(0.8))
    mean, stated = (number(of(p)) for of in (azimuth.STATE.started, azimuth.STATE.started_sigma))
    assert mean == pytest.approx(e.mean(axis=1), abs=0.01 * stated[0] + 0.01 * stated[1])
    assert stated[1] == pytest.approx(e[1].std(), rel=0.02) and 0.98 < stated[0] / e[0].std() < azimuth.WIDER * 1.02


def test_any_heading_is_found_in_a_slow_surge_that_alignments_take_for_tilt():
    scenario = changed("ship-slow-surge", rate_hz=10.0)
    (result,) = insenv.run(scenario, "fusion", seed=970001).results
    channels = ("roll_deg", "pitch_deg", "heading_deg", "north_m", "east_m")
    assert all(np.max(np.abs(result.errors[name]) / result.sigma[name]) < 4.5 for name in channels)
    stated = [result.sigma["heading_deg"][np.searchsorted(result.time, seconds - 0.01)] for seconds in (300.0, 600.0)]
    assert stated[0] < 1.5 * 0.0432 and stated[1] < 1.2 * 0.0284  # the limits
    assert [note.split(" after")[0] for note in result.notes] == ["heading found"] and result.health.verdict == "consistent"


def test_each_oscillator_is_remembered_over_its_own_period():
    sway, before = np.random.default_rng(6).normal(size=(2, 3 * moored.COUNT, 2))
    p = Values(sway_period=ca.SX(PERIODS), moored_interval=8.0)
    x = Values(
        sway=ca.SX(sway.ravel()), sway_rms=ca.SX(np.abs(before[:, 0])), q_wb=ca.SX([1.0, 0, 0, 0]), moored_count=ca.SX(1),
        mooring_axes=ca.SX([0.6, 0.8]),
    )  # fmt: skip
    share = np.minimum(8.0 / np.tile(PERIODS, 3), 1.0)
    expected = np.sqrt((1 - share) * before[:, 0] ** 2 + share * np.mean(sway**2, axis=1))
    assert number(moored._remembered(p, x, None)["sway_rms"]).ravel() == pytest.approx(expected)


@pytest.mark.parametrize(("amplitude_m", "period_s", "said"), [(1.5, 40.0, True), (0.3, 40.0, False), (1.5, 9.0, False)])
def test_a_slow_sway_beyond_what_is_assumed_is_said(amplitude_m, period_s, said):
    sway = {"north": [{"amplitude_m": amplitude_m, "period_s": period_s}], "down": [{"amplitude_m": 2.0, "period_s": 40.0}]}
    scenario = changed("ship-slow-surge", vehicle={"sway": sway}, rate_hz=10.0)
    (result,) = insenv.run(scenario, "fusion", seed=4, duration_s=150.0).results
    assert any("the vehicle sways slowly with" in note and "45, 22" in note for note in result.notes) == said
    assert (result.health.verdict == "contradicted") == said == ("sway-large" in result.doubts)
    of_axis = np.sum(np.reshape(result.outputs["sway_rms"][-1], (3, moored.COUNT)), axis=1)  # the assumed north is any one
    assert [np.hypot(*of_axis[:2]), of_axis[2]] == pytest.approx([amplitude_m / np.sqrt(2), 2.0 / np.sqrt(2)], rel=0.3)


def test_a_log_without_attitude_is_aligned():
    log = insenv.record(changed("ship-slow-surge", rate_hz=20.0), seed=3, duration_s=200.0)
    unknown = {f"{name}_deg": None for name in ("roll", "pitch", "heading", "tilt_sigma", "heading_sigma")}
    known = log.description
    log = replace(log, description=known.model_copy(update={"initial": known.initial.model_copy(update=unknown)}))
    (result,) = insenv.replay(log, "fusion").results
    assert result.sigma["heading_deg"][-1] < 0.3 and abs(result.errors["heading_deg"][-1]) < 0.9
    assert any("a heading that is not known" in note for note in result.notes)
    with pytest.raises(InputError, match=r"floats in place, and \[initial\] has no heading_deg: fusion finds the heading"):
        insenv.replay(log, "wander-sins")


def test_what_a_mooring_does_not_go_with_is_said():
    for states, lacking in (
        (["sway", "sway_arm"], "mooring_centre"), (["mooring_centre"], "sway, sway_arm"), ([], "sway, mooring_centre, sway_arm")
    ):  # fmt: skip
        with pytest.raises(InputError, match=f"the aid 'moored' needs the states {lacking} too"):
            fusion(states, ["moored"])
    with pytest.raises(InputError, match="with the aids gnss, moored: allowed is moored, alone or with barometer"):
        fusion(["sway", "mooring_centre", "sway_arm", "azimuth_rate"], ["gnss", "moored"])
    (result,) = insenv.run(changed("ship-slow-surge", imu={"grade": "tactical"}, rate_hz=20.0), "fusion", duration_s=30).results
    assert any("not applicable for heading" in note or "heading is good to" in note for note in result.notes)
    assert any("the heading is not found to 1 deg" in note for note in result.notes)


def test_all_stated_sigmas_grow_with_a_slow_horizontal_sway_that_is_larger_than_assumed():
    sigma = np.array([0.09, 0.3, 0.3, 0.3, 0.3])
    p = Values(sway_period=ca.SX(PERIODS), sway_sigma=ca.SX(sigma))
    for oscillator, size, factor in ((1, 0.6, 2.0), (5, 0.18, 2.0), (1, 0.2, 1.0), (3, 9.0, 1.0), (11, 9.0, 1.0)):
        rms = np.zeros(3 * moored.COUNT)
        rms[oscillator] = size  # of north, east, down; the periods of the last two of each are below 15 s
        assert number(moored.AID.widened(p, Values(sway_rms=ca.SX(rms)))) == pytest.approx(factor)
    slow = changed("ship-slow-surge", rate_hz=10.0)
    as_is, larger = (
        insenv.run(slow, "fusion", seed=4, duration_s=60.0, settings={"fusion": {"sway_sigma_m": (sigma / k).tolist()}})
        for k in (1.0, 20.0)
    )
    assert as_is.results[0].doubts == () and larger.results[0].doubts == ("sway-large",)


@pytest.mark.parametrize(("axis", "angle"), [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)])
def test_an_arm_is_the_displacement_along_an_axis_over_an_angle(axis, angle):
    """The axes are those of the vehicle when the mooring was used first, 30 deg from w."""
    small, started = 1e-4, Rotation.from_euler("z", 30.0, degrees=True)
    C = (started * Rotation.from_rotvec(small * np.eye(3)[angle])).as_matrix()
    axes, found = ca.SX([np.cos(np.radians(30.0)), np.sin(np.radians(30.0))]), []
    for arm in np.eye(6):
        moved = started.inv().apply(number(moored._in_step(ca.SX(arm), ca.SX(C), axes)).ravel())
        found.append(moved[axis] / small)
    assert np.abs(np.sort(np.abs(found))) == pytest.approx([0, 0, 0, 0, 0, 1], abs=1e-3)
    # as the cross product of the angle and an arm: x by yaw of y, negative
    by_cross = np.cross(np.eye(3)[angle], np.eye(3)[3 - axis - angle])[axis]
    assert sum(found) == pytest.approx(by_cross, abs=1e-3)


def test_an_unknown_place_at_the_start_is_no_knowledge_of_the_position():
    """The centre is known to 0.3 m from the true place, that to 1 m: the position stays known to 1 m."""
    known = {"estimator": {"fusion": {"mooring_centre_sigma_m": 0.3}}, "knowledge": {"heading_sigma_deg": 1.0}}
    summary = insenv.campaign(changed("ship-slow-surge", rate_hz=10.0, **known), "fusion", 16, seed=962000, duration_s=60.0)
    for name in ("north_m", "east_m", "down_m"):
        course = summary.courses[name]
        assert 0.98 < course.stated[-1] < 1.1 and 0.6 < course.rms[-1] / course.stated[-1] < 1.5, name


@pytest.mark.parametrize(("roll_deg", "heave_m", "period_s", "yaw"), [
    (10.0, 1.0, 8.0, (3.0, 10.0)), (3.0, 2.0, 12.0, (3.0, 10.0)), (10.0, 1.0, 8.0, (20.0, 40.0)),
])  # fmt: skip
def test_a_heave_that_keeps_step_with_the_roll_does_not_count_as_a_bias(roll_deg, heave_m, period_s, yaw):
    """16 runs with biases of 16 mg; a NEES of 43 and 26 in the first two without the arms.  The third has a slow yaw, which one
    lever arm for all axes would take for a surge.
    """
    sway = {
        "roll": [{"amplitude_deg": roll_deg, "period_s": period_s}],
        "down": [{"amplitude_m": heave_m, "period_s": period_s}],
        "yaw": [{"amplitude_deg": yaw[0], "period_s": yaw[1]}],
    }
    scenario = changed("ship-slow-surge", vehicle={"sway": sway}, imu={"accel_bias_sigma_ug": 16_000.0}, rate_hz=10.0)
    summary = insenv.campaign(scenario, "fusion", 16, seed=963000, duration_s=300.0)
    late = summary.time > 60.0
    assert np.mean(summary.nees.mean[late]) < 11.0
    for name in ("roll_deg", "pitch_deg", "heading_deg"):
        course = summary.courses[name]
        assert np.sqrt(np.mean(course.rms[late] ** 2) / np.mean(course.stated[late] ** 2)) < 1.4, name
