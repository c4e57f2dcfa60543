"""The stream on a real link: the command line, its log, a counting receiver."""

import io
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import Counter
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from command_line import call, refused, strict
from streamed_vehicle import PROGRAM, SILENT, common

from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.wire import Signing, open_link
from insenv.scenario import load

PARAM_VALUE = common.MAVLINK_MSG_ID_PARAM_VALUE


class Receiver:
    """A UDP socket that a thread reads into memory."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.port = self.socket.getsockname()[1]
        self.frames = []
        self._open = True
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        while self._open:
            try:
                self.frames.append(self.socket.recv(2048))
            except TimeoutError:
                continue

    def close(self):
        time.sleep(0.3)
        self._open = False
        self._thread.join()
        self.socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def messages(self):
        reader = common.MAVLink(None)
        return [reader.decode(bytearray(frame)) for frame in self.frames]


def lost(frames):
    """Frames missing between the first and the last, by their sequence numbers."""
    numbers = np.array([frame[4] for frame in frames])
    return int(np.sum((np.diff(numbers) - 1) % 256))


# --- the command line ----------------------------------------------------------------------------------


def test_stream_prints_one_document_and_writes_a_log_that_mavlogdump_reads_whole(tmp_path):
    log = tmp_path / "flight.tlog"
    with Receiver() as client:
        arguments = ("--to", f"udpout:127.0.0.1:{client.port}", "--speed", 0, "--duration", 6, "--tlog", log, "--json")
        status, out, err = call("stream", "car-city-drive", *arguments, "--rate", "ATTITUDE=50", "--rate", "ALTITUDE=0")
    found = strict(out)
    assert (status, err) == (0, "") and found["simulated_s"] == pytest.approx(6.0) and found["tlog"] == str(log)
    assert found["sent"]["ATTITUDE"] == 300 and found["sent"]["HIL_SENSOR"] == 1200 and "ALTITUDE" not in found["sent"]
    assert not found["saturated"] and not found["refused"] and found["link"]["dropped_frames"] == 0
    total = sum(found["sent"].values())
    assert len(client.frames) == total and lost(client.frames) == 0

    dump = [sys.executable, "-m", "pymavlink.tools.mavlogdump"]
    if find_spec("pymavlink.tools.mavlogdump") is None:
        dump = [sys.executable, str(Path(sys.executable).parent / "mavlogdump.py")]
    shown = subprocess.run([*dump, "--format", "json", str(log)], capture_output=True, text=True, timeout=120)
    assert shown.returncode == 0, shown.stderr
    rows = [json.loads(line) for line in shown.stdout.splitlines() if line.startswith("{")]
    types = Counter(row["meta"]["type"] for row in rows)
    parameters = types.pop("PARAM_VALUE")
    assert parameters > 50 and types == found["sent"]
    from pymavlink import mavutil

    reader = mavutil.mavlogfile(str(log))
    while reader.recv_match() is not None:
        pass
    assert (reader.mav_loss, reader.mav_count) == (0, parameters + total)
    reader.close()


def test_wrong_calls_are_refused(tmp_path):
    to = ("--to", "udpout:127.0.0.1:9")
    refused(call("stream", "car-city-drive"), "--to")
    refused(call("stream", "car-city-driv", *to), "car-city-driv", "did you mean 'car-city-drive'")
    refused(call("stream", "car-city-drive", "--to", "udp:1"), "udp:1", "udpout:HOST:PORT")
    refused(call("stream", "car-city-drive", *to, "--rate", "ATITUDE=5"), "ATITUDE", "ATTITUDE")
    refused(call("stream", "car-city-drive", *to, *to), "udpout:127.0.0.1:9", "twice")
    refused(call("stream", "car-city-drive", *(("--to", "udpin:127.0.0.1:0") * 5)), "5 addresses", "1 to 4")
    refused(call("stream", "car-city-drive", *to, "--to", "udpin::1", "--lockstep", "px4"), "2 addresses")
    refused(call("stream", "car-city-drive", *to, "--speed", "-1"), "speed", "as fast as possible")
    refused(call("stream", "car-city-drive", *to, "--duration", "0"), "--duration")
    refused(call("stream", "car-city-drive", *to, "-e", "smoother"), "smoother", "loosely-coupled")
    refused(call("stream", "car-city-drive", "--lockstep", "px4", "--speed", "1e-6"), "0.01 to 100")
    refused(call("stream", "car-city-drive", "--lockstep", "px4", "--to", "udpin:127.0.0.1:0"), "tcpin:HOST:PORT")
    refused(call("stream", "car-city-drive", "--lockstep", "ardupilot-json", "--tlog", tmp_path / "a"), "--tlog")
    refused(call("stream", "car-city-drive", *to, "--signing-key-file", tmp_path / "no"), "not found")
    refused(call("stream", "car-city-drive", "--lockstep", "ardupilot-json", "--rate", "ATTITUDE=5"), "--rate")
    refused(call("stream", "car-city-drive", "--lockstep", "px4", "--undulation", "5"), "--undulation", "--lockstep")
    given = ("stream", "car-city-drive", "--to", "udpout:127.0.0.1:9", "--duration", "1", "--speed", "0")
    refused(call(*given, "--rate", "ATTITUDE=10", "--rate", "attitude=20"), "--rate ATTITUDE is given twice: 10 and 20 Hz")
    refused(call(*given, "--rate", "ATTITUDE=1000"), "rate of ATTITUDE = 1000 Hz", "allowed is 0 (never) to 200 Hz")
    refused(call(*given, "--undulation", "121"), "undulation = 121 m", "-120 to 120 m")
    for path, word in (
        (tmp_path, "folder"),
        (".", "folder"),
        (os.devnull, "not a regular file"),
        (tmp_path / "no" / "a", "No such"),
    ):
        refused(call("stream", "car-city-drive", *to, "--tlog", path), word)
    assert not list(tmp_path.iterdir())


def test_a_stream_without_a_receiver_reports_it():
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # and does not listen
        to = f"tcpout:127.0.0.1:{closed.getsockname()[1]}"
        status, out, err = call("stream", "ship-swaying", "--to", to, "--speed", 0, "--duration", 1)
    assert (status, err) == (0, "") and f"none sent: no receiver at {to}" in out


def until(condition, seconds=60.0):
    """Wait for a condition."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def logged(path):
    """The frames of a complete log after the parameters with which it begins."""
    data, at, frames = path.read_bytes(), 0, []
    while at < len(data):
        size = 12 + data[at + 9]
        frames.append(data[at + 8 : at + 8 + size])
        assert len(frames[-1]) == size and frames[-1][0] == 0xFD
        at += 8 + size
    number = next(i for i, frame in enumerate(frames) if int.from_bytes(frame[7:10], "little") != PARAM_VALUE)
    assert number > 50
    return frames[number:]


