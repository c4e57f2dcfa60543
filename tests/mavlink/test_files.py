"""File transfer, and the metadata of parameters that clients read by it."""

import json

import pytest
from streamed_vehicle import ACCEPTED, answered, command, quiet, sent

from insenv.mavlink.files import checksum


def transfer(vehicle, opcode, data=b"", *, sequence=0, session=0, offset=0, size=None):
    """The payloads that answer a request of FILE_TRANSFER_PROTOCOL."""
    size = len(data) if size is None else size
    request = sequence.to_bytes(2, "little") + bytes((session, opcode, size, 0, 0, 0)) + offset.to_bytes(4, "little") + data
    found = answered(vehicle, sent("FILE_TRANSFER_PROTOCOL", 0, 1, 1, list(request.ljust(251, b"\0"))))
    assert all((m.target_system, m.target_component) == (245, 190) for m in found)
    return [bytes(m.payload) for m in found]


def test_file_transfer_is_refused_with_the_next_number_and_the_same_session():
    vehicle = quiet()
    (reply,) = transfer(vehicle, 4, b"@PARAM/param.pck?withdefaults=1", sequence=65535, session=7)
    assert reply[:6] == bytes([0, 0, 7, 129, 1, 4]) and reply[12] == 10
    assert not transfer(vehicle, 129)  # answers are not answered
    for opcode, error in ((6, 9), (99, 7), (5, 4)):
        (reply,) = transfer(vehicle, opcode, b"/x", session=9)
        assert (reply[3], reply[5], reply[12]) == (129, opcode, error)


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
    """As the specification defines it: polynomial 0xEDB88320, start 0, no inversion."""
    assert checksum(b"123456789") == 0x2DFD2D88
