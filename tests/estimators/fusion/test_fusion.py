"""Fusion filters as estimators: choice of states and aids, wrong choices, equal numbers everywhere, known errors found."""

import numpy as np
import pytest
from command_line import call

import insenv
from insenv import InputError
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.estimators.contract import Drive, Knowledge, SensorNotes
from insenv.estimators.fusion import fusion, odometer
from insenv.estimators.fusion.available import AIDS, STATES
from insenv.estimators.fusion.prepared import prepared
from insenv.estimators.fusion.presets import aids_of
from insenv.estimators.parts.rows import FIX_RESIDUALS
from insenv.files.resources import scenario_folder
from insenv.plant.feeding import input_rows
from insenv.scenario import build, load, parse

UNIT = ["gyro_scale", "gyro_misalignment", "accel_scale", "accel_misalignment"]


def columns_of(name, seed, duration_s):
    """The plant of a scenario and its outputs by name."""
    plant = build(load(name), seed=seed, duration_s=duration_s)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    return plant, {**columns, "dt": np.full(plant.samples, plant.sample_interval)}


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
    assert "hard_iron" in hover and "gyro_scale" not in hover and hover.endswith("aids: gnss, barometer, magnetometer")


@pytest.mark.parametrize("id", ["loosely-coupled", "fusion"])
def test_residuals_of_fixes_are_in_n(id):
    outputs = build(load("car-city-drive")).adapted(get(id), {}).model.outputs
    for row in FIX_RESIDUALS:
        assert (outputs[row.name].shape, outputs[row.name].unit, outputs[row.name].frame) == (row.shape, row.unit, "n")


def test_a_unit_without_such_errors_has_no_states_for_them():
    known = Knowledge(0.5, 0.5, 10.0, 0.01, sensors=SensorNotes(gyro_scale_sigma=1e-9, accel_scale_sigma=0.0))
    filter = get("fusion").adapted(known, Drive("here", frozenset({"gnss"}), False))
    assert filter.title == "15 states: navigation, biases; aids: gnss, zero_velocity"


def test_the_same_filter_is_the_same_object():
    """Its model is then written out, compiled and loaded once in a process, and the smoother's both models too."""

    def chosen(estimator, seed):
        return build(load("car-survey"), seed=seed).adapted(estimator)

    assert chosen("fusion", 1).model is chosen("fusion", 2).model
    assert chosen("fusion-smoother", 1).smoothing is chosen("fusion-smoother", 2).smoothing
    assert fusion(UNIT, ["gnss"], "mine").model is fusion(UNIT, ["gnss"], "mine").model
    assert fusion(UNIT, ["gnss"], "mine").model is not fusion(UNIT[1:], ["gnss"], "mine").model


def test_what_a_state_stands_for_is_not_counted_twice():
    sheet = SensorNotes(
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


@pytest.mark.parametrize(
    ("states", "aids", "words"),
    [
        (["gyro_scal"], ["gnss"], "unknown state 'gyro_scal'; did you mean 'gyro_scale'"),
        (["gyro_scale", "gyro_scale"], ["gnss"], "state 'gyro_scale' is given twice"),
        ([], [], "allowed is at least one of gnss"),
        (["odometer_scale"], ["gnss"], "nothing shows the state 'odometer_scale' without the aid odometer"),
        (["gyro_scale"], ["sonar"], "unknown aid 'sonar'"),
        ("gyro_scale", ["gnss"], "allowed is a list of names"),
        ([3], ["gnss"], "allowed is a name or an object of class ErrorState"),
        (None, ["gnss"], "allowed is a list of names"),
    ],
)
def test_wrong_states_and_aids_are_named(states, aids, words):
    with pytest.raises(InputError, match=words.replace("'", ".")):
        fusion(states, aids)


def test_a_smoother_is_asked_for_by_true_alone():
    with pytest.raises(InputError, match="smoother = 'no': allowed is True or False"):
        fusion(smoother="no")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ('fusion.states=["gyro_scal"]', "unknown name 'gyro_scal'"),
        ('fusion.aids="gnss"', "allowed is a list of names"),
        ("fusion.aids=[3]", "allowed is a list of names"),
        ("fusion.odometer_gate=3", "odometer_gate is set, and it has no such parameter (21 states: navigation"),
        ("fusion.nonsense=3", "more; the table of parameters on the estimator's page shows all)"),
    ],
)
def test_wrong_settings_are_one_sentence(setting, words):
    status, shown, said = call("run", "car-survey", "-e", "fusion", "--duration", "2", "--set", setting)
    assert status == 2 and words in said and "Traceback" not in said and not shown