PLAIN = "from insenv.cli import main; main()"
IGNORING = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); " + PLAIN
"""As a shell starts the background jobs of a script."""
HANGING_UP = "import signal; signal.signal(signal.SIGHUP, signal.SIG_DFL); " + PLAIN
"""Hears SIGHUP, also where the tests run with it ignored, as below nohup."""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX systems")
@pytest.mark.parametrize(
    "number, program",
    [
        ("SIGINT", PROGRAM),
        pytest.param("SIGINT", IGNORING, marks=pytest.mark.slow),
        ("SIGTERM", PLAIN),
        pytest.param("SIGHUP", HANGING_UP, marks=pytest.mark.slow),
    ],
)
def test_every_request_to_end_completes_log_and_summary(number, program, tmp_path):
    with Receiver() as client:
        arguments = ["stream", "ship-swaying", "--to", f"udpout:127.0.0.1:{client.port}", "--tlog", str(tmp_path / "a.tlog")]
        command = [sys.executable, "-c", program, *arguments, "--json"]
        running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        until(lambda: len(client.frames) > 500)
        running.send_signal(getattr(signal, number))
        out, err = running.communicate(timeout=30)
    assert (running.returncode, err.replace(b"insenv: compiling, once\n", b"")) == (0, b"")
    summary = strict(out.decode())
    assert summary["interrupted"] is True and summary["scenario"] == "ship-swaying"
    assert len(logged(tmp_path / "a.tlog")) == sum(summary["sent"].values()) == len(client.frames)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX systems")
