"""Services that a client asks for: files, metadata of parameters, modes, missions, logs, clocks."""

import json

import pytest
from streamed_vehicle import (
    ACCEPTED,
    DENIED,
    answered,
    command,
    common,
    quiet,
    sent,
    steps,
    texts,
)

from insenv.mavlink.answers import HANDLERS
from insenv.mavlink.metadata import checksum


def transfer(vehicle, opcode, data=b"", *, sequence=0, session=0, offset=0, size=None):
    """The payloads that answer a request of FILE_TRANSFER_PROTOCOL."""
    request = bytearray(251)
    request[0:2], request[2], request[3] = sequence.to_bytes(2, "little"), session, opcode
    request[4], request[8:12], request[12 : 12 + len(data)] = (
        len(data) if size is None else size,
        offset.to_bytes(4, "little"),
        data,
    )
    found = answered(vehicle, sent("FILE_TRANSFER_PROTOCOL", 0, 1, 1, list(request)))
    assert all((m.target_system, m.target_component) == (245, 190) for m in found)
    return [bytes(m.payload) for m in found]


def test_file_transfer_is_refused_with_the_next_number_and_the_same_session():
    vehicle = quiet()
    (reply,) = transfer(vehicle, 4, b"@PARAM/param.pck?withdefaults=1", sequence=65535, session=7)
    assert reply[:6] == bytes([0, 0, 7, 129, 1, 4]) and reply[12] == 10
    assert not transfer(vehicle, 129) and not transfer(vehicle, 0)  # answers are not answered
    for opcode, error in ((6, 9), (8, 9), (99, 7), (5, 4)):
        (reply,) = transfer(vehicle, opcode, b"/x", session=9)
        assert (reply[3], reply[5], reply[12]) == (129, opcode, error)
    for opcode in (1, 2):
        assert [reply[3] for reply in transfer(vehicle, opcode)] == [128]


@pytest.mark.parametrize("burst", [False, True])
def test_names_units_and_ranges_of_parameters_are_read_as_component_metadata(burst):
    vehicle = quiet()
    result, (offered,) = command(vehicle, 512, 397.0)
    assert (result, offered.get_type(), offered.uri) == (ACCEPTED, "COMPONENT_METADATA", b"mftp:///general.json")

    def read(uri):
        (opened,) = transfer(vehicle, 4, uri.removeprefix("mftp://").encode())
        assert opened[3] == 128
        session, length, content = opened[2], int.from_bytes(opened[12:16], "little"), b""
        while True:
            replies = transfer(vehicle, 15 if burst else 5, session=session, offset=len(content), size=239)
            numbers = [int.from_bytes(reply[:2], "little") for reply in replies]
            assert numbers == list(range(1, len(replies) + 1)) and (not burst or replies[-1][6] or replies[-1][3] == 129)
            for reply in replies:
                if reply[3] == 129:
                    assert reply[12] == 6 and len(content) == length  # the end of the file
                    return content
                assert int.from_bytes(reply[8:12], "little") == len(content)
                content += reply[12 : 12 + reply[4]]

    general = read("mftp:///general.json")
    (entry,) = json.loads(general)["metadataTypes"]
    assert checksum(general) == offered.file_crc and entry["type"] == 1
    parameters = read(entry["uri"])
    assert checksum(parameters) == entry["fileCrc"]
    (crc,) = transfer(vehicle, 14, b"/parameter.json")
    assert int.from_bytes(crc[12:16], "little") == entry["fileCrc"]
    listed = {row["name"]: row for row in json.loads(parameters)["parameters"]}
    assert list(listed) == [parameter.name for parameter in vehicle.parameters.all]
    gate = listed["E_INN_GATE"]
    assert (gate["type"], gate["min"], gate["readOnly"]) == ("Float", 0.0, False) and gate["shortDesc"]
    assert listed["SIM_RATE"]["readOnly"] is True and listed["E_ANG_R_W"]["units"] == "deg/sqrt(h)"


