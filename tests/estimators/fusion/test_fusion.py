"""Fusion filters as estimators: choice of states and aids, wrong choices, notes, known errors found."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from constants import number
from driven import columns_of, fed_outputs
from peers import package
from places import ROOT

import insenv
from insenv import InputError
from insenv.estimators.contract import Drive
from insenv.estimators.fusion import fusion
from insenv.estimators.fusion.family import aids_of, prepared
from insenv.estimators.fusion.non_holonomic import NON_HOLONOMIC, UNKNOWN_ARM
from insenv.estimators.knowledge import Knowledge
from insenv.runs.ensemble import ensemble
from insenv.scenario import build, load
from insenv.sensors.data_sheet import ImuDataSheet

N380 = ROOT / "examples" / "n380-car-position-only.toml"
WHEELED = ["gnss", "zero_velocity", "non_holonomic"]
UNIT = ["gyro_scale", "gyro_misalignment", "accel_scale", "accel_misalignment"]


def test_states_and_aids_follow_from_the_unit_the_instruments_and_the_vehicle():
    def titles(name):
        return build(load(name)).adapted("fusion").title

    assert titles("car-city-drive") == (
        "36 states: navigation, biases, gyro_scale, gyro_misalignment, accel_scale, accel_misalignment, gnss_wander; "
        "aids: gnss, zero_velocity"
    )
    assert titles("car-survey") == "21 states: navigation, biases, gyro_scale, accel_scale; aids: gnss, zero_velocity"
    assert "gnss_lever_arm, gnss_delay" in titles("car-unknown-receiver")
    odometer_car = titles("car-odometer")
    assert "odometer_scale" in odometer_car and odometer_car.endswith("aids: gnss, odometer, non_holonomic, zero_velocity")
    ship = titles("ship-dvl")  # without them the sigma of heading was 1.5 to 6 times the limit
    assert "gyro_scale, gyro_misalignment, accel_scale" in ship and ship.endswith("aids: gnss, dvl")
    hover = titles("multirotor-hover")
    assert "hard_iron" in hover and "gyro_scale, gyro_misalignment, accel_scale" in hover
    assert hover.endswith("aids: gnss, barometer, magnetometer")


def test_scale_factors_with_a_correlation_time_are_states_that_drift():
    drifting, constant = (
        build(changed("car-survey", imu={"gyro_scale_factor_time_s": time, "accel_scale_factor_time_s": time}))
        for time in (14400.0, 0.0)
    )
    filter = drifting.adapted("fusion")
    rows = drifting.parameters_of(filter)
    assert (rows["gyro_scale_time"], rows["accel_scale_time"]) == (14400.0, 14400.0)
    assert "gyro_scale_time" not in constant.adapted("fusion").model.parameters
    mine = drifting.adapted(fusion(UNIT, ["gnss"], "mine")).model.parameters
    assert {"gyro_scale_time", "accel_scale_time"} <= set(mine.names)
    assert drifting.adapted("fusion-smoother").smoothing.backward.parameters["accel_scale_time"].unit == "s"


@pytest.mark.slow
def test_the_heading_of_the_survey_is_as_stated():
    """Eight seeds; to a filter with constant scale factors neither bound applies."""
    found = ensemble("car-survey", "fusion", range(662000, 662008), records=336)
    errors, late = found.attitude_errors_deg("fusion")[..., 2], found.time > 900.0
    sigma = np.degrees(found.outputs["fusion"]["attitude_sigma"][..., 2])
    assert np.sqrt(np.mean(errors[:, late] ** 2)) < 0.0075
    assert 0.6 < np.sqrt(np.mean((errors / sigma)[:, late] ** 2)) < 1.4


def test_the_same_filter_is_the_same_object():
    """Its model is then written out, compiled and loaded once in a process, and the smoother's both models too."""

    def chosen(estimator, seed):
        return build(load("car-survey"), seed=seed).adapted(estimator)

    assert chosen("fusion", 1).model is chosen("fusion", 2).model
    assert chosen("fusion-smoother", 1).smoothing is chosen("fusion-smoother", 2).smoothing
    assert fusion(UNIT, ["gnss"], "mine").model is fusion(UNIT, ["gnss"], "mine").model
    assert fusion(UNIT, ["gnss"], "mine").model is not fusion(UNIT[1:], ["gnss"], "mine").model


