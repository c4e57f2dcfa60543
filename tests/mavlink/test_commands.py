"""Commands of clients: each is answered, and does what it says; what else clients ask for; answers in turn."""

from math import inf, nan

import pytest
from streamed_vehicle import ACCEPTED, DENIED, UNSUPPORTED, answered, command, quiet, sent, set_parameter, steps, texts

from insenv.mavlink import Vehicle
from insenv.mavlink.commands import ACTIONS, MAX_PEERS, MAX_PER_SEND, MAX_WAITING, Outbox, names_by_number
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


def test_modes_are_named_and_follow_from_what_steers():
    vehicle = quiet()

    def modes(vehicle, *parameters):
        return [m.mode_name for m in command(vehicle, 512, 435.0, *parameters)[1]]

    def shown():
        return vehicle.make("HEARTBEAT").custom_mode, vehicle.make("CURRENT_MODE").custom_mode

    assert modes(vehicle) == ["Scenario", "Manual control"] and modes(vehicle, 2.0) == ["Manual control"]
    assert command(vehicle, 512, 435.0, 3.0)[0] == DENIED and shown() == (0, 0)
    assert command(vehicle, 176, 1.0, 0.0)[0] == ACCEPTED and command(vehicle, 176, 1.0, 1.0)[0] == DENIED
    answered(vehicle, sent("MANUAL_CONTROL", 1, 0, 0, 500, 0, 0))
    assert shown() == (1, 1) and modes(quiet("ship-swaying")) == ["Scenario"]


def test_clients_are_told_that_there_are_no_missions_logs_and_older_protocols():
    vehicle = quiet()
    assert [m.max_version for m in command(vehicle, 519)[1]] == [200] == [m.version for m in command(vehicle, 512, 300.0)[1]]
    (current,) = answered(vehicle, sent("MISSION_SET_CURRENT", 1, 1, 4))
    assert (current.get_type(), current.seq, current.total, current.mission_state) == ("MISSION_CURRENT", 0, 0, 1)
    (count,) = answered(vehicle, sent("MISSION_REQUEST_LIST", 1, 1, 2))
    assert (count.count, count.mission_type, count.target_system) == (0, 2, 245)
    (refusal,) = answered(vehicle, sent("MISSION_REQUEST_LIST", 1, 1, 3))
    assert (refusal.get_type(), refusal.type, refusal.mission_type) == ("MISSION_ACK", 3, 3)
    assert [m.type for m in answered(vehicle, sent("MISSION_COUNT", 1, 1, 5, 0))] == [3]
    assert [m.type for m in answered(vehicle, sent("MISSION_CLEAR_ALL", 1, 1, 0))] == [0]
    (data,) = answered(vehicle, sent("LOG_REQUEST_DATA", 1, 1, 3, 90, 180))
    assert (data.get_type(), data.id, data.ofs, data.count) == ("LOG_DATA", 3, 90, 0)
    assert [m.num_logs for m in answered(vehicle, sent("LOG_REQUEST_LIST", 1, 1, 0, 65535))] == [0]


def test_clocks_and_pings():
    vehicle = quiet()
    steps(vehicle, 1.0)
    (clock,) = answered(vehicle, sent("TIMESYNC", 0, 1234))
    assert (clock.tc1, clock.ts1) == (1_000_000_000, 1234) and not answered(vehicle, sent("TIMESYNC", 5, 1234))
    (echo,) = answered(vehicle, sent("PING", 99, 3, 0, 0))
    assert (echo.seq, echo.target_system) == (3, 245) and not answered(vehicle, sent("PING", 99, 3, 1, 1))


def test_messages_for_others_are_ignored():
    vehicle = quiet()
    assert not answered(vehicle, sent("PARAM_REQUEST_LIST", 2, 1)) and not answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 100))
    assert not answered(vehicle, sent("COMMAND_LONG", 7, 1, 31010, 0, *[0.0] * 7)) and vehicle.simulation.alignments == 1
    assert not answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 1, system=1, component=1))  # our own, returned
    assert len(answered(vehicle, sent("PARAM_REQUEST_LIST", 0, 0))) == len(vehicle.parameters)
    assert not answered(vehicle, sent("ATTITUDE", 1000, *[0.0] * 6))


def test_answers_are_bounded_and_each_peer_has_its_turn():
    outbox, out = Outbox(), []
    for peer in ("a", "b"):
        for _ in range(MAX_WAITING + 50):
            outbox.put(peer, [peer])
    assert outbox.dropped == 100
    while outbox.send(lambda peer, message: out.append((peer, message))):
        assert len(out) <= 2 * MAX_WAITING
    assert out[:4] == [("a", "a"), ("b", "b")] * 2 and out.count(("a", "a")) == out.count(("b", "b")) == MAX_WAITING
    for number in range(MAX_PEERS + 10):
        outbox.put(number, [0])
    assert outbox.dropped == 110
    assert outbox.send(lambda *_: None) == MAX_PER_SEND


def test_all_parameters_requested_repeatedly_are_one_pending_list():
    outbox, out = Outbox(), []
    for _ in range(1000):
        outbox.put("a", iter(range(40)))
        outbox.put("b", iter(range(40)))
    while outbox.send(lambda peer, message: out.append(peer)):
        pass
    assert out.count("a") == out.count("b") == 40


def test_requests_for_files_are_refused_with_the_next_number_and_the_same_session():
    vehicle = quiet()

    def replies(opcode, data=b""):
        payload = (65535).to_bytes(2, "little") + bytes((7, opcode, len(data), 0, 0, 0)) + bytes(4) + data
        found = answered(vehicle, sent("FILE_TRANSFER_PROTOCOL", 0, 1, 1, list(payload.ljust(251, b"\0"))))
        assert all((m.target_system, m.target_component) == (245, 190) for m in found)
        return [bytes(m.payload) for m in found]

    for opcode, error in ((3, 6), (4, 10), (5, 7), (6, 9), (14, 10), (99, 7)):
        (reply,) = replies(opcode, b"@PARAM/param.pck?withdefaults=1")
        assert reply[:6] == bytes([0, 0, 7, 129, 1, opcode]) and reply[12] == error
    assert replies(2)[0][3] == 128 and not replies(129)  # answers are not answered
