"""`fusion` from a start attitude that is not known: found by velocity integration, then the filter, each with its sigma."""

from functools import cache

import numpy as np
import pytest
from changed_scenario import changed
from constants import constants, number
from driven import columns_of, fed, fed_outputs
from scipy.spatial.transform import Rotation

import insenv
from insenv import geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators.parts.error_model import GYRO, POSITION, TILT
from insenv.estimators.velocity_integration import source
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows

UNKNOWN = {"heading_sigma_deg": 180.0}
NAVIGATION = ("north_m", "east_m", "down_m", "vn_mps", "ve_mps", "vd_mps")


def seconds_of(result):
    """The time that the note of a heading found tells, s."""
    (said,) = [note for note in result.notes if "heading found" in note]
    return float(said.split("after ")[1].split(" s")[0])


def ratio(result, names, until=None):
    """Largest error over stated sigma of some channels."""
    return max(np.max(np.abs(result.errors[name][:until]) / result.sigma[name][:until]) for name in names)


@pytest.mark.parametrize(("name", "seconds", "sigma"),
    [pytest.param("car-unknown-heading", 80.0, 0.5, marks=pytest.mark.slow),
     ("aircraft-inflight-alignment", 60.0, 0.02)])  # fmt: skip
def test_a_car_and_an_aircraft_find_their_attitude(name, seconds, sigma):
    scenario = changed(name, knowledge=UNKNOWN, rate_hz=60.0)
    (result,) = insenv.run(scenario, "fusion", seed=20001, duration_s=seconds).results
    assert ratio(result, ("roll_deg", "pitch_deg", "heading_deg")) < 4.5
    assert result.sigma["heading_deg"][-1] < sigma
    assert [note.split(" after")[0] for note in result.notes if "heading" in note] == ["heading found"]


@pytest.mark.slow
def test_a_run_and_a_replay_say_when_the_heading_was_found():
    """The time of the note is that at which the filter stopped seeking, to one record; no other aid measured before."""
    scenario, duration_s = load("ship-at-sea"), 20.0
    result, alignment = insenv.run(scenario, ["fusion", "velocity-integration"], seed=20001, duration_s=duration_s).results
    assert any("by the velocity of GNSS; from then on the filter runs with all its aids" in note for note in result.notes)
    plant = build(scenario, seed=20001, duration_s=duration_s)
    filter = plant.adapted("fusion")
    runner = make_runner(filter.model, plant.parameters_of(filter))
    rows = input_rows(filter.model, columns_of(plant), plant.samples)
    sought = 0
    while runner.state["alignment_seeking"]:
        runner.run(10, rows[sought : sought + 10], 0)
        sought += 10
        shown = runner.outputs()
        assert not runner.state["alignment_seeking"] or not (shown["dvl_count"].any() or shown["nis_used_count"].any())
    found_s, record_s = sought * plant.sample_interval, float(np.diff(result.time)[0]) + 0.01
    assert 1.0 < found_s < 18.0 and -10 * plant.sample_interval <= seconds_of(result) - found_s < record_s
    assert seconds_of(alignment) <= seconds_of(result)
    assert np.all(shown["nis_used"] < 1e-2)
    runner.run(plant.samples - sought, rows[sought:], 0)
    assert runner.outputs()["dvl_count"] > 10 and runner.outputs()["nis_used_count"].min() > 20
    replayed = insenv.replay(insenv.record(scenario, seed=20001, duration_s=duration_s), "fusion", start="stated").results[0]
    assert abs(seconds_of(replayed) - seconds_of(result)) < record_s


@pytest.mark.parametrize(("name", "seconds"), [("aircraft-inflight-alignment", 12.0), ("ship-at-sea", 8.0)])
def test_before_the_attitude_is_found_velocity_and_place_have_honest_sigmas(name, seconds):
    """Of any attitude: what first order leaves out of gravity, the antenna's arm and the force made 27 sigmas of position."""
    for seed in (20000, 20001):
        scenario = changed(name, knowledge={"heading_sigma_deg": 180.0, "tilt_sigma_deg": 180.0})
        (result,) = insenv.run(scenario, "fusion", seed=seed, duration_s=seconds).results
        found = int(np.argmax(result.sigma["heading_deg"] < 7.0)) or len(result.time)
        assert found > 10 and ratio(result, NAVIGATION, found) < 5.0


def test_each_fix_counts_where_no_attitude_is_found():
    """Straight on, gyros of a degree a second: the heading stays unknown, the place that of the fixes."""
    legs = [{"drive_s": 60.0}]
    scenario = changed(
        "car-unknown-heading", knowledge=UNKNOWN, imu={"grade": "autopilot"}, vehicle={"legs": legs}, rate_hz=60.0
    )
    (result,) = insenv.run(scenario, "fusion", duration_s=60).results
    assert np.hypot(result.errors["north_m"], result.errors["east_m"]).max() < 20.0
    assert result.sigma["heading_deg"][-1] > 60.0
    assert result.health is not None and result.health.verdict == "untested" and result.health.fixes > 50
    assert any("the heading is not found" in note for note in result.notes)
    assert not any("no fix was received" in note for note in result.notes)