def test_what_a_state_stands_for_is_not_counted_twice():
    sheet = ImuDataSheet(
        gyro_scale_sigma=3e-4, gyro_misalignment_sigma=4e-4, accel_scale_sigma=1e-3, accel_bias_sigma=0.01,
        bare_accel_bias_sigma=2e-3,
    )  # fmt: skip
    known = Knowledge(0.5, 0.5, 10.0, 0.01, rotation_error=5e-4, thrust_error=1e-3, sensors=sheet)
    table = fusion(UNIT, ["gnss"], "all").model.parameters
    without = prepared(known, table, ())
    assert without["rotation_error"] == 5e-4 and without["accel_bias_sigma"] == 0.01
    scales = prepared(known, table, ("gyro_scale", "accel_scale"))
    assert scales["rotation_error"] == pytest.approx(4e-4) and scales["thrust_error"] == 0.0
    assert scales["accel_bias_sigma"] == 2e-3  # the unit has no misalignment, which the bias would have to stand for
    assert prepared(known, table, UNIT)["rotation_error"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("states", "words"), [
    (["gyro_scal"], "'gyro_scal'.* 'gyro_scale'"), (["gyro_scale", "gyro_scale"], "state 'gyro_scale' is given twice"),
    ([3], "class ErrorState"), (None, "a list of names"),
])  # fmt: skip
def test_wrong_states_are_named(states, words):
    with pytest.raises(InputError, match=words):
        fusion(states, ["gnss"])


def with_barometer_alone(level_deg):
    """A ship whose level is uncertain: the vertical channel takes g tilt^2 / 2 for a Coriolis acceleration."""
    known = {"tilt_sigma_deg": level_deg, "heading_sigma_deg": 0.5}
    return changed("ship-dvl", gnss=None, dvl=None, barometer={"grade": "ms5611", "interval_s": 1.0}, knowledge=known)


WHEELS, SLOWER = ["odometer", "non_holonomic"], changed("car-odometer", rate_hz=60.0)


@pytest.mark.parametrize(("scenario", "filter", "settings", "said", "unsaid"), [
    ("car-survey", fusion(["gyro_misalignment"], ["gnss"]), {}, "standard deviation at the start is 0", "neither"),
    pytest.param("multirotor-hover", "fusion", {"states": ["gnss_wander"]}, "neither estimates nor counts as noise", "is 0",
                 marks=pytest.mark.slow),  # 13 m off
    (SLOWER, fusion([], ["odometer"]), {}, "holds the height", "at the start is 0"),  # 1.5 km after 600 s
    (SLOWER, fusion([], WHEELS), {}, "none of the aids shows the heading", "holds the height"),
    (with_barometer_alone(0.2), "fusion", {}, "holds the horizontal velocity", "neither states"),
    (with_barometer_alone(0.1), "fusion", {}, "fusion: ", "holds the horizontal velocity"),
    ("car-city-drive", "fusion", {"aids": ["gnss"], "states": []}, "standing_sigma: set without effect", "gnss_gate"),
])  # fmt: skip
def test_notes_on_the_choice(scenario, filter, settings, said, unsaid):
    seconds = 100.0 if said == "holds the height" or unsaid == "holds the height" else 2.0
    report = insenv.run(scenario, filter, duration_s=seconds, settings={"fusion": settings} if settings else None)
    notes = " ".join((*report.notes, *report.results[0].notes))
    assert said in notes and unsaid not in notes


@pytest.mark.slow
def test_a_magnetometer_shows_a_heading_of_which_nothing_is_known():
    knowledge = {"heading_sigma_deg": 180.0, "heading_error_deg": -150.0}
    report = insenv.run(changed("multirotor-hover", knowledge=knowledge), "fusion", duration_s=12.0, seed=12)
    assert "start-uncertain" not in [note.code for note in report.results[0].notes]
    late = report.to_dataframe().loc[5.0:]
    assert (late["error_heading_deg"].abs() < 3 * late["sigma_heading_deg"]).all() and late["sigma_heading_deg"].max() < 2.0


@pytest.mark.slow
def test_a_delay_and_a_lever_arm_are_found():
    """0.2 s and 1 m unknown (1 sigma), fixes 0.4 s late: to 10 ms and 5 cm where the drive shows them."""
    plant = build(load("car-unknown-receiver"), seed=4, duration_s=200.0)
    columns, filter = columns_of(plant), plant.adapted("fusion")
    outputs = fed_outputs(filter.model, columns, plant.parameters_of(filter), 200)
    true_delay, true_arm = columns["gnss_delay_true"][-1], columns["antenna_lever_arm_true"][-1]
    assert abs(outputs["gnss_delay"][-1, 0] - true_delay) < 0.01
    found, sigma = outputs["gnss_lever_arm"][-1], outputs["gnss_lever_arm_estimate_sigma"][-1]
    assert np.all(np.abs(found - true_arm)[:2] < 0.05)
    assert np.all(np.abs(found - true_arm) < 4 * sigma) and sigma[2] > 0.02  # a level drive hardly shows the height
    assert outputs["fix_refused_count"][-1] == 0


@pytest.mark.parametrize(("grade", "seed"), [pytest.param("navigation", 10022, marks=pytest.mark.slow), ("industrial", 10001)])
def test_a_parked_car_stays_where_it_is(grade, seed):
    """By detection of rest alone these drove off, by 10 km and more: their start, or their heading, was 3 sigmas off."""
    result = insenv.run(changed("car-parked", imu={"grade": grade}, rate_hz=50.0), "fusion", seed=seed).results[0]
    assert result.health is not None and list(result.health.aids) == ["in_place"]
    for channel, largest in (("north_m", 10.0), ("vn_mps", 0.5), ("roll_deg", 2.0)):
        assert np.abs(result.errors[channel]).max() < largest
    assert not result.too_sure()
    assert not any("holds the height" in note or "shows the heading" in note for note in result.notes)


