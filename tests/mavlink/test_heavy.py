"""MAVLink tests that take minutes or an environment of their own: `make test-mavlink`.

INSENV_TEST_MAVLINK=1 asks for them; INSENV_MAVPROXY names the python of an environment that holds MAVProxy.
"""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.wire import TlogWriter, open_link
from insenv.scenario import load

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not os.environ.get("INSENV_TEST_MAVLINK"), reason="takes minutes: make test-mavlink"),
]
PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from insenv.cli import main; main()"


def resident_mb():
    """Memory of this process, MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


COUNTING = """
import socket, sys
# a TCP client that counts frames: prints their number, and the number of missing sequence numbers
peer = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
frames = skipped = 0
last, kept = None, b""
while data := peer.recv(1 << 16):
    kept, at = kept + data, 0
    while len(kept) - at >= 10 and len(kept) - at >= 12 + kept[at + 1]:
        assert kept[at] == 0xFD
        if last is not None:
            skipped += (kept[at + 4] - last - 1) % 256
        last = kept[at + 4]
        frames += 1
        at += 12 + kept[at + 1]
    kept = kept[at:]
print(frames, skipped)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is read from /proc")
def test_ten_minutes_at_full_speed_in_flat_memory_and_every_number_accounted_for(tmp_path):
    vehicle = Vehicle(load("car-city-drive"), speed=0.0)
    log = tmp_path / "long.tlog"
    with open_link("tcpin:127.0.0.1:0") as link, TlogWriter(log) as recorder:
        client = subprocess.Popen([sys.executable, "-c", COUNTING, str(link.address.port)], stdout=subprocess.PIPE, text=True)
        while not link.peers:
            link.receive()
        stream, memory = Stream(vehicle, link, recorder), []
        for _ in range(10):
            stream.run(60.0)
            memory.append(resident_mb())
        for _ in range(100):  # send what is pending for the client
            link.receive()
            time.sleep(0.01)
    received, skipped = map(int, client.communicate(timeout=60)[0].split())
    print("memory by minute, MB:", [round(m, 1) for m in memory], "times real time:", 600.0 / stream.wall_s)
    assert max(memory[1:]) - min(memory[1:]) < 3.0
    total, statistics = sum(stream.sent.values()), link.statistics
    assert total == statistics.sent_messages == statistics.sent_frames + statistics.dropped_frames
    assert received == statistics.sent_frames and skipped % 256 == statistics.dropped_frames % 256
    assert stream.sent["HIL_SENSOR"] == 120_000 and not vehicle.view.fields.refused
    data, at, numbers = log.read_bytes(), 0, []
    while at < len(data):
        numbers.append(data[at + 8 + 4])
        at += 8 + 12 + data[at + 9]
    parameters = len(vehicle.parameters)  # the log begins with them
    assert len(numbers) == stream.recorded == parameters + total
    assert np.all(np.diff(np.array(numbers)) % 256 == 1)


@pytest.mark.skipif(not os.environ.get("INSENV_MAVPROXY"), reason="INSENV_MAVPROXY names no python that has MAVProxy")
def test_mavproxy_links_up_reads_all_parameters_and_lists_waypoints(tmp_path):
    python = os.path.abspath(os.environ["INSENV_MAVPROXY"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    # on a busy machine MAVProxy, with a default buffer, loses some of 375 messages/s: reduce the messages for autopilots
    rates = ("--rate", "HIL_SENSOR=0", "--rate", "HIGHRES_IMU=10")
    vehicle = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "stream", "car-city-drive", "--to", f"udpout:127.0.0.1:{port}", "--json", *rates],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
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

    def ask(line):
        proxy.stdin.write(line + "\n")
        proxy.stdin.flush()

    try:
        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        wait_for(r"online system 1", 60)  # "link 1 OK" appears only after a loss
        received = int(wait_for(r"Received (\d+) parameters", 30).group(1))
        ask("param show E_INN_GATE")
        wait_for(r"E_INN_GATE +5\.0", 10)
        ask("wp list")
        wait_for(r"Requesting 0 waypoints", 15)
        ask("param set E_INN_GATE 4")
        time.sleep(2)
        ask("param fetch E_INN_GATE")
        wait_for(r"E_INN_GATE = 4\.0", 15)
        wait_for(r"GPS lock", 15)
        ask("link")
        lost = wait_for(r"link 1 OK \(\d+ packets, .* (\d+) lost", 10).group(1)
    finally:
        proxy.stdin.close()
        proxy.send_signal(signal.SIGINT)
        proxy.wait(timeout=30)
        reader.join(timeout=10)
        proxy.stdout.close()
        vehicle.send_signal(signal.SIGINT)
        out, err = vehicle.communicate(timeout=30)
    assert lost == "0" and vehicle.returncode == 0, err
    assert received == len(Vehicle(load("car-city-drive")).parameters)
    code = "import sys; from pymavlink import mavutil; r = mavutil.mavlogfile(sys.argv[1])\n"
    code += "while r.recv_match() is not None: pass\n"
    code += "print(r.mav_loss, r.mav_count, 'ODOMETRY' in r.messages)"
    shown = subprocess.run([python, "-c", code, str(tmp_path / "mav.tlog")], capture_output=True, text=True, timeout=60)
    loss, count, has_odometry = shown.stdout.split()
    assert (loss, has_odometry) == ("0", "True") and int(count) > 500, shown.stderr
    assert '"PARAM_REQUEST_LIST"' in out and '"FILE_TRANSFER_PROTOCOL"' in out