def test_a_lockstep_that_waits_for_its_autopilot_is_ended_alike():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = ["stream", "car-city-drive", "--lockstep", "ardupilot-json", "--to", f"udpin:127.0.0.1:{port}", "--json"]
    running = subprocess.Popen([sys.executable, "-c", PLAIN, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
        autopilot.settimeout(0.2)
        autopilot.connect(("127.0.0.1", port))

        def answered():
            try:
                autopilot.send(struct.pack("<HHI16H", 18458, 200, 0, *[1500] * 16))
                return autopilot.recv(4096)
            except (TimeoutError, ConnectionError):
                time.sleep(0.05)
                return b""

        until(answered, 60.0)
    running.terminate()
    out, err = running.communicate(timeout=30)
    assert (running.returncode, err.replace(b"insenv: compiling, once\n", b"")) == (0, b"")
    found = strict(out.decode())
    assert found["interrupted"] is True and found["progress"]["steps"] == 1


@pytest.mark.skipif(os.name != "posix", reason="terminals of POSIX systems")
def test_a_closed_terminal_ends_a_stream(tmp_path):
    import fcntl
    import pty
    import termios

    terminal, inside = pty.openpty()

    def take_terminal():
        os.setsid()
        fcntl.ioctl(inside, termios.TIOCSCTTY, 0)

    with Receiver() as client:
        arguments = ["stream", "ship-swaying", "--to", f"udpout:127.0.0.1:{client.port}", "--tlog", str(tmp_path / "a.tlog")]
        running = subprocess.Popen(
            [sys.executable, "-c", HANGING_UP, *arguments], stdin=inside, stdout=inside, stderr=inside, preexec_fn=take_terminal
        )
        os.close(inside)
        until(lambda: len(client.frames) > 500)
        assert b"ship-swaying" in os.read(terminal, 65536)  # the dashboard
        os.close(terminal)
        assert running.wait(timeout=30) == 0
    assert len(logged(tmp_path / "a.tlog")) == len(client.frames) and not list(tmp_path.glob("*.part"))


def test_several_addresses_are_several_links(tmp_path):
    with Receiver() as first, Receiver() as second:
        to = [f"udpout:127.0.0.1:{client.port}" for client in (first, second)]
        arguments = ("--to", to[0], "--to", to[1], "--speed", 0, "--duration", 2, "--tlog", tmp_path / "a.tlog", "--json")
        status, out, err = call("stream", "ship-swaying", *arguments)
    found = strict(out)
    total = sum(found["sent"].values())
    assert (status, err) == (0, "") and [link["address"] for link in found["links"]] == to
    assert len(first.frames) == len(second.frames) == total == len(logged(tmp_path / "a.tlog"))
    assert lost(first.frames) == lost(second.frames) == 0 and found["link"]["sent_frames"] == 2 * total
    assert found["link"]["sent_messages"] == total


def test_links_that_share_a_key_sign_with_numbers_of_their_own(tmp_path):
    key_file = tmp_path / "key"
    key_file.write_bytes(bytes(range(32)))
    key_file.chmod(0o600)
    with Receiver() as first, Receiver() as second:
        to = [f"udpout:127.0.0.1:{client.port}" for client in (first, second)]
        arguments = ("--to", to[0], "--to", to[1], "--speed", 0, "--duration", 1, "--signing-key-file", key_file)
        assert call("stream", "ship-swaying", *arguments)[0] == 0
    assert {frame[-13] for frame in first.frames} == {0} and {frame[-13] for frame in second.frames} == {1}
    times = [int.from_bytes(frame[-12:-6], "little") for frame in first.frames]
    assert len(times) > 200 and all(a < b for a, b in pairwise(times))


def test_answers_go_to_the_link_of_the_question():
    vehicle = Vehicle(load("ship-swaying"), rates=SILENT)
    with open_link("udpin:127.0.0.1:0") as one, open_link("udpin:127.0.0.1:0") as other:
        stream = Stream(vehicle, (one, other))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
            client.connect(("127.0.0.1", other.address.port))
            client.settimeout(5.0)
            client.send(common.MAVLink_ping_message(1, 3, 0, 0).pack(common.MAVLink(None, 245, 190)))
            until(lambda: stream.serve() or stream.sent["PING"])
            kinds = {common.MAVLink(None).decode(bytearray(client.recv(2048))).get_type() for _ in range(2)}
        assert "PING" in kinds and [len(link.peers) for link in (one, other)] == [0, 1]
        assert one.statistics.sent_frames == 0 and stream.statistics.received_messages == 1


@pytest.mark.parametrize("width", [40, 60, 80, 100])
def test_dashboard_shows_rates_lateness_clients_errors_and_alignment(width):
    from rich.console import Console

    from insenv.cli.stream import Rates, picture

    vehicle = Vehicle(load("ship-swaying"), speed=0.0)
    with Receiver() as client, open_link(f"udpout:127.0.0.1:{client.port}") as link:
        stream, rates = Stream(vehicle, link), Rates()
        console = Console(width=width, record=True, file=io.StringIO())
        picture(stream, rates, now=0.0, width=width)
        stream.run(10.0)
        console.print(picture(stream, rates, now=10.0, width=width))
        total = link.statistics.sent_frames
    text = console.export_text()
    assert re.search(r"HIL_SENSOR +200\.0", text) and re.search(r"ATTITUDE +20\.0", text)
    for name, count in stream.sent.items():  # no column is lost
        assert re.search(rf"{name[:20]} +{count / 10:.1f}", text), name
    flat = " ".join(text.split())
    for word in ("lateness", "p99", f"127.0.0.1:{client.port}", "aligning", "tilt", "q-method", "as fast as possible"):
        assert word in flat, word
    assert f"{total} sent to 1 client" in flat and re.search(r"error +tilt \S+ deg, heading \S+ deg", flat)
    assert max(map(len, text.splitlines())) <= width


def test_dashboard_counts_what_clients_got():
    from rich.console import Console

    from insenv.cli.stream import Rates, picture

    with open_link("udpin:127.0.0.1:0") as link:
        stream = Stream(Vehicle(load("ship-swaying"), speed=0.0), link)
        stream.run(1.0)
        console = Console(width=100, record=True, file=io.StringIO())
        console.print(picture(stream, Rates()))
    assert sum(stream.sent.values()) > 100 and "0 sent to 0 clients" in console.export_text()


def test_several_vehicles_stream_to_one_ground_station():
    with Receiver() as client:
        to = ("--to", f"udpout:127.0.0.1:{client.port}", "--speed", 0, "--duration", 2)
        for system in (1, 7):
            assert call("stream", "ship-swaying", *to, "--system", system, "--errors")[0] == 0
    heartbeats = {m.get_srcSystem() for m in client.messages() if m.get_type() == "HEARTBEAT"}
    assert heartbeats == {1, 7} == {frame[5] for frame in client.frames}
    assert {m.name for m in client.messages() if m.get_type() == "NAMED_VALUE_FLOAT"} == {"ERR_TILT", "ERR_HDG"}
    refused(call("stream", "ship-swaying", *to, "--system", 0), "1 to 255")
    refused(call("stream", "car-city-drive", "--lockstep", "px4", "--system", 2), "--system")


@pytest.mark.parametrize("kind", ["px4", "ardupilot-json"])
def test_lockstep_from_the_command_line(kind, tmp_path):
    """A stand-in for the autopilot answers each step once."""
    scheme = "tcpin" if kind == "px4" else "udpin"
    family = socket.SOCK_STREAM if kind == "px4" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, family) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    to = f"{scheme}:127.0.0.1:{port}"
    arguments = ["stream", "car-city-drive", "--lockstep", kind, "--to", to, "--duration", "1", "--json"]
    arguments += ["--tlog", str(tmp_path / "px4.tlog")] if kind == "px4" else []
    said = []
    running = threading.Thread(target=lambda: said.append(call(*arguments)), daemon=True)
    running.start()
    peer = socket.socket(socket.AF_INET, family)
    peer.settimeout(0.5)
    until, times = time.monotonic() + 60.0, []
    packer, reader, number = common.MAVLink(None, 1, 1), common.MAVLink(None), 0
    if kind == "px4":
        while peer.connect_ex(("127.0.0.1", port)) and time.monotonic() < until:
            time.sleep(0.05)
            peer.close()
            peer = socket.socket(socket.AF_INET, family)
            peer.settimeout(0.5)
        peer.send(common.MAVLink_heartbeat_message(1, 12, 0, 0, 3, 3).pack(packer))
    else:
        peer.connect(("127.0.0.1", port))
    while running.is_alive() and time.monotonic() < until:
        try:
            if kind == "ardupilot-json":
                peer.send(struct.pack("<HHI16H", 18458, 200, number, *[1500] * 16))
                row = json.loads(peer.recv(4096))
                number, times = number + 1, [*times, row["timestamp"]]
                continue
            data = peer.recv(65536)
        except (TimeoutError, ConnectionError):
            time.sleep(0.05)
            continue
        for message in reader.parse_buffer(data) or ():
            if message.get_type() == "HIL_SENSOR" and message.id == 0:
                times.append(message.time_usec / 1e6)
                answer = common.MAVLink_hil_actuator_controls_message(message.time_usec, [0.0] * 16, 0, 1)
                peer.send(answer.pack(packer))
    peer.close()
    running.join(timeout=30)
    ((status, out, err),) = said
    assert (status, err) == (0, "")
    found = strict(out)
    assert found["simulated_s"] == pytest.approx(1.0) and found["progress"]["steps"] == 200
    np.testing.assert_allclose(np.diff(np.unique(times)), 0.005, atol=1e-9)  # a repeated request has the same answer
    assert times[-1] == pytest.approx(1.0) or times[-1] == pytest.approx(0.995)  # the last answer may come after the end
    assert kind != "px4" or (tmp_path / "px4.tlog").stat().st_size > 200 * 70


# --- completeness ----------------------------------------------------------------------------------------


def test_200_hz_and_telemetry_arrive_whole_and_in_time_order():
    vehicle = Vehicle(load("car-city-drive"))
    with Receiver() as client:
        with open_link(f"udpout:127.0.0.1:{client.port}") as link:
            stream = Stream(vehicle, link)
            stream.run(3.0)
        time.sleep(0.2)
    assert len(client.frames) == link.statistics.sent_frames == sum(stream.sent.values()) and lost(client.frames) == 0
    sensors = [m.time_usec for m in client.messages() if m.get_type() == "HIL_SENSOR"]
    assert sensors == [5000 * k for k in range(1, 601)]  # the simulation's clock, without gap or repetition


def test_heartbeats_and_answers_continue_while_paused():
    vehicle = Vehicle(load("car-city-drive"), rates=SILENT)
    vehicle.set_paused(True)
    with open_link("udpin:127.0.0.1:0") as link:
        client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        client.settimeout(0.0)
        client.connect(("127.0.0.1", link.address.port))
        packer, reader = common.MAVLink(None, 245, 190), common.MAVLink(None)
        client.send(common.MAVLink_param_request_list_message(1, 1).pack(packer))
        stream, found = Stream(vehicle, link), []
        until = time.monotonic() + 2.5
        while time.monotonic() < until:
            stream.tick()
            while True:
                try:
                    found.append(reader.decode(bytearray(client.recv(2048))))
                except BlockingIOError:
                    break
        client.close()
    kinds = Counter(m.get_type() for m in found)
    assert kinds["PARAM_VALUE"] == len(vehicle.parameters) and kinds["HEARTBEAT"] >= 2 and kinds["STATUSTEXT"] == 1
    assert vehicle.simulation.samples == 0 and lost([bytes(m.get_msgbuf()) for m in found]) == 0


@pytest.mark.parametrize("command, value", [(31013, 0.0), (31013, 100.0), (31012, 1.0)])
def test_a_slow_stream_obeys_a_new_speed_and_a_pause_at_once(command, value):
    """At the slowest speed a sample of `slow` takes 100 s of wall time: the command must not wait for its end."""
    slow = load("ship-swaying").model_copy(update={"rate_hz": 1.0})
    vehicle = Vehicle(slow, rates=SILENT, speed=0.01)
    with open_link("udpin:127.0.0.1:0") as link, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect(("127.0.0.1", link.address.port))
        packed = common.MAVLink_command_long_message(1, 1, command, 0, value, 0, 0, 0, 0, 0, 0)
        client.send(packed.pack(common.MAVLink(None, 245, 190)))
        stream = Stream(vehicle, link)
        begun = time.monotonic()
        for _ in range(3):
            stream.tick()
        took = time.monotonic() - begun
    assert took < 5.0 and stream.received["COMMAND_LONG"] == 1
    assert vehicle.simulation.samples == (0 if command == 31012 else 2)


def test_on_a_signed_link_only_signed_commands_act(tmp_path):
    key_file = tmp_path / "key"
    key_file.write_bytes(bytes(range(32)))
    key_file.chmod(0o600)
    vehicle = Vehicle(load("car-city-drive"), rates=SILENT)
    with open_link("udpin:127.0.0.1:0", signing=Signing.from_key_file(key_file)) as link:
        stream = Stream(vehicle, link)
        client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        client.connect(("127.0.0.1", link.address.port))
        packer = common.MAVLink(None, 245, 190)

        def cut():
            client.send(common.MAVLink_command_long_message(1, 1, 31011, 0, 0, 0, 0, 0, 0, 0, 0).pack(packer))
            packer.seq = (packer.seq + 1) % 256
            for _ in range(20):
                stream.tick()

        cut()
        packer.signing.sign_outgoing, packer.signing.timestamp = True, int((time.time() - 1420070400) * 1e5)
        packer.signing.secret_key = bytes(32)
        cut()
        assert vehicle.simulation.gnss_on and not stream.received
        assert link.statistics.unsigned == link.statistics.wrongly_signed == 1
        packer.signing.secret_key = bytes(range(32))
        cut()
        assert not vehicle.simulation.gnss_on and stream.received["COMMAND_LONG"] == 1
        client.settimeout(5.0)
        frames = [client.recv(2048)]
        while packer.decode(bytearray(frames[-1])).get_type() != "COMMAND_ACK":
            frames.append(client.recv(2048))
        client.close()
    assert all(frame[2] & 1 for frame in frames)  # all that is sent is signed
