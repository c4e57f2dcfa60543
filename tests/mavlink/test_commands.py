"""Commands of clients: each is answered, and does what it says."""

from math import inf, nan

import pytest
from streamed_vehicle import ACCEPTED, DENIED, UNSUPPORTED, answered, command, quiet, sent, set_parameter, steps, texts

from insenv.mavlink import Vehicle
from insenv.mavlink.commands import ACTIONS, names_by_number
from insenv.scenario import load


def test_every_command_is_answered():
    vehicle = quiet()
    for number in (0, 1, 16, 176, 300, 511, 65535, *ACTIONS):
        for value in (0.0, nan, inf, 1e30):
            result, _ = command(vehicle, number, *[value] * 7)
            assert result == UNSUPPORTED if number not in ACTIONS else result in (0, 1, 2, 3)
    (ack,) = answered(vehicle, sent("COMMAND_INT", 1, 1, 0, 31011, 0, 0, 0.0, 0, 0, 0, 0, 0, 0))
    assert (ack.get_type(), ack.result) == ("COMMAND_ACK", ACCEPTED) and not vehicle.simulation.gnss_on


def test_gnss_is_switched_off_and_on():
    vehicle = quiet(hz=20)
    steps(vehicle, 2.5)
    fixes = vehicle.simulation.fixes
    assert fixes == 2 and vehicle.view.has_lock
    assert command(vehicle, 31011, 0.0)[0] == ACCEPTED
    steps(vehicle, 4.0)
    assert vehicle.simulation.fixes == fixes and not vehicle.view.has_lock
    assert vehicle.make("GPS_RAW_INT").fix_type == 1 and not vehicle.make("SYS_STATUS").onboard_control_sensors_health & 32
    assert command(vehicle, 31011, 1.0)[0] == ACCEPTED
    steps(vehicle, 2.0)
    assert vehicle.simulation.fixes == fixes + 2 and vehicle.view.has_lock
    assert command(vehicle, 31011, 0.5)[0] == DENIED
    assert command(quiet("ship-swaying"), 31011, 0.0)[0] == DENIED


def test_pause_and_arming():
    vehicle = quiet()
    assert command(vehicle, 31012, 1.0)[0] == ACCEPTED and vehicle.paused
    assert command(vehicle, 31012, 0.0)[0] == ACCEPTED and not vehicle.paused
    assert set_parameter(vehicle, "SIM_PAUSE", 1.0) == 1.0 and vehicle.paused
    assert vehicle.make("HEARTBEAT").base_mode & 128
    assert command(vehicle, 400, 0.0)[0] == ACCEPTED and not vehicle.make("HEARTBEAT").base_mode & 128


@pytest.mark.parametrize("speed", [0.0099, 100.1, nan])
def test_speeds_that_would_freeze_the_stream_are_refused(speed):
    vehicle = quiet()
    assert command(vehicle, 31013, speed)[0] == DENIED and vehicle.speed == 1.0
    assert "0.01" in texts(vehicle)[0]
    assert set_parameter(vehicle, "SIM_SPEED", speed) == 1.0


def test_messages_are_requested_and_timed():
    vehicle, attitude = quiet(), 30.0
    steps(vehicle, 2.5)
    for number, name in names_by_number().items():
        result, more = command(vehicle, 512, float(number))
        if name == "HIL_GPS" and not more:
            assert result == 1  # a fix is sent once
            continue
        assert (result, [m.get_type() for m in more]) == (ACCEPTED, [name] * (2 if name == "AVAILABLE_MODES" else 1))
    assert command(vehicle, 512, 437.0) == (UNSUPPORTED, [])
    assert [command(vehicle, number)[1][0].get_type() for number in (520, 410)] == ["AUTOPILOT_VERSION", "HOME_POSITION"]
    assert command(vehicle, 511, attitude, 10_000.0)[0] == ACCEPTED
    assert [m.get_type() for m in steps(vehicle, 1.0)].count("ATTITUDE") == 100
    assert command(vehicle, 510, attitude)[1][0].interval_us == 10_000
    assert command(vehicle, 512, 244.0, attitude)[1][0].interval_us == 10_000
    assert command(vehicle, 511, attitude, -1.0)[0] == ACCEPTED
    assert command(vehicle, 510, attitude)[1][0].interval_us == -1
    assert command(vehicle, 511, attitude, 0.0)[0] == ACCEPTED and vehicle.schedule.rates["ATTITUDE"] == 20
    assert command(vehicle, 511, attitude, -5.0)[0] == DENIED and command(vehicle, 511, 9999.0, 1.0)[0] == UNSUPPORTED


def test_data_streams_leave_rates_of_the_command_line_alone():
    vehicle = Vehicle(load("car-city-drive"), rates={"ATTITUDE": 33.0})
    assert not answered(vehicle, sent("REQUEST_DATA_STREAM", 1, 1, 0, 4, 1))
    rates = vehicle.schedule.rates
    assert (rates["ATTITUDE"], rates["VFR_HUD"], rates["HIL_SENSOR"], rates["HEARTBEAT"]) == (33.0, 4.0, 200.0, 1.0)
    answered(vehicle, sent("REQUEST_DATA_STREAM", 1, 1, 6, 4, 0))
    assert rates["GLOBAL_POSITION_INT"] == 0 and rates["VFR_HUD"] == 4.0
