"""Errors are as large as the estimators state: on rest, sway, waves and gusts, at all times."""

import dataclasses

import casadi as ca
import numpy as np
import pytest
from simulated_log import simulated_log

from insenv import geodesy, replay, run
from insenv.campaigns.block import run_block
from insenv.campaigns.plan import make_plan
from insenv.campaigns.variation import parse_variation
from insenv.estimators import get
from insenv.estimators.parts import applicability, handover
from insenv.scenario import build, load

SEEDS = 9000
"""First of the seeds: nothing was chosen on them."""
IN_PLACE = ("q-method", "qakf", "qakf-improved", "inertial-fir", "ecef-kf", "gyrocompass", "analytic")
SCENARIOS = ("ship-swaying", "ship-moored-paper", "car-parked", "car-parked-paper", "turntable-quaternion")


def beyond(scenario, estimator, runs=32):
    """Share of the errors of attitude, over the runs and times, beyond three stated standard deviations, by channel."""
    plan = make_plan(scenario, estimator, runs, first_seed=SEEDS)
    found = [run_block(plan, block) for block in range(len(plan.blocks))]
    error, sigma = (np.concatenate([part[name] for part in found])[..., :3] for name in ("error", "sigma"))
    return np.mean(np.abs(error) > 3 * sigma, axis=(0, 1))


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["q-method", "qakf-improved", "ecef-kf", "gyrocompass", "analytic"])
def test_three_sigma_holds_in_an_irregular_sea(estimator):
    """Before: q-method 6 %, qakf-improved 5 %, ecef-kf 49 %, gyrocompass 41 %, analytic 100 %."""
    assert np.all(beyond("ship-irregular-sea", estimator) < 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("estimator", IN_PLACE)
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_three_sigma_holds_in_place(scenario, estimator):
    # one seed of 64 on which qakf converges slowly is 1.6 %; people who step into the car move it for 2 % of the time
    allowed = {"qakf": 0.035, "analytic": 0.03}.get(estimator, 0.015)
    assert np.all(beyond(scenario, estimator, 64) < allowed)


@pytest.mark.slow
def test_qakf_says_when_it_has_not_converged():
    """On some of these seas it is wrong by tens of degrees for minutes; its sigma was the sensors' limit, 0.05 deg."""
    assert np.all(beyond("ship-irregular-sea", "qakf", 64) < 0.05)


def test_an_alignment_on_sway_is_unknown_before_its_windows_have_settled():
    result = run("ship-swaying", "q-method", duration_s=30.0).results[0]
    assert result.sigma["heading_deg"][-1] > 90 and result.sigma["roll_deg"][-1] > 1


def test_the_answer_of_a_vehicle_at_rest_is_stated_as_the_sensors_allow():
    """What the answer moves by noise alone is not counted twice."""
    result = run("car-parked-paper", "q-method").results[0]
    known = get("q-method").model
    assert result.sigma["heading_deg"][-1] == pytest.approx(0.039, rel=0.15) and known.id == "q-method"


def test_the_hand_over_carries_what_biases_do():
    """The balance of specific force and Earth rate in place, against differences of the rates at a misalignment."""
    latitude, g, gyro, accel = 0.8, 9.81, 3e-8, 5e-4
    noise = np.array([1e-5, 2e-5, 3e-4])
    level, heading = accel / g, np.hypot(gyro / (geodesy.OMEGA_IE * np.cos(latitude)), accel / g * np.tan(latitude))
    sigma = np.sqrt(noise**2 + np.array([level, level, heading]) ** 2)
    found = handover.aligned(ca.DM(sigma), latitude, g, gyro, accel)
    P, by_accel, by_gyro = (np.array(ca.evalf(part)) for part in dataclasses.astuple(found))
    assert np.diag(P) == pytest.approx(sigma**2, rel=1e-9)
    f, omega = np.array([0, 0, -g]), geodesy.OMEGA_IE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    for axis in range(3):
        b = np.eye(3)[axis] * accel
        phi = by_accel[:, axis] / accel  # the misalignment that this bias causes
        assert (np.cross(f, phi) + b)[:2] == pytest.approx(0, abs=1e-12)
        assert np.cross(omega, phi)[1] == pytest.approx(0, abs=1e-15)
        phi = by_gyro[:, axis] / gyro
        assert (np.cross(omega, phi) + np.eye(3)[axis] * gyro)[1] == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize(("heading_deg", "said"), [(10.0, False), (12.0, True), (60.0, True)])
def test_a_start_heading_is_named_from_where_the_sigmas_become_too_small(heading_deg, said):
    sigmas = {"tilt_sigma": np.radians(1.0), "heading_sigma": np.radians(heading_deg)}
    assert bool(applicability.linear_start(sigmas, 100.0)) == said


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["loosely-coupled", "fusion"])
def test_three_sigma_holds_up_to_the_heading_that_has_no_note(estimator):
    """In flight, where it falls first: 0.8 % of 128 seeds at 10 deg, 1.9 % at 15 deg, 4.5 % at 20 deg."""
    loaded = load("aircraft-inflight-alignment")
    heading = np.degrees(applicability.LINEAR_HEADING)
    told = {
        "heading_sigma_deg": heading,
        "tilt_sigma_deg": 1.0,
        **{f"{name}_error_deg": None for name in ("roll", "pitch", "heading")},
    }
    scenario = loaded.model_copy(update={"knowledge": loaded.knowledge.model_copy(update=told)})
    assert np.all(beyond(scenario, estimator, 128) < 0.02)  # one run throughout is 0.8 %


