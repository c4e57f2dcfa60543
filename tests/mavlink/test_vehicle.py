"""The vehicle that streams: its texts and systems, when it counts as aligned, its sticks, its parameters."""

from math import nan

import numpy as np
import pytest
from changed_scenario import changed
from pymavlink.dialects.v20 import common
from streamed_vehicle import ACCEPTED, SILENT, answered, command, quiet, sent, set_parameter, steps, texts

from insenv import attitude, estimators
from insenv.base.errors import InputError
from insenv.mavlink import Vehicle
from insenv.mavlink.messages.fields import DEG_E7
from insenv.mavlink.parameters import NEVER, NEXT_ALIGNMENT, NOW
from insenv.mavlink.vehicle import AXIS_UNUSED, Sticks
from insenv.scenario import build, load
from insenv.sensors.grades import LONGEST_NAME, elements
from insenv.vehicles import AircraftSection, CarSection, ShipSection

AHRS = 1 << 28
"""Bit of a good attitude in SYS_STATUS."""


def healthy(vehicle):
    return bool(vehicle.make("SYS_STATUS").onboard_control_sensors_health & AHRS)


def test_a_long_text_comes_in_chunks_that_give_it_back():
    """MAVLink: chunks of one text have its number, and count; a chunk that does not fill the field is the last."""
    vehicle, numbers = quiet(), set()
    vehicle.announce("x" * 50)
    assert [(message.id, message.chunk_seq) for message in vehicle.texts()] == [(0, 0)]
    for length in (51, 100, 101):
        text = "".join(chr(ord("a") + k % 26) for k in range(length))
        vehicle.announce(text)
        chunks = vehicle.texts()
        assert "".join(chunk.text for chunk in chunks) == text
        assert [chunk.chunk_seq for chunk in chunks] == list(range(len(chunks)))
        assert all(len(chunk.text) == 50 for chunk in chunks[:-1]) and len(chunks[-1].text) < 50
        (number,) = {chunk.id for chunk in chunks}
        numbers.add(number)
    assert len(numbers) == 3 and 0 not in numbers


def test_vehicles_beside_one_another_have_systems_of_their_own():
    first, second = quiet(), quiet(system=2)
    off = sent("COMMAND_LONG", 2, 1, 31011, 0, *[0.0] * 7)
    assert not answered(first, off) and first.simulation.gnss_on
    assert [m.get_type() for m in answered(second, off)] == ["COMMAND_ACK"] and not second.simulation.gnss_on
    # a command of the other vehicle is a command; what a vehicle sent itself is not
    assert answered(second, sent("PING", 1, 1, 0, 0, system=1, component=1))
    assert not answered(second, sent("PING", 1, 1, 0, 0, system=2, component=1))
    assert first.make("AUTOPILOT_VERSION").uid != second.make("AUTOPILOT_VERSION").uid
    with pytest.raises(InputError, match="1 to 255"):
        quiet(system=256)


def test_an_alignment_boots_aligns_and_is_aligned():
    """It sends the known position and no velocity.  The q-method needs 120 s."""
    ship = quiet("ship-swaying", hz=20)
    estimate, truth, known = ship.simulation.estimate, ship.simulation.truth, ship.simulation.plant.knowledge
    states = [ship.make("HEARTBEAT").system_status]
    for seconds in (1.0, 120.0):
        steps(ship, seconds)
        states.append(ship.make("HEARTBEAT").system_status)
    assert states == [common.MAV_STATE_BOOT, common.MAV_STATE_STANDBY, common.MAV_STATE_ACTIVE]
    message = ship.make("GLOBAL_POSITION_INT")
    assert abs(message.lat - known.latitude * DEG_E7) <= 0.5 and (message.vx, message.vy, message.vz) == (0, 0, 0)
    assert np.isnan(ship.make("ODOMETRY").velocity_covariance[0])  # there is no velocity
    assert np.all(np.abs(np.degrees(attitude.numeric.error_rotation_vector(estimate["q_nb"], truth["q_nb"]))) < 1)
    assert ship.make("ESTIMATOR_STATUS").flags & 3 == 1  # attitude good; no velocity
    ship.simulation._filter.x[:] = nan
    ship.step()
    assert ship.make("HEARTBEAT").system_status == common.MAV_STATE_CRITICAL


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
    assert not healthy(vehicle)
    assert command(vehicle, 31010)[0] == ACCEPTED
    assert estimated <= {m.get_type() for m in steps(vehicle, 2.0)} and vehicle.view.state == "aligning"


@pytest.mark.parametrize(("name", "seconds"),
    [("aircraft-survey", 60), pytest.param("ship-underway", 120, marks=pytest.mark.slow)])  # fmt: skip
