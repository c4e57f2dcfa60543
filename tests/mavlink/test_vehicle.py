"""The simulated vehicle without a link: agreement with `insenv run`, answers, states."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from streamed_vehicle import ACCEPTED, DENIED, SILENT, UNSUPPORTED, answered, command, common, quiet, sent, set_parameter, steps

from insenv import attitude, estimators, run
from insenv.errors import InputError
from insenv.mavlink import Simulation, Vehicle
from insenv.mavlink.commands import ACTIONS, names_by_number
from insenv.scenario import load

# --- agreement with a run ----------------------------------------------------------------------------


@pytest.mark.parametrize("scenario, estimator", [("car-city-drive", "loosely-coupled"), ("ship-swaying", "qakf")])
def test_estimates_are_those_of_a_run(scenario, estimator):
    result = run(load(scenario), [estimator], duration_s=20.0).results[0]
    vehicle = quiet(scenario, estimator=estimator)
    found = []
    for _ in range(4000):
        vehicle.step()
        found.append(vehicle.simulation.estimate["q_nb"].copy())
    every = round(4000 / len(result.time))
    np.testing.assert_array_equal(np.array(found)[every - 1 :: every], result.outputs["q_nb"])
    assert vehicle.simulation.time == pytest.approx(result.time[-1])


def test_a_lost_sample_is_bridged_by_the_one_before():
    vehicle = quiet()
    place = vehicle.parameters.find("S_IMU_DROP_PROB")
    vehicle.parameters.all[place].set(0.2)
    before = vehicle.simulation.increments.copy()
    for _ in range(400):
        held = vehicle.simulation.last_increment.copy()
        vehicle.step()
        truth = vehicle.simulation.truth
        shown = held if not truth["imu_valid"] else np.concatenate([truth["delta_angle"], truth["delta_velocity"]])
        np.testing.assert_array_equal(vehicle.simulation.last_increment, shown)
        np.testing.assert_allclose(vehicle.simulation.increments - before, shown, rtol=0, atol=1e-12)
        before = vehicle.simulation.increments.copy()
    assert 40 < vehicle.simulation.bridged < 130


def test_estimators_that_cannot_run_live_are_refused():
    with pytest.raises(InputError, match="loosely-coupled"):
        Simulation(load("car-city-drive"), "smoother")
    with pytest.raises(InputError, match="GNSS"):
        Simulation(load("ship-swaying"), "loosely-coupled")
    with pytest.raises(InputError, match="in place"):
        Simulation(load("car-city-drive"), "q-method")


# --- texts ------------------------------------------------------------------------------------------


def test_a_long_text_comes_in_chunks_that_give_it_back():
    """MAVLink: chunks of one text have its number, and count; a chunk that does not fill the field is the last."""
    vehicle = quiet()
    for text in ("x" * 49, "x" * 50, "short"):
        vehicle.announce(text)
        (message,) = vehicle.texts()
        assert (message.text, message.id, message.chunk_seq) == (text, 0, 0)
    numbers = set()
    for length in (51, 99, 100, 101, 250):
        text = "".join(chr(ord("a") + k % 26) for k in range(length))
        vehicle.announce(text)
        chunks = vehicle.texts()
        assert "".join(chunk.text for chunk in chunks) == text
        assert [chunk.chunk_seq for chunk in chunks] == list(range(len(chunks)))
        assert all(len(chunk.text) == 50 for chunk in chunks[:-1]) and len(chunks[-1].text) < 50
        (number,) = {chunk.id for chunk in chunks}
        numbers.add(number)
    assert len(numbers) == 5 and 0 not in numbers


# --- commands ----------------------------------------------------------------------------------------


def test_every_command_is_answered():
    vehicle = quiet()
    for number in (0, 1, 16, 176, 300, 511, 65535, *ACTIONS):
        for parameters in ([0.0] * 7, [nan] * 7, [float("inf")] * 7, [1e30] * 7):
            result, _ = command(vehicle, number, *parameters)
            assert result == UNSUPPORTED if number not in ACTIONS else result in (0, 1, 2, 3)
    (ack,) = answered(vehicle, sent("COMMAND_INT", 1, 1, 0, 31011, 0, 0, 0.0, 0, 0, 0, 0, 0, 0))
    assert (ack.get_type(), ack.result) == ("COMMAND_ACK", ACCEPTED) and not vehicle.simulation.gnss_on


def test_gnss_is_switched_off_and_on():
    vehicle = quiet()
    steps(vehicle, 60.5)  # moving: at standstill the estimator would use that
    fixes = vehicle.simulation.fixes
    assert fixes == 60 and vehicle.view.has_lock
    assert command(vehicle, 31011, 0.0)[0] == ACCEPTED
    before = float(vehicle.simulation.estimate["position_sigma"][0])
    steps(vehicle, 4.0)
    assert vehicle.simulation.fixes == fixes and not vehicle.view.has_lock
    assert vehicle.simulation.estimate["position_sigma"][0] > before
    assert vehicle.make("GPS_RAW_INT").fix_type == 1 and not vehicle.make("SYS_STATUS").onboard_control_sensors_health & 32
    assert command(vehicle, 31011, 1.0)[0] == ACCEPTED
    steps(vehicle, 2.0)
    assert vehicle.simulation.fixes == fixes + 2 and vehicle.view.has_lock
    assert command(vehicle, 31011, 0.5)[0] == DENIED
    assert command(quiet("ship-swaying"), 31011, 0.0)[0] == DENIED


def test_a_receiver_that_is_off_is_an_outage_to_the_estimator():
    """The estimate is bit-identical to that of an outage window of the scenario."""
    cut = quiet()
    steps(cut, 5.5)
    cut.set_gnss(False)
    steps(cut, 4.0)
    with_outage = load("car-city-drive")
    gnss = with_outage.gnss.model_copy(update={"outages_s": ((5.5, 9.5),)})
    other = Vehicle(with_outage.model_copy(update={"gnss": gnss}), rates=SILENT)
    steps(other, 9.5)
    np.testing.assert_array_equal(cut.simulation.estimate["q_nb"], other.simulation.estimate["q_nb"])
    assert float(cut.simulation.estimate["height"]) == float(other.simulation.estimate["height"])


def test_a_new_alignment_starts_with_the_errors_of_the_first():
    vehicle = quiet("car-city-drive")
    first = vehicle.simulation
    start_error = attitude.numeric.error_rotation_vector(first.estimate["q_nb"], first.truth["q_nb"])
    steps(vehicle, 60.0)
    assert first.truth["velocity_n"][0] ** 2 + first.truth["velocity_n"][1] ** 2 > 25
    assert command(vehicle, 31010)[0] == ACCEPTED and first.alignments == 2
    error = attitude.numeric.error_rotation_vector(first.estimate["q_nb"], first.truth["q_nb"])
    assert np.linalg.norm(error) == pytest.approx(np.linalg.norm(start_error), rel=0.2) and np.linalg.norm(error) > 1e-3
    assert np.linalg.norm(first.estimate["velocity_n"] - first.truth["velocity_n"]) < 1.0
    message = vehicle.make("ATTITUDE")
    assert message.yaw == pytest.approx(float(attitude.numeric.to_euler(first.estimate["q_nb"])[2]), abs=1e-9)
    steps(vehicle, 30.0)
    assert vehicle.view.state == "navigating"


def test_a_diverged_estimate_is_announced_and_not_sent():
    vehicle = Vehicle(load("car-city-drive"))
    steps(vehicle, 2.5)
    vehicle.simulation._filter.x[:] = nan
    said = steps(vehicle, 2.0)
    kinds = {m.get_type() for m in said}
    position = {"GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ODOMETRY", "ALTITUDE"}
    estimated = position | {"ATTITUDE", "ATTITUDE_QUATERNION", "VFR_HUD"}
    assert not kinds & estimated and {"HIL_SENSOR", "HIL_STATE_QUATERNION", "GPS_RAW_INT", "ESTIMATOR_STATUS"} <= kinds
    assert vehicle.view.fields.refused["GLOBAL_POSITION_INT.lat"] == 20
    assert [m.text for m in said if m.get_type() == "STATUSTEXT"] == ["estimate diverged: start a new alignment"]
    assert not vehicle.make("SYS_STATUS").onboard_control_sensors_health & 1 << 28
    assert command(vehicle, 31010)[0] == ACCEPTED
    assert estimated <= {m.get_type() for m in steps(vehicle, 2.0)} and vehicle.view.state == "aligning"


def test_pause_speed_and_arming():
    vehicle = quiet()
    assert command(vehicle, 31012, 1.0)[0] == ACCEPTED and vehicle.paused
    assert command(vehicle, 31012, 0.0)[0] == ACCEPTED and not vehicle.paused
    assert command(vehicle, 31013, 4.0)[0] == ACCEPTED and vehicle.speed == 4.0
    assert command(vehicle, 31013, -1.0)[0] == DENIED and vehicle.speed == 4.0
    assert set_parameter(vehicle, "SIM_PAUSE", 1.0) == 1.0 and vehicle.paused
    assert vehicle.make("HEARTBEAT").base_mode & 128
    assert command(vehicle, 400, 0.0)[0] == ACCEPTED and not vehicle.make("HEARTBEAT").base_mode & 128


def test_messages_are_requested_and_timed():
    vehicle = quiet()
    steps(vehicle, 2.5)
    for number, name in names_by_number().items():
        result, more = command(vehicle, 512, float(number))
        if name == "HIL_GPS" and not more:
            assert result == 1  # a fix is sent once
            continue
        assert (result, [m.get_type() for m in more]) == (ACCEPTED, [name] * (2 if name == "AVAILABLE_MODES" else 1))
    assert command(vehicle, 512, 437.0) == (UNSUPPORTED, [])
    assert command(vehicle, 520)[1][0].get_type() == "AUTOPILOT_VERSION"
    assert command(vehicle, 410)[1][0].get_type() == "HOME_POSITION"
    attitude_id = 30.0
    assert command(vehicle, 511, attitude_id, 10_000.0)[0] == ACCEPTED
    sent_now = [m.get_type() for _ in range(200) for m in vehicle.step()]
    assert sent_now.count("ATTITUDE") == 100
    assert command(vehicle, 510, attitude_id)[1][0].interval_us == 10_000
    assert command(vehicle, 512, 244.0, attitude_id)[1][0].interval_us == 10_000
    assert command(vehicle, 511, attitude_id, -1.0)[0] == ACCEPTED
    assert command(vehicle, 510, attitude_id)[1][0].interval_us == -1
    assert command(vehicle, 511, attitude_id, 0.0)[0] == ACCEPTED and vehicle.schedule.rates["ATTITUDE"] == 20
    assert command(vehicle, 511, attitude_id, -5.0)[0] == DENIED and command(vehicle, 511, 9999.0, 1.0)[0] == UNSUPPORTED


def test_data_streams_leave_rates_of_the_command_line_alone():
    vehicle = Vehicle(load("car-city-drive"), rates={"ATTITUDE": 33.0})
    assert not answered(vehicle, sent("REQUEST_DATA_STREAM", 1, 1, 0, 4, 1))
    rates = vehicle.schedule.rates
    assert (rates["ATTITUDE"], rates["VFR_HUD"], rates["HIL_SENSOR"], rates["HEARTBEAT"]) == (33.0, 4.0, 200.0, 1.0)
    answered(vehicle, sent("REQUEST_DATA_STREAM", 1, 1, 6, 4, 0))
    assert rates["GLOBAL_POSITION_INT"] == 0 and rates["VFR_HUD"] == 4.0


# --- several vehicles, states, errors ------------------------------------------------------------------


def test_vehicles_beside_one_another_have_systems_of_their_own():
    first, second = quiet(), quiet(system=2)
    off = sent("COMMAND_LONG", 2, 1, 31011, 0, *[0.0] * 7)
    assert not answered(first, off) and first.simulation.gnss_on
    assert [m.get_type() for m in answered(second, off)] == ["COMMAND_ACK"] and not second.simulation.gnss_on
    assert not answered(second, sent("PARAM_REQUEST_READ", 1, 1, b"SIM_RATE", -1))
    # a command of the other vehicle is a command; what a vehicle sent itself is not
    assert answered(second, sent("PING", 1, 1, 0, 0, system=1, component=1))
    assert not answered(second, sent("PING", 1, 1, 0, 0, system=2, component=1))
    assert first.make("AUTOPILOT_VERSION").uid != second.make("AUTOPILOT_VERSION").uid
    for wrong in (0, 256):
        with pytest.raises(InputError, match="1 to 255"):
            quiet(system=wrong)


def test_the_heartbeat_tells_boot_aligning_and_aligned():
    ship = quiet("ship-swaying")
    states = [ship.make("HEARTBEAT").system_status]
    for seconds in (1.0, 100.0):  # q-method needs 100 s
        steps(ship, seconds)
        states.append(ship.make("HEARTBEAT").system_status)
    assert states == [common.MAV_STATE_BOOT, common.MAV_STATE_STANDBY, common.MAV_STATE_ACTIVE]
    ship.simulation._filter.x[:] = nan
    steps(ship, 0.01)
    assert ship.make("HEARTBEAT").system_status == common.MAV_STATE_CRITICAL


def test_an_estimate_that_its_estimator_warns_of_is_not_aligned():
    """With a given attitude ecef-kf states small sigmas at once; whether it may be trusted is in its notes."""
    sentence = "heading is good to 55 deg only: a gyro error of 9.91 deg/h"

    def warned(parameters, duration_s):
        assert parameters["angle_random_walk"] > 0.0
        return (sentence,) if duration_s < 4.0 else ()

    warning = replace(estimators.get("ecef-kf"), applicability=warned, needs=None)
    ship = Vehicle(load("static-ecef"), warning, rates={**SILENT, "HEARTBEAT": 1.0})
    assert ship.view.tilt_sigma_deg < 1 and ship.view.heading_sigma_deg < 5
    found = steps(ship, 6.0)
    states = [m.system_status for m in found if m.get_type() == "HEARTBEAT"]
    assert states == [3, 3, 3, 4, 4, 4]
    assert [m.text for m in found if m.get_type() == "STATUSTEXT"] == [sentence.partition(":")[0], "aligned"]
    assert ship.make("SYS_STATUS").onboard_control_sensors_health & 1 << 28
    ship.realign()
    steps(ship, 1.0)
    assert ship.view.state == "aligning"  # the time counts from the new alignment


def reported(name, error_deg):
    """A vehicle whose reported heading is off by an angle, with the scenario's standard deviation of a few degrees."""
    scenario = load(name)
    return quiet(
        scenario.model_copy(update={"knowledge": scenario.knowledge.model_copy(update={"heading_error_deg": error_deg})})
    )


