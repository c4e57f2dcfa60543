"""What clients ask for: modes, missions, logs, clocks; messages for others."""

from streamed_vehicle import ACCEPTED, DENIED, answered, command, quiet, sent, steps


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