def test_parameters_of_aids_that_are_not_chosen_are_named(tmp_path):
    told = "odometer_slip_sigma: set without effect, because this filter does not have the state or aid"
    table = "\n[estimator.fusion]\nodometer_slip_sigma = 0.1\ngyro_scale_sigma = 0.001\n"
    scenario, log = tmp_path / "survey.toml", tmp_path / "log.toml"
    scenario.write_text((scenario_folder() / "car-survey.toml").read_text() + table)
    assert call("new", "log", log)[0] == 0
    log.write_text(log.read_text() + table)
    for told_by in (
        insenv.run(scenario, "fusion", duration_s=2).results[0].notes,
        insenv.campaign(scenario, "fusion", runs=2, duration_s=2).notes,
        build(load(scenario)).notes_of(build(load(scenario)).adapted("fusion")),
        insenv.replay(log, "fusion").results[0].notes,
    ):
        assert told in told_by and not any("gyro_scale" in note for note in told_by)


def test_an_aid_that_the_scenario_has_not_is_refused():
    with pytest.raises(InputError, match=r"needs odometer: scenario .car-survey. has no \[odometer\]"):
        insenv.run("car-survey", fusion([], ["gnss", "odometer"]), duration_s=2)


def test_lists_name_all_states_and_aids():
    status, shown, _ = call("list", "states")
    assert status == 0 and all(name in shown for name in STATES)
    status, shown, _ = call("list", "aids")
    assert status == 0 and all(id in shown for id in AIDS)


def test_the_run_says_what_was_chosen_and_a_choice_overrides():
    report = insenv.run("car-survey", "fusion", duration_s=2)
    assert any(
        note.startswith("fusion: 21 states: navigation, biases, gyro_scale, accel_scale; aids:") for note in report.notes
    )
    report = insenv.run("car-survey", "fusion", duration_s=2, settings={"fusion": {"states": [], "aids": ["gnss"]}})
    assert any(note == "fusion: 15 states: navigation, biases; aids: gnss" for note in report.notes)


def test_a_state_without_a_sigma_is_said_to_be_idle():
    report = insenv.run("car-survey", fusion(["gyro_misalignment"], ["gnss"]), duration_s=2)
    (note,) = (note for note in report.results[0].notes if "gyro_misalignment" in note)
    assert "has no effect: its standard deviation at the start is 0" in note and "gyro_misalignment_sigma" in note


@pytest.mark.parametrize("name", [pytest.param("car-odometer", marks=pytest.mark.slow), "car-survey"])
def test_all_runners_give_the_same_bits(name):
    """6000 samples with fixes, odometer, wheels and rest: interpreter, native code, and rows of a batch."""
    plant, columns = columns_of(name, 3, 30.0)
    filter = plant.adapted(
        fusion(["gyro_scale", "accel_scale"], plant.adapted("fusion").title.rpartition("aids: ")[2].split(", "))
    )
    parameters = plant.parameters_of(filter)
    rows = input_rows(filter.model, columns, plant.samples)
    native = make_runner(filter.model, parameters, "native").run(plant.samples, rows, 100)
    slow = make_runner(filter.model, parameters, "interpreter").run(plant.samples, rows, 100)
    np.testing.assert_array_equal(slow, native)
    packed = filter.model.parameters.pack(parameters)
    batch = make_batch(filter.model, 3, np.tile(packed, (3, 1)), threads=1)
    shown = batch.run(plant.samples, np.tile(rows, (3, 1, 1)), every=100)
    for row in shown:
        np.testing.assert_array_equal(row, native)


