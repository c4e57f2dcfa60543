"""A telemetry log read by Wireshark's `tshark` with the dissector that pymavlink generates."""

import shutil
import struct
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from command_line import call, strict

common = pytest.importorskip("pymavlink.dialects.v20.common")

LINKTYPE_IPV4 = 228
PORT = 14550  # of the dissector
FIELDS = ("sequence", "crc", "msgid", "rawpayload", "rawheader", "ATTITUDE_QUATERNION_q1", "ATTITUDE_QUATERNION_time_boot_ms")


def records(data):
    """(microseconds, frame) of each record of a telemetry log whose frames are unsigned."""
    place = 0
    while place < len(data):
        time_us, length = int.from_bytes(data[place : place + 8], "big"), 12 + data[place + 9]
        yield time_us, data[place + 8 : place + 8 + length]
        place += 8 + length


def capture(frames):
    """The frames as a capture of UDP datagrams over IPv4."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, LINKTYPE_IPV4)]
    for time_us, frame in frames:
        udp = struct.pack(">HHHH", PORT + 1, PORT, 8 + len(frame), 0) + frame
        place = bytes((127, 0, 0, 1))
        packet = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, place, place) + udp
        parts += [struct.pack("<IIII", *divmod(time_us, 10**6), len(packet), len(packet)), packet]
    return b"".join(parts)


@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed (Debian: apt-get install tshark)")
def test_tshark_decodes_a_whole_log(tmp_path):
    log, dissector = tmp_path / "flight.tlog", tmp_path / "mavlink.lua"
    arguments = ("--to", "udpout:127.0.0.1:9", "--speed", 0, "--duration", 6, "--tlog", log, "--json")
    sent = strict(call("stream", "car-city-drive", *arguments)[1])["sent"]
    frames = list(records(log.read_bytes()))
    (tmp_path / "flight.pcap").write_bytes(capture(frames))

    definitions = Path(common.__file__).with_suffix(".xml")
    generate = ["-m", "pymavlink.tools.mavgen", "--no-validate", "--lang", "WLua", "--wire-protocol", "2.0", "-o", dissector]
    subprocess.run([sys.executable, *generate, definitions], check=True, capture_output=True, timeout=120)
    shown = subprocess.run(
        ["tshark", "-r", tmp_path / "flight.pcap", "-X", f"lua_script:{dissector}", "-Y", "mavlink_proto", "-T", "fields"]
        + [word for name in FIELDS for word in ("-e", f"mavlink_proto.{name}")],
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
    )
    rows = [dict(zip(FIELDS, line.split("\t"), strict=True)) for line in shown.stdout.splitlines()]
    names = {number: kind.msgname for number, kind in common.mavlink_map.items()}
    assert Counter(names[int(row["msgid"])] for row in rows) == sent
    assert [int(row["sequence"]) for row in rows] == [number % 256 for number in range(len(rows))]
    assert [int(row["crc"], 16) for row in rows] == [int.from_bytes(frame[-2:], "little") for _, frame in frames]
    assert not any(row["rawpayload"] or row["rawheader"] for row in rows)

    reader = common.MAVLink(None)
    decoded = [m for m in (reader.decode(bytearray(frame)) for _, frame in frames) if m.get_type() == "ATTITUDE_QUATERNION"]
    attitude = [row for row in rows if row["ATTITUDE_QUATERNION_q1"]]
    assert [int(row["ATTITUDE_QUATERNION_time_boot_ms"]) for row in attitude] == [m.time_boot_ms for m in decoded]
    np.testing.assert_allclose([float(row["ATTITUDE_QUATERNION_q1"]) for row in attitude], [m.q1 for m in decoded], rtol=1e-5)