def test_only_what_stays_on_wheels_has_a_fixed_place():
    assert aids_of(Drive("here", frozenset(["gnss"]), True, vehicle="car")) == ("gnss", "zero_velocity")
    assert aids_of(Drive("here", frozenset(), None, vehicle="car")) == ("zero_velocity",)
    assert aids_of(Drive("here", frozenset(), True, vehicle="ship")) == ("moored",)


@pytest.mark.slow
@pytest.mark.parametrize("section", ["barometer", "magnetometer", "dvl", "odometer", "heading"])
def test_a_perfect_instrument_leaves_the_filter_regular(monkeypatch, section):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    data = load("car-survey").model_dump(mode="json", exclude_unset=True)
    data[section] = {"grade": "perfect"}
    result = insenv.run(data, "fusion", duration_s=20).results[0]
    assert all(np.isfinite(values).all() for values in result.errors.values())
    for channel in ("down_m", "heading_deg", "vn_mps"):
        assert np.abs(result.errors[channel][-1]) < 6 * result.sigma[channel][-1], channel


@pytest.mark.slow
def test_a_real_drive_has_its_heading_within_its_sigma():
    """The unit is turned by 2 deg against the wheels; taken as 0 the heading is 1.6 deg off, 9 stated sigmas."""
    package("onavdata")
    result = insenv.replay(N380, "fusion", settings={"fusion": {"aids": WHEELED}}).results[0]
    moving = result.time >= 350.0
    heading, sigma = result.errors["heading_deg"][moving], result.sigma["heading_deg"][moving]
    assert abs(heading[-1]) < 2 * sigma[-1]  # at rest, at the end
    assert np.sqrt(np.nanmean((heading / sigma) ** 2)) < 1.0
    place = [np.sqrt(np.nanmean(result.errors[name][moving] ** 2)) for name in ("north_m", "east_m", "down_m")]
    assert np.all(np.array(place) < 0.33)
    mounting, stated = (np.degrees(result.outputs[f"odometer_mounting_error{end}"][-1]) for end in ("", "_estimate_sigma"))
    assert np.all(stated < 0.5) and abs(mounting[1] + 2.0) < 3 * stated[1]
    assert not any("does not fit" in note for note in result.notes)


def test_the_mounting_is_a_state_and_the_lever_arm_is_noise_where_neither_is_told():
    untold, told = (build(load(name), seed=1, duration_s=2.0) for name in ("car-city-drive", "car-odometer"))
    filter = insenv.fusion([], WHEELED)
    assert float(untold.parameters_of(untold.adapted(filter))["non_holonomic_arm_sigma"]) == UNKNOWN_ARM
    assert float(told.parameters_of(told.adapted(filter)).get("non_holonomic_arm_sigma", 0.0)) == 0.0
    chosen = insenv.run("car-city-drive", "fusion", duration_s=2.0, settings={"fusion": {"aids": WHEELED}}).results[0]
    assert "odometer_mounting_error" in chosen.outputs
    exact, known = (insenv.run(name, filter, duration_s=2.0).results[0].notes for name in ("car-city-drive", "car-odometer"))
    assert any("use the state odometer_mounting_error" in note for note in exact)
    assert not any("the mounting of the unit relative to the wheels is not stated" in note for note in known)


def test_the_constraint_of_wheels_is_loosened_by_the_lateral_acceleration_of_a_turn():
    """12 m/s forward and 5 sideways, 2 m/s^2 forward, 5 to the right: slip sideways, pitch down, the arm's error."""
    rows = {"sigma": 0.05, "slip": 0.003, "pitch": 0.01, "arm_sigma": 0.2, "interval": 0.5}
    p = SimpleNamespace(**{f"non_holonomic_{name}": value for name, value in rows.items()})
    rate, force = np.array([0.1, -0.2, 0.4]), np.array([2.0, 5.0, -9.8])
    u = SimpleNamespace(delta_angle=ca.SX(rate * 0.01), delta_velocity=ca.SX(force * 0.01), dt=0.01)
    found = number(NON_HOLONOMIC.variance(p, SimpleNamespace(velocity_w=ca.SX([12.0, 5.0, 0.0])), u, None))
    arms = np.cross(rate, 0.2 * np.eye(3))  # a row for an arm that is off along each axis; ten uses in a turn of 5 s
    own = 0.05**2 + 10 * np.sum(arms**2, axis=0)[1:]
    assert found == pytest.approx(own + 13.0**2 * np.array([0.003 * 5.0, 0.01]) ** 2, rel=1e-12)