@pytest.mark.parametrize(("name", "grade", "tilt_sigma_deg"), [
    ("car-unknown-heading", "autopilot", 180.0),
    pytest.param("car-unknown-heading", "industrial", 3.0, marks=pytest.mark.slow),
    pytest.param("aircraft-inflight-alignment", "autopilot", 180.0, marks=pytest.mark.slow),
])  # fmt: skip
def test_gyros_that_lose_a_heading_soon_find_it_in_a_turn(name, grade, tilt_sigma_deg):
    """Ten runs that turn from 30 or 20 s on; velocity integration, which knows no biases, did not find it."""
    known = {"heading_sigma_deg": 180.0, "tilt_sigma_deg": tilt_sigma_deg, "position_sigma_m": [3.0, 3.0, 6.0]}
    scenario = changed(name, imu={"grade": grade}, gnss={"grade": "spp"}, knowledge=known, rate_hz=60.0)
    summary = insenv.campaign(scenario, "fusion", 10, seed=493000, duration_s=60.0)
    late, heading = summary.time > 45.0, summary.courses["heading_deg"]
    assert heading.rms[late].max() < 6.0 and heading.stated[-1] < 4.0
    assert 6.0 < np.mean(summary.nees.mean[late]) < 12.5
    assert sum(each.verdict == "consistent" for each in summary.health) >= 8


def test_an_outlier_is_not_the_first_fix():
    """Seed 74 has one of 40 m before the heading is found: the place was 8.7 sigmas off, and nothing said so."""
    scenario = changed("car-city-drive", knowledge={"heading_sigma_deg": 180.0, "tilt_sigma_deg": 180.0})
    (result,) = insenv.run(scenario, "fusion", seed=74, duration_s=40.0).results
    found = int(np.argmax(result.sigma["heading_deg"] < 7.0))
    assert found > 100 and ratio(result, NAVIGATION[:3], found) < 4.0
    assert result.health is not None and result.health.refused >= 1


def test_fixes_that_go_on_far_away_are_taken():
    """A place that is told wrong by far more than its sigma: after ten refused fixes the filter starts from the next."""
    plant = build(changed("ship-at-sea", knowledge=UNKNOWN), seed=1, duration_s=20.0)
    columns, filter = columns_of(plant), plant.adapted("fusion")
    told = plant.parameters_of(filter)
    outputs = fed_outputs(filter.model, columns, told | {"start_latitude": told["start_latitude"] + 1e-3}, 50)
    assert outputs["fix_refused_count"].max() == outputs["fix_refused_count"][-1] == 10
    assert abs(outputs["latitude"][-1] - columns["latitude"][-1]) * 6.4e6 < 10.0


@cache
def sailing():
    """(model, parameters, state and inputs by name at a velocity of the log) after 40 s: the level is found, no heading."""
    plant = build(load("ship-log-alignment"), seed=1, duration_s=40.0)
    columns, filter = columns_of(plant), plant.adapted("fusion")
    model, told, last = filter.model, plant.parameters_of(filter), int(np.flatnonzero(columns["dvl_new"])[-1])
    state = fed(model, {name: column[:last] for name, column in columns.items()}, told).state
    return model, told, state, {name: columns[name][last] for name in model.inputs.names if name in columns}


def started(share, **parameters):
    """State before and after a start by the log, and its velocity; share: of the alignment's stated variances."""
    model, told, state, inputs = sailing()
    state = {**state, "alignment_covariance": share * state["alignment_covariance"]}
    values = zip((model.parameters, model.state, model.inputs), ({**told, **parameters}, state, inputs), strict=True)
    p, x, u = (constants(table, **each) for table, each in values)
    changed = model.steps["alignment_start"].function(p, x, u)
    after = {name: number(value) for name, value in changed.items()}
    return state, {**state, **after}, inputs["dvl_velocity_b"]


def covariance_of(state):
    count = len(state["covariance"])
    return symmetric.full_array(state["covariance"], round((np.sqrt(8 * count + 1) - 1) / 2))


def rotation(q):
    return Rotation.from_quat(q, scalar_first=True)