@pytest.mark.parametrize(("name", "seconds"), [("aircraft-survey", 60), ("car-city-drive", 60), ("ship-underway", 300)])
def test_a_wrong_reported_heading_is_never_aligned(name, seconds):
    """It counts as aligned only where the filter has found the true heading: car and aircraft do so as they accelerate."""
    vehicle = reported(name, 20.0)
    assert vehicle.view.heading_sigma_deg < 5.0 and vehicle.view.state == "aligning"
    for _ in range(seconds):
        steps(vehicle, 1.0)
        right = abs(vehicle.view.errors["heading"]) < 3 * vehicle.view.heading_sigma_deg
        assert vehicle.view.state == "aligning" or right
        aligned = bool(vehicle.make("SYS_STATUS").onboard_control_sensors_health & 1 << 28)
        assert aligned == (vehicle.view.state != "aligning")
    assert name == "ship-underway" or right


def test_a_right_reported_heading_is_aligned_once_fixes_could_contradict_it():
    """The car stands for 30 s, then accelerates to 12 m/s."""
    car = quiet("car-city-drive")
    for _ in range(30):
        steps(car, 1.0)
        assert car.view.state == "aligning" and car.view.doubt.startswith("heading as reported; ")
    steps(car, 10.0)
    assert car.view.state == "navigating" and car.view.doubt == ""
    assert abs(car.view.errors["heading"]) < 1.0
    car.realign()
    assert car.view.state == "aligning"  # the fixes count from the new alignment
    car.parameters.all[car.parameters.find("E_HDG_SIG")].set(90.0)  # acts at the next alignment: 3 deg are in force
    assert np.degrees(car.simulation.reported_heading_sigma) == pytest.approx(3.0)