def test_the_checksum_of_files_is_that_of_mavlink():
    """Bit by bit, as the specification defines it: polynomial 0xEDB88320, start 0, no inversion."""
    register = 0
    for byte in b"123456789":
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xEDB88320 if register & 1 else 0)
    assert checksum(b"123456789") == register == 0x2DFD2D88


def test_modes_are_named_and_follow_from_what_steers():
    vehicle = quiet()
    assert [m.mode_name.decode() for m in command(vehicle, 512, 435.0)[1]] == ["Scenario", "Manual control"]
    assert [m.mode_name.decode() for m in command(vehicle, 512, 435.0, 2.0)[1]] == ["Manual control"]
    assert command(vehicle, 512, 435.0, 3.0)[0] == DENIED
    assert (vehicle.make("HEARTBEAT").custom_mode, vehicle.make("CURRENT_MODE").custom_mode) == (0, 0)
    assert command(vehicle, 176, 1.0, 0.0)[0] == ACCEPTED and command(vehicle, 176, 1.0, 1.0)[0] == DENIED
    assert texts(vehicle) == ["mode Manual control: not by command"]
    (ack,) = answered(vehicle, sent("SET_MODE", 1, 1, 7))
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 176, DENIED)
    answered(vehicle, sent("MANUAL_CONTROL", 1, 0, 0, 500, 0, 0))
    assert (vehicle.make("HEARTBEAT").custom_mode, vehicle.make("CURRENT_MODE").custom_mode) == (1, 1)
    assert [m.mode_name.decode() for m in command(quiet("ship-swaying"), 512, 435.0)[1]] == ["Scenario"]


def test_clients_are_told_that_there_are_no_missions_logs_and_older_protocols():
    vehicle = quiet()
    capabilities = vehicle.make("AUTOPILOT_VERSION").capabilities
    for name in ("MISSION_INT", "MISSION_FENCE", "MISSION_RALLY", "PARAM_FLOAT", "COMMAND_INT", "FTP", "MAVLINK2"):
        assert capabilities & getattr(common, f"MAV_PROTOCOL_CAPABILITY_{name}"), name
    assert [m.max_version for m in command(vehicle, 519)[1]] == [200] == [m.version for m in command(vehicle, 512, 300.0)[1]]
    (current,) = answered(vehicle, sent("MISSION_SET_CURRENT", 1, 1, 4))
    assert (current.get_type(), current.seq, current.total, current.mission_state) == ("MISSION_CURRENT", 0, 0, 1)
    (data,) = answered(vehicle, sent("LOG_REQUEST_DATA", 1, 1, 3, 90, 180))
    assert (data.get_type(), data.id, data.ofs, data.count) == ("LOG_DATA", 3, 90, 0)


def test_missions_logs_clocks_and_pings():
    vehicle = quiet()
    steps(vehicle, 1.0)
    for kind in (0, 1, 2):
        (count,) = answered(vehicle, sent("MISSION_REQUEST_LIST", 1, 1, kind))
        assert (count.count, count.mission_type, count.target_system) == (0, kind, 245)
    for kind in (3, 9, 255):
        (refusal,) = answered(vehicle, sent("MISSION_REQUEST_LIST", 1, 1, kind))
        assert (refusal.get_type(), refusal.type, refusal.mission_type) == ("MISSION_ACK", 3, kind)
    assert [m.type for m in answered(vehicle, sent("MISSION_COUNT", 1, 1, 5, 0))] == [3]
    assert [m.type for m in answered(vehicle, sent("MISSION_CLEAR_ALL", 1, 1, 0))] == [0]
    assert [m.num_logs for m in answered(vehicle, sent("LOG_REQUEST_LIST", 1, 1, 0, 65535))] == [0]
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
    for name in ("HEARTBEAT", "COMMAND_ACK", "PARAM_VALUE", "NAMED_VALUE_FLOAT"):
        assert name not in HANDLERS
    assert not answered(vehicle, sent("ATTITUDE", 1000, *[0.0] * 6))
