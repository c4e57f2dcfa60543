"""The vehicle that streams: its texts, its systems, and when it counts as aligned."""

from math import nan

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from streamed_vehicle import ACCEPTED, SILENT, answered, command, quiet, sent, steps

from insenv import attitude
from insenv.base.errors import InputError
from insenv.mavlink import Vehicle
from insenv.mavlink.messages.fields import DEG_E7
from insenv.scenario import load

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
    """It sends the known position and no velocity.  The q-method needs 100 s."""
    ship = quiet("ship-swaying", hz=20)
    estimate, truth, known = ship.simulation.estimate, ship.simulation.truth, ship.simulation.plant.knowledge
    states = [ship.make("HEARTBEAT").system_status]
    for seconds in (1.0, 100.0):
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


@pytest.mark.parametrize(("name", "seconds"), [("aircraft-survey", 60), ("ship-underway", 300)])
def test_a_wrong_reported_heading_is_never_aligned(name, seconds):
    """It counts as aligned only where the filter has found the true heading: car and aircraft do so as they accelerate."""
    scenario = load(name)
    knowledge = scenario.knowledge.model_copy(update={"heading_error_deg": 20.0})  # of a standard deviation of a few degrees
    vehicle = quiet(scenario.model_copy(update={"knowledge": knowledge}), hz=20)
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