@pytest.mark.slow
def test_a_delay_and_a_lever_arm_are_found():
    """0.2 s and 1 m unknown (1 sigma), fixes 0.4 s late: to 10 ms and 5 cm where the drive shows them."""
    plant, columns = columns_of("car-unknown-receiver", 4, 200.0)
    filter = plant.adapted("fusion")
    runner = make_runner(filter.model, plant.parameters_of(filter))
    outputs = filter.model.outputs.unpack(runner.run(plant.samples, input_rows(filter.model, columns, plant.samples), 200))
    true_delay, true_arm = columns["gnss_delay_true"][-1], columns["antenna_lever_arm_true"][-1]
    assert abs(outputs["gnss_delay"][-1, 0] - true_delay) < 0.01
    found, sigma = outputs["gnss_lever_arm"][-1], outputs["gnss_lever_arm_estimate_sigma"][-1]
    assert np.all(np.abs(found - true_arm)[:2] < 0.05)
    assert np.all(np.abs(found - true_arm) < 4 * sigma) and sigma[2] > 0.02  # a level drive hardly shows the height
    assert outputs["fix_refused_count"][-1] == 0


@pytest.mark.slow
def test_an_odometer_and_its_mounting_are_found():
    plant, columns = columns_of("car-odometer", 4, 200.0)
    filter = plant.adapted("fusion")
    outputs = filter.model.outputs.unpack(
        make_runner(filter.model, plant.parameters_of(filter)).run(
            plant.samples, input_rows(filter.model, columns, plant.samples), 200
        )
    )
    error = outputs[odometer.SCALE.name][-1, 0] + columns["odometer_scale_factor_true"][-1]
    sigma = outputs[f"{odometer.SCALE.name}_estimate_sigma"][-1, 0]
    start = float(plant.knowledge.rows["odometer_scale_factor_sigma"])
    found = min(abs(error), abs(outputs[odometer.SCALE.name][-1, 0] - columns["odometer_scale_factor_true"][-1]))
    assert found < 4 * sigma < start
    assert outputs["odometer_count"][-1] > 1000 and outputs["odometer_refused_count"][-1] < 20


def test_zero_velocity_alone_holds_a_car_at_rest():
    """No GNSS: nothing is refused for want of it, and the note names the height."""
    scenario = load("car-parked")
    report = insenv.run(scenario, fusion([], ["zero_velocity"], "rest"), duration_s=60)
    result = report.results[0]
    assert np.abs(result.errors["vn_mps"][-1]) < 0.01 and np.abs(result.errors["north_m"][-1]) < 3.0
    short = insenv.run(scenario, fusion([], ["zero_velocity"], "rest"), duration_s=900).results[0]
    assert any("none of the aids holds the height" in note for note in short.notes)


@pytest.mark.parametrize(("grade", "seed"), [("navigation", 10022), ("industrial", 10001)])
def test_a_parked_car_stays_where_it_is(grade, seed):
    """By detection of rest alone these drove off, by 10 km and more: their start, or their heading, was 3 sigmas off."""
    scenario = load("car-parked")
    scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": grade})})
    result = insenv.run(scenario, "fusion", seed=seed).results[0]
    assert result.health is not None and list(result.health.aids) == ["in_place"]
    for channel, largest in (("north_m", 10.0), ("vn_mps", 0.5), ("roll_deg", 2.0)):
        assert np.abs(result.errors[channel]).max() < largest
    assert not result.too_sure()
    assert not any("holds the height" in note or "shows the heading" in note for note in result.notes)


@pytest.mark.parametrize(
    ("vehicle", "in_place", "aids"),
    [
        ("car", True, ("in_place",)),
        ("car with GNSS", True, ("gnss", "zero_velocity")),
        ("car", None, ("zero_velocity",)),
        ("car", False, ("zero_velocity",)),
        ("", True, ("zero_velocity",)),
        ("ship", True, ()),
        ("turntable", True, ("in_place",)),
    ],
)
def test_only_what_stays_on_wheels_or_turns_in_place_has_a_fixed_place(vehicle, in_place, aids):
    kind, _, gnss = vehicle.partition(" with ")
    assert aids_of(Drive("here", frozenset(["gnss"] * bool(gnss)), in_place, vehicle=kind)) == aids


@pytest.mark.parametrize(("name", "sigma"), [("car-parked", 0.02), ("turntable-calibration", 0.001)])
def test_a_parked_vehicle_is_shaken_and_a_turntable_is_not(name, sigma):
    plant = build(load(name))
    estimator = plant.adapted("fusion")
    default = float(estimator.model.parameters["in_place_sigma"].start)
    assert plant.parameters_of(estimator).get("in_place_sigma", default) == sigma
    assert plant.parameters_of(estimator, {"in_place_sigma": 0.3})["in_place_sigma"] == 0.3


