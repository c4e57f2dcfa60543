"""What programs of others make of the stream: MAVSDK discovers and reads; MAVProxy links up; tshark reads a log."""

import json
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time
from collections import Counter
from pathlib import Path

import pytest
from command_line import ROOT, call, strict
from peers import lacking, package, program
from pymavlink.dialects.v20 import common
from streamed_vehicle import PROGRAM, SILENT, free_port, records

from insenv.mavlink import Vehicle
from insenv.scenario import load


def streaming(port, *options):
    arguments = ["stream", "car-city-drive", "--to", f"udpout:127.0.0.1:{port}", "--json", *options]
    command = [sys.executable, "-c", PROGRAM, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_mavsdk_discovers_a_healthy_vehicle_and_sees_all_that_it_sends():
    package("mavsdk")
    port = free_port()
    vehicle = streaming(port, "--speed", "4")  # the car stands for 30 s, and is not aligned before it drives
    try:
        script = str(ROOT / "tests" / "helpers" / "mavsdk_client.py")
        client = [sys.executable, script, f"udpin://127.0.0.1:{port}", "5", "MAN_SPEED", "7.5"]
        answer = subprocess.run(client, capture_output=True, text=True, timeout=90)
    finally:
        vehicle.send_signal(signal.SIGINT)
        out, _ = vehicle.communicate(timeout=30)
    assert answer.returncode == 0, answer.stderr
    (document,) = [line for line in answer.stdout.splitlines() if line.startswith("{")]
    found, summary = json.loads(document), strict(out)
    seen = found["seen"]
    assert found["system"] == [1, [1], "ROVER", "GENERIC"] and seen["landed_state"][-1] == "ON_GROUND"
    assert seen["health_all_ok"][-1] is True and all(seen["health"][-1].values())
    assert (found["version"]["flight_sw_major"], found["version"]["flight_sw_minor"]) == (0, 1)
    assert found["set"] == [15.0, 7.5] and summary["received"]["PARAM_SET"] >= 1 and not summary["saturated"]
    # MAVSDK refuses these downloads unless AUTOPILOT_VERSION announces them
    assert found["downloads"] == [[], [], []] and summary["received"]["MISSION_REQUEST_LIST"] == 3
    twin = Vehicle(load("car-city-drive"), rates=SILENT, speed=4.0)
    listed = {row["name"]: row["value"] for row in found["parameters"]["float_params"]}
    expected = {parameter.name: pytest.approx(parameter.value(), rel=1e-6, abs=1e-30) for parameter in twin.parameters.all}
    assert listed | {"MAN_SPEED": 15.0} == expected and not found["parameters"]["int_params"]
    streams = ("attitude_quaternion", "ground_truth", "position", "velocity_ned", "imu")  # the numbers: test_messages.py
    assert min(len(seen[name]) for name in streams) > 30 and seen["gps_info"][-1]["fix_type"] == "FIX_3D"


@pytest.mark.slow
def test_mavproxy_links_up_reads_all_parameters_and_lists_waypoints(tmp_path):
    if not os.environ.get("INSENV_MAVPROXY"):
        lacking("INSENV_MAVPROXY names no python that has MAVProxy (make .venv/.stamp-mavproxy-1.8.75)")
    python = os.path.abspath(os.environ["INSENV_MAVPROXY"])
    port = free_port()
    # on a busy machine MAVProxy, with a default buffer, loses some of 375 messages/s: reduce the messages for autopilots
    vehicle = streaming(port, "--rate", "HIL_SENSOR=0", "--rate", "HIGHRES_IMU=10")
    proxy = subprocess.Popen(
        [python, str(Path(python).parent / "mavproxy.py"), f"--master=udpin:127.0.0.1:{port}", f"--state-basedir={tmp_path}"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path,
    )  # fmt: skip
    said, reader = [], None

    def read():
        said.extend(iter(lambda: proxy.stdout.read(1), ""))

    def wait_for(pattern, seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            if found := re.search(pattern, "".join(said)):
                return found
            time.sleep(0.1)
        pytest.fail(f"MAVProxy did not say {pattern!r}:\n{''.join(said)}")

    try:
        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        wait_for(r"online system 1", 60)  # "link 1 OK" appears only after a loss
        received = int(wait_for(r"Received (\d+) parameters", 30).group(1))
        wait_for(r"GPS lock", 15)
        proxy.stdin.write("wp list\n")
        proxy.stdin.flush()
        wait_for(r"Requesting 0 waypoints", 15)
        proxy.stdin.write("link\n")
        proxy.stdin.flush()
        lost = wait_for(r"link 1 OK \(\d+ packets, .* (\d+) lost", 10).group(1)
    finally:
        proxy.stdin.close()
        proxy.send_signal(signal.SIGINT)
        proxy.wait(timeout=30)
        reader.join(timeout=10)
        proxy.stdout.close()
        vehicle.send_signal(signal.SIGINT)
        _, err = vehicle.communicate(timeout=30)
    assert lost == "0" and vehicle.returncode == 0, err
    assert received == len(Vehicle(load("car-city-drive")).parameters)


LINKTYPE_IPV4 = 228
PORT = 14550  # of the dissector
FIELDS = ("sequence", "crc", "msgid", "rawpayload", "rawheader")


def capture(frames):
    """The frames as a capture of UDP datagrams over IPv4."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, LINKTYPE_IPV4)]
    for time_us, frame in frames:
        udp = struct.pack(">HHHH", PORT + 1, PORT, 8 + len(frame), 0) + frame
        place = bytes((127, 0, 0, 1))
        packet = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, place, place) + udp
        parts += [struct.pack("<IIII", *divmod(time_us, 10**6), len(packet), len(packet)), packet]
    return b"".join(parts)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """A log of 6 s, and how many messages of each kind were sent or recorded: it begins with all parameters."""
    log = tmp_path_factory.mktemp("flight") / "flight.tlog"
    arguments = ("--to", "udpout:127.0.0.1:9", "--speed", 0, "--duration", 6, "--tlog", log, "--json")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("INSENV_BACKEND", "interpreter")
        sent = Counter(strict(call("stream", "car-city-drive", *arguments)[1])["sent"])
    return log, sent + Counter(PARAM_VALUE=len(Vehicle(load("car-city-drive")).parameters))


@pytest.mark.slow
def test_tshark_decodes_a_whole_log(flight, tmp_path):
    """With the dissector that pymavlink generates."""
    tshark, dissector = program("tshark", how="Debian: tshark"), tmp_path / "mavlink.lua"
    log, recorded = flight
    frames = list(records(log))
    (tmp_path / "flight.pcap").write_bytes(capture(frames))
    definitions = Path(common.__file__).with_suffix(".xml")
    generate = ["-m", "pymavlink.tools.mavgen", "--no-validate", "--lang", "WLua", "--wire-protocol", "2.0", "-o", dissector]
    subprocess.run([sys.executable, *generate, definitions], check=True, capture_output=True, timeout=120)
    shown = subprocess.run(
        [tshark, "-r", tmp_path / "flight.pcap", "-X", f"lua_script:{dissector}", "-Y", "mavlink_proto", "-T", "fields"]
        + [word for name in FIELDS for word in ("-e", f"mavlink_proto.{name}")],
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
    )
    rows = [dict(zip(FIELDS, line.split("\t"), strict=True)) for line in shown.stdout.splitlines()]
    names = {number: kind.msgname for number, kind in common.mavlink_map.items()}
    assert Counter(names[int(row["msgid"])] for row in rows) == recorded
    assert [int(row["sequence"]) for row in rows] == [number % 256 for number in range(len(rows))]
    assert [int(row["crc"], 16) for row in rows] == [int.from_bytes(frame[-2:], "little") for _, frame in frames]
    assert not any(row["rawpayload"] or row["rawheader"] for row in rows)