def test_velocity_and_place_of_a_start_by_a_log_are_those_that_it_has_shown():
    """The velocity and the way in body axes, turned by the attitude that is found; the place errs as the way turns."""
    before, after, velocity_b = started(1e-4)
    C_wb, q_ew = rotation(after["q_wb"]), after["q_ew"]
    way_w = (C_wb * rotation(before["alignment_q_ib"]).inv()).apply(before["alignment_way"])
    assert before["alignment_seeking"] and not after["alignment_seeking"] and np.linalg.norm(way_w) > 50.0
    assert after["velocity_w"] == pytest.approx(C_wb.apply(velocity_b), abs=1e-3)
    latitude, longitude, wander = geodesy.numeric.geodetic_from_q_ew(q_ew)
    start = (before[f"alignment_{name}"] for name in ("latitude", "longitude", "height"))
    moved = geodesy.numeric.ned_offset(latitude, longitude, after["height"], *start)
    assert Rotation.from_euler("z", wander).apply(way_w) == pytest.approx(moved, abs=0.02)
    P, turned = covariance_of(after), -np.cross(np.eye(3), way_w).T
    expected = turned @ P[TILT, TILT]
    assert P[POSITION, TILT] == pytest.approx(expected, abs=0.01 * np.abs(expected).max())


def test_a_drift_of_the_gyros_bends_the_way_by_half_of_its_angle():
    small, large = 1e-6, 4e-6  # rad/s
    told = {"alignment_dvl_misalignment_sigma": 0.0, "dvl_misalignment_sigma": 0.0}
    few, many = (started(1e-4, alignment_gyro_bias_sigma=bias, **told) for bias in (small, large))
    grown = np.diag(covariance_of(many[1]) - covariance_of(few[1]))[POSITION]
    T, gone = few[0]["alignment_time"], few[1]["alignment_gone"]
    assert grown == pytest.approx(np.full(3, (large**2 - small**2) * (gone * T / 2) ** 2), rel=1e-3)


def test_errors_of_a_level_without_a_heading_belong_to_biases_in_body_axes():
    """They turn with the heading that is kept."""
    before, after, _ = started(1.0)
    assert after["alignment_seeking"]
    stated = symmetric.full_array(before["alignment_covariance"], source.N)
    C_wi = (rotation(after["q_wb"]) * rotation(before["alignment_q_ib"]).inv()).as_matrix()
    P, counted = covariance_of(after), float(sailing()[1]["alignment_gyro_bias_sigma"])
    known = np.minimum(np.diag(P[GYRO, GYRO]) / counted**2, 1.0)
    expected = -(C_wi @ (stated[source.ANSWER, source.GYRO] + stated[source.DRIFT, source.GYRO]) * known)[:2]
    assert P[TILT, GYRO][:2] == pytest.approx(expected, abs=5e-3 * np.abs(expected).max())


@pytest.mark.parametrize(("knowledge", "dvl", "seconds"),
    [({"heading_sigma_deg": 12.0}, {}, 40.0), ({}, {"interval_s": 60.0}, 300.0)])  # fmt: skip
def test_the_way_by_a_log_is_as_uncertain_as_stated(knowledge, dvl, seconds):
    """Of a heading known to 12 deg, in which the way was not laid before: 28 sigma off; of velocities a minute apart."""
    scenario = changed("ship-log-alignment", knowledge=knowledge, dvl=dvl, rate_hz=10.0)
    (result,) = insenv.run(scenario, "fusion", seed=502 if knowledge else 500, duration_s=seconds).results
    assert ratio(result, NAVIGATION[:3]) < 4.0


FAR, NEAR = ({"position_sigma_m": (sigma, sigma, 1e2)} for sigma in (2e4, 1e3))


@pytest.mark.parametrize(("scenario", "seconds", "said", "unsaid"), [
    (changed("car-city-drive", knowledge=UNKNOWN, gnss={"velocity": False}), 2.0, "too small sigmas", "heading found"),
    (load("aircraft-inflight-alignment"), 20.0, "the heading is not found to 7 deg", "heading found"),
    (changed("car-city-drive", estimator={"fusion": UNKNOWN}), 2.0, "180 deg of heading", "heading found"),
    (changed("ship-log-alignment", knowledge=FAR), 2.0, "is uncertain by 20 km", "heading found"),
    (changed("ship-log-alignment", knowledge=NEAR), 2.0, "", "place at the start"),
])  # fmt: skip
def test_notes_on_the_start(scenario, seconds, said, unsaid):
    notes = insenv.run(scenario, "fusion", seed=1, duration_s=seconds).results[0].notes
    assert any(said in note for note in notes) or not said
    assert not any(unsaid in note for note in notes)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "grade"), [("car-unknown-heading", "consumer"), ("ship-at-sea", "autopilot")])
def test_gyros_of_low_cost_do_not_make_it_too_sure(name, grade):
    """Biases of 720 deg/h, and a degree a second, of which the level was 9 sigma off; 16 runs."""
    scenario, duration_s = changed(name, imu={"grade": grade}), 120.0 if grade == "autopilot" else 90.0
    summary = insenv.campaign(scenario, "fusion", 16, seed=20000, duration_s=duration_s)
    north, level = summary.courses["north_m"], summary.courses["roll_deg"]
    assert level.rms[-1] < 1.5 * level.stated[-1]
    if grade != "autopilot":
        assert north.rms[-1] < 1.6 * north.stated[-1] < 5.0
        assert summary.nees.mean[-1] < 9.0 + 3.2  # 3 standard deviations of the mean of 16 runs
