"""What programs of others make of the stream: MAVSDK discovers and reads; MAVProxy links up."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from command_line import ROOT, strict
from peers import lacking, package
from streamed_vehicle import PROGRAM, SILENT, free_port

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