def test_a_filter_that_the_fixes_contradict_is_not_aligned():
    car = quiet("car-city-drive")
    steps(car, 40.0)
    assert car.view.state == "navigating"
    car.disturb_gnss(2, (60.0, 0.0, 0.0))  # spoofing
    steps(car, 8.0)
    assert car.view.state == "aligning" and car.view.doubt.startswith("filter diverged: ")


def test_errors_against_the_truth_are_sent_on_request():
    car = Vehicle(load("car-city-drive"), rates={**SILENT, "HEARTBEAT": 1.0}, show_errors=True)
    sent_errors = [m for m in steps(car, 2.0) if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert len(sent_errors) == 8
    found = {m.name: m.value for m in sent_errors[4:]}
    estimate, truth = car.simulation.estimate, car.simulation.truth
    c_error = attitude.numeric.to_dcm(estimate["q_nb"]) @ attitude.numeric.to_dcm(truth["q_nb"]).T
    heading = np.degrees(np.arctan2(c_error[1, 0] - c_error[0, 1], 2.0))
    tilt = np.degrees(np.hypot(c_error[2, 1] - c_error[1, 2], c_error[0, 2] - c_error[2, 0]) / 2.0)
    assert found["ERR_HDG"] == pytest.approx(heading, rel=1e-2) and found["ERR_TILT"] == pytest.approx(tilt, rel=1e-2)
    assert found["ERR_VEL"] == pytest.approx(np.linalg.norm(estimate["velocity_n"] - truth["velocity_n"]), rel=1e-6)
    apart = 6.37e6 * np.hypot(
        estimate["latitude"] - truth["latitude"], np.cos(truth["latitude"]) * (estimate["longitude"] - truth["longitude"])
    )
    assert found["ERR_POS"] == pytest.approx(np.hypot(apart, estimate["height"] - truth["height"]), rel=1e-2)
    assert not [m for m in steps(Vehicle(load("car-city-drive")), 1.0) if m.get_type() == "NAMED_VALUE_FLOAT"]