def test_a_wrong_reported_heading_is_never_aligned(name, seconds):
    """It counts as aligned only where the filter has found the true heading: car and aircraft do so as they accelerate."""
    vehicle = quiet(changed(name, knowledge={"heading_error_deg": 20.0}), hz=20)  # of a standard deviation of a few degrees
    assert vehicle.view.heading_sigma_deg < 5.0 and vehicle.view.state == "aligning"
    for _ in range(seconds):
        steps(vehicle, 1.0)
        right = abs(vehicle.view.errors["heading"]) < 3 * vehicle.view.heading_sigma_deg
        assert vehicle.view.state == "aligning" or right
        assert healthy(vehicle) == (vehicle.view.state != "aligning")
    assert name == "ship-underway" or right


def test_a_right_reported_heading_is_aligned_once_fixes_could_contradict_it_and_not_if_they_do():
    """The car stands for 30 s, then accelerates to 12 m/s."""
    car = quiet(hz=20)
    for _ in range(30):
        steps(car, 1.0)
        assert car.view.state == "aligning" and car.view.doubt.startswith("heading as reported; ")
    steps(car, 10.0)
    assert car.view.state == "navigating" and car.view.doubt == "" and abs(car.view.errors["heading"]) < 1.0
    car.disturb_gnss(2, (60.0, 0.0, 0.0))  # spoofing
    steps(car, 8.0)
    assert car.view.state == "aligning" and car.view.doubt == "fixes contradict the estimate"
    car.disturb_gnss(0, (0.0, 0.0, 0.0))
    car.realign()
    assert car.view.state == "aligning" and car.view.doubt.startswith("heading as reported; ")  # the fixes count anew


def test_errors_against_the_truth_are_sent_on_request():
    car = Vehicle(load("car-city-drive"), rates={**SILENT, "HEARTBEAT": 1.0}, show_errors=True)
    sent_errors = [m for m in steps(car, 2.0) if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert len(sent_errors) == 8
    found = {m.name: m.value for m in sent_errors[4:]}
    estimate, truth = car.simulation.estimate, car.simulation.truth
    x, y, heading = np.degrees(np.ravel(attitude.numeric.error_rotation_vector(estimate["q_nb"], truth["q_nb"])))
    assert found["ERR_HDG"] == pytest.approx(heading, rel=1e-2)
    assert found["ERR_TILT"] == pytest.approx(np.hypot(x, y), rel=1e-2)
    north, east, up = (float(estimate[name] - truth[name]) for name in ("latitude", "longitude", "height"))
    assert found["ERR_VEL"] == pytest.approx(np.linalg.norm(estimate["velocity_n"] - truth["velocity_n"]), rel=1e-6)
    apart = 6.37e6 * np.hypot(north, np.cos(float(truth["latitude"])) * east)
    assert found["ERR_POS"] == pytest.approx(np.hypot(apart, up), rel=1e-2)


def steer(vehicle, x, y, z, r):
    assert not answered(vehicle, sent("MANUAL_CONTROL", 1, x, y, z, r, 0))


def test_a_car_is_driven_by_manual_control_and_stops_without_it():
    vehicle = quiet(hz=40)
    scale, truth, said = vehicle.sticks.full_scale, vehicle.simulation.truth, []
    for _ in range(80):  # 10 s at 8 Hz
        steer(vehicle, 0, 0, 600, 500)
        said += steps(vehicle, 0.125)
    assert np.hypot(*truth["velocity_n"][:2]) == pytest.approx(0.6 * scale["SPEED"], rel=0.02)
    rates = []
    for _ in range(40):
        said += vehicle.step()
        rates.append(np.degrees(float(vehicle.view.values["true_rate_nb_b"][2])))
    assert abs(np.mean(rates) - 0.5 * scale["TURN"]) < 0.5
    said += steps(vehicle, 12.0)
    assert np.hypot(*truth["velocity_n"][:2]) < 0.05
    assert [m.text for m in said] == ["manual control: the script has ended", "manual control lost"]


@pytest.mark.parametrize(
    ("scenario", "why"), [("ship-swaying", "aligning in place"), ("large-misalignment", "motion is prescribed")]
)
def test_vehicles_that_cannot_be_steered_announce_it_once(scenario, why):
    vehicle = quiet(scenario)
    for _ in range(5):
        steer(vehicle, 0, 0, 1000, 0)
    assert texts(vehicle) == [f"no manual control: {why}"]


def test_missing_axes_command_nothing():
    car, ship, aircraft = (Sticks(section.traits.sticks) for section in (CarSection, ShipSection, AircraftSection))
    assert car.commanded(0, AXIS_UNUSED, AXIS_UNUSED, AXIS_UNUSED) == {}
    assert car.commanded(0, 500, 0, 0) == {"speed": 0.0, "yaw_rate": pytest.approx(np.radians(10.0))}
    assert ship.commanded(0, 500, -300, -1000) == {"speed": 0.0, "turn_rate": pytest.approx(-np.radians(3.0))}
    full = {"speed": 80.0, "bank": pytest.approx(np.radians(30.0)), "climb_rate": 5.0}
    assert aircraft.commanded(-32768, 32766, 9999, 0) == full
    assert aircraft.released() == {"bank": 0.0, "climb_rate": 0.0} and car.released() == {"speed": 0.0, "yaw_rate": 0.0}


def test_every_stick_command_is_a_command_of_its_vehicle():
    for scenario in ("ship-underway", "car-city-drive", "aircraft-survey"):
        plant = build(load(scenario))
        commands = {f"command_{stick.command}" for stick in plant.scenario.vehicle.traits.sticks}
        assert commands <= set(plant.model.inputs.names)


def asked(vehicle, name, index=-1):
    (answer,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, name, index))
    return answer