def test_a_linearised_filter_says_that_its_start_is_too_uncertain():
    small = {"tilt_sigma": np.radians(1.0), "heading_sigma": np.radians(10.0)}
    assert applicability.linear_start(small, 100.0) == ()
    (note,) = applicability.linear_start({**small, "heading_sigma": np.radians(45.0)}, 100.0)
    assert "45 deg of heading" in note and "aqe-sukf" in note
    noted = {r.estimator: r.notes for r in run("car-unknown-heading", ["loosely-coupled", "aqe-sukf"], duration_s=2.0).results}
    assert note in noted["loosely-coupled"] and note not in noted["aqe-sukf"]


def test_scale_factors_that_are_counted_as_noise_are_noted():
    """City drive, 64 seeds: attitude is beyond three stated sigmas in 4 % of the records, that of the smoother in 13 %."""
    for result in run("car-city-drive", ["loosely-coupled", "aqe-sukf", "smoother"], duration_s=5.0).results:
        assert any("misalignments of the gyros (1.1 mrad)" in note for note in result.notes), result.estimator
    plant, estimator = build(load("car-city-drive")), get("loosely-coupled")
    rows = plant.parameters_of(estimator, {})
    assert estimator.notes(rows, 5.0) and not estimator.objections(rows, 5.0)  # it counts as aligned all the same
    bias = {"accel_bias_sigma": 0.01}
    assert applicability.unmodelled_motion({**bias, "rotation_error": 3e-4}, 100.0) == ()
    (note,) = applicability.unmodelled_motion({**bias, "rotation_error": 4e-4}, 100.0)
    assert "0.4 mrad" in note and "three stated sigmas" in note


def test_scale_factors_set_smaller_than_those_of_the_unit_are_noted():
    """City drive with the grade autopilot and the tactical unit's scale factors set by hand: the mean NEES is 69."""
    scenario = load("car-city-drive")

    def notes(result):
        return [note for note in result.notes if "mrad is set" in note]

    assert not any(map(notes, run(scenario, ["loosely-coupled", "smoother", "fusion"], duration_s=2.0).results))
    poor = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": "autopilot"})})
    for result in run(poor, ["loosely-coupled", "smoother"], duration_s=2.0).results:
        gyro, accel = notes(result)
        assert "rotation_error = 1.1 mrad is set, that of the unit is 14 mrad" in gyro and "thrust_error = 1.1 mrad" in accel
    assert not any(map(notes, run(poor, ["fusion"], duration_s=2.0).results))  # which takes them from the data sheet
    varied = [parse_variation("imu.grade=choice(tactical, autopilot)")]
    assert len(notes(make_plan(scenario, "loosely-coupled", 2, duration_s=2.0, variations=varied))) == 2
    assert not notes(make_plan(scenario, "loosely-coupled", 2, duration_s=2.0))

    tuning = {"loosely-coupled": dict(scenario.estimator["loosely-coupled"])}
    log = {"duration_s": 60.0, "initial": {"static_until_s": 30.0, "heading_deg": 90.0}, "estimator": tuning}
    for grade, count in (("tactical", 0), ("autopilot", 2)):
        (result,) = replay(simulated_log(scenario, grade=grade, **log), ["loosely-coupled"]).results
        assert len(notes(result)) == count
    whole = {"arw_deg_sqrt_h": 0.3, "vrw_mps_sqrt_h": 0.1, "gyro_bias_deg_h": 20.0, "accel_bias_ug": 500.0}
    log["estimator"] = {"loosely-coupled": {**whole, "rotation_error": 1e-3}}
    assert not notes(replay(simulated_log(scenario, grade="autopilot", **log), ["loosely-coupled"]).results[0])


def test_a_linearised_filter_of_a_unit_without_noise_is_noted():
    """aircraft-survey: its unit has biases only, and the filter trusts its linear model to 1e-4 deg within minutes."""
    found = run("aircraft-survey", ["loosely-coupled", "aqe-sukf"], duration_s=5.0).results
    assert any("about 0.0017 deg" in note for note in found[0].notes)
    assert not any("white noise" in note for note in found[1].notes)


def test_a_heading_that_only_manoeuvres_show_is_noted():
    known = {"heading_sigma": np.radians(20.0)}
    assert applicability.unseen_heading(known, 100.0) == ()
    assert any("known to 45 deg only" in n for n in run("car-unknown-heading", "aqe-sukf", duration_s=2.0).results[0].notes)


def test_gyrocompass_from_a_heading_that_is_far_off():
    """The loop turns by the sine of the error: from 150 deg the sigma stays as large as the error, 5 times before."""
    found = run("large-misalignment-extreme", "gyrocompass", seed=30000).results[0]
    error, sigma = found.errors["heading_deg"], found.sigma["heading_deg"]
    assert (np.abs(error) < 3 * sigma).all() and np.abs(error)[found.time > 400].max() > 30.0
    assert any("from 180 deg not at all" in note for note in found.notes)
    assert applicability.far_heading({"start_heading_sigma": 0.5}, 100.0) == ()