def test_the_smoother_of_a_composition_is_better_than_its_filter_in_an_outage():
    report = insenv.run("car-survey", ["fusion", "fusion-smoother"], duration_s=1000)
    filter, smoothed = report.results
    outage = (filter.time > 905) & (filter.time < 960)
    for channel in ("north_m", "east_m"):
        worst = [np.abs(r.errors[channel][outage]).max() for r in (filter, smoothed)]
        assert worst[1] < 0.5 * worst[0] + 0.01, channel
        ratio = smoothed.errors[channel][outage] / smoothed.sigma[channel][outage]
        assert np.sqrt(np.mean(ratio**2)) < 3.0


def test_known_errors_that_are_no_states_are_named():
    """A user's own choice of states dropped the bias of the barometer: 13 m at a stated 0.02 m, without a word."""
    settings = {"fusion": {"states": ["gnss_wander"]}}
    result = insenv.run("multirotor-hover", "fusion", duration_s=2, settings=settings).results[0]
    (note,) = (note for note in result.notes if "neither states nor noise" in note)
    assert "barometer_bias" in note and "hard_iron" in note and "gnss_wander" not in note
    whole = insenv.run("car-survey", "fusion", duration_s=2).results[0]
    assert not any("neither states nor noise" in note for note in whole.notes)


def test_a_height_that_an_odometer_alone_does_not_hold_is_named():
    """1.5 km off after 600 s without a word: the accelerometer's bias goes into the height."""
    wheels = insenv.run("car-odometer", fusion([], ["odometer"]), duration_s=100).results[0]
    (said,) = (note for note in wheels.notes if "holds the height" in note)
    assert "makes an error of" in said and "barometer" in said
    held = insenv.run("car-odometer", fusion([], ["odometer", "non_holonomic"]), duration_s=100).results[0]
    assert not any("holds the height" in note for note in held.notes)


def test_a_scenario_may_set_what_the_chosen_aids_do_not_use():
    """The city drive sets standing_sigma; a filter without zero velocity was refused for it."""
    choice = {"fusion": {"aids": ["gnss"], "states": []}}
    assert insenv.run("car-city-drive", "fusion", duration_s=2, settings=choice).results


def test_no_source_of_heading_is_named():
    report = insenv.run("car-odometer", fusion([], ["odometer", "non_holonomic"]), duration_s=2)
    assert any("none of the aids shows the heading" in note for note in report.results[0].notes)
    with pytest.raises(InputError, match=r"'fusion' needs an instrument: scenario 'ship-swaying' has none of \[gnss\]"):
        insenv.run("ship-swaying", "fusion", duration_s=2)


def test_a_level_that_nothing_holds_and_that_is_uncertain_is_named():
    """The vertical channel takes g tilt^2 / 2 for a Coriolis acceleration."""
    values = load("ship-dvl").model_dump(mode="json", warnings=False)
    values |= {"gnss": None, "dvl": None, "barometer": {"grade": "ms5611", "interval_s": 1.0}, "duration_s": 5.0}

    def named(level_deg):
        values["knowledge"] = {"tilt_sigma_deg": level_deg, "heading_sigma_deg": 0.5}
        return any(
            "holds the horizontal velocity" in note for note in insenv.run(parse(values, "ship"), "fusion").results[0].notes
        )

    assert named(0.5) and named(0.2) and not named(0.1)


def test_an_aid_that_a_log_has_not_is_refused():
    status, _, said = call("replay", "examples/logs/plain.toml", "-e", "fusion", "--set", 'fusion.aids=["dvl"]')
    assert status == 2 and "needs dvl: the log has no [dvl]" in said


@pytest.mark.slow
@pytest.mark.parametrize("section", ["barometer", "magnetometer", "dvl", "odometer", "heading"])
def test_a_perfect_instrument_leaves_the_filter_regular(section):
    data = load("car-survey").model_dump(mode="json", exclude_unset=True)
    data[section] = {"grade": "perfect"}
    result = insenv.run(data, "fusion", duration_s=20).results[0]
    assert all(np.isfinite(values).all() for values in result.errors.values())
    for channel in ("down_m", "heading_deg", "vn_mps"):
        assert np.abs(result.errors[channel][-1]) < 6 * result.sigma[channel][-1], channel