def test_all_parameters_are_sent_as_real32_with_short_names():
    vehicle = quiet()
    listed = answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 1))
    assert len(listed) == len(vehicle.parameters) > 100
    assert [m.param_index for m in listed] == list(range(len(listed))) and {m.param_type for m in listed} == {9}
    values, plant = {m.param_id: m.param_value for m in listed}, vehicle.simulation.plant
    assert len(values) == len(listed) and all(len(name) <= LONGEST_NAME for name in values)
    assert values["SIM_SPEED"] == 1 and values["SIM_RATE"] == 200 and values["E_INN_GATE"] == 5
    arw = np.degrees(plant.knowledge.sensors.angle_random_walk) * 60
    assert values["E_ANG_R_W"] == pytest.approx(arw, rel=1e-7)  # deg/sqrt(h)
    one = asked(vehicle, b"E_INN_GATE")
    assert one.param_value == 5 and one.param_id == "E_INN_GATE" == asked(vehicle, b"", one.param_index).param_id
    wrong = asked(vehicle, b"", 30000)
    assert (wrong.get_type(), wrong.param_id, wrong.param_index, wrong.error) == ("PARAM_ERROR", "", 30000, 1)
    (wrong,) = answered(vehicle, sent("PARAM_SET", 1, 1, b"NONE", 1.0, 9))
    assert (wrong.get_type(), wrong.error) == ("PARAM_ERROR", 1)


def test_every_estimator_and_plant_has_names_for_its_parameters():
    plants = [("S", build(load(name)).model) for name in ("ship-irregular-sea", "car-city-drive", "aircraft-survey")]
    for prefix, model in [*plants, *(("E", e.model) for e in estimators.registered().values())]:
        ids = [name for _, _, name in elements(prefix, model.parameters, model.parameters.names)]
        assert len(set(ids)) == len(ids) and all(len(name) <= LONGEST_NAME and name.isascii() for name in ids)


def test_a_parameter_acts_at_once_or_announces_when():
    vehicle, untouched = quiet(), quiet()
    assert set_parameter(vehicle, "E_ANG_R_W", 30.0) == 30.0
    steps(vehicle, 2.0), steps(untouched, 2.0)
    assert vehicle.simulation.estimate["attitude_sigma"][0] > 1.5 * untouched.simulation.estimate["attitude_sigma"][0]
    np.testing.assert_array_equal(vehicle.simulation.truth["q_nb"], untouched.simulation.truth["q_nb"])
    assert {p.acts for p in vehicle.parameters.all} == {NOW, NEXT_ALIGNMENT, NEVER}

    vehicle.texts()
    assert set_parameter(vehicle, "E_HDG_SIG", 90.0) == 90.0
    assert texts(vehicle) == ["E_HDG_SIG: acts at next alignment"]
    vehicle.realign()
    assert np.degrees(vehicle.simulation.estimate["attitude_sigma"][2]) == pytest.approx(90.0)
    assert asked(vehicle, b"E_ANG_R_W").param_value == 30.0  # it stays in force


def test_the_undulation_is_given_before_the_start():
    vehicle = quiet(undulation=47.0)
    assert asked(vehicle, b"SIM_UNDULATION").param_value == 47.0 == vehicle.view.undulation
    assert set_parameter(vehicle, "SIM_UNDULATION", 0.0) == 47.0 == vehicle.view.undulation
    assert texts(vehicle) == ["SIM_UNDULATION cannot be set during a run"]
    with pytest.raises(InputError, match="allowed is -120 to 120 m"):
        quiet(undulation=121.0)


@pytest.mark.parametrize(
    "name, value, kind",
    [("E_INN_GATE", nan, 9), ("E_INN_GATE", -1.0, 9), ("E_INN_GATE", 6.0, 6), ("S_GYR_BIAS_X", 1.0, 9), ("SIM_RATE", 100.0, 9)],
)
def test_a_wrong_value_changes_nothing_and_is_announced(name, value, kind):
    vehicle = quiet()
    before = vehicle.parameters.all[vehicle.parameters.find(name)].value()
    assert set_parameter(vehicle, name, value, kind) == pytest.approx(before, rel=1e-7)
    assert any(name in text for text in texts(vehicle))
