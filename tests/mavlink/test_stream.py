"""The stream on links: completeness, pauses, speeds, signed commands; its log."""

import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from streamed_vehicle import frame_of, logged, lost, ping, quiet, wait_for

from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.wire import TlogWriter, open_link
from insenv.scenario import load


def test_heartbeats_and_answers_continue_while_paused(opened, sockets, monkeypatch):
    monkeypatch.setattr("insenv.mavlink.stream.HEARTBEAT_S", 0.1)
    vehicle, link = quiet(), opened("udpin:127.0.0.1:0")
    vehicle.set_paused(True)
    client, reader, found = sockets(to=link.address.port), common.MAVLink(None), []
    client.setblocking(False)
    client.send(frame_of(common.MAVLink_param_request_list_message(1, 1)))
    stream = Stream(vehicle, link)

    def received():
        stream.tick()
        try:
            while True:
                found.append(reader.decode(bytearray(client.recv(2048))))
        except BlockingIOError:
            kinds = Counter(m.get_type() for m in found)
            return kinds["PARAM_VALUE"] == len(vehicle.parameters) and kinds["HEARTBEAT"] >= 3

    wait_for(received)
    assert [m.get_type() for m in found].count("STATUSTEXT") == 1
    assert vehicle.simulation.samples == 0 and lost([bytes(m.get_msgbuf()) for m in found]) == 0


@pytest.mark.parametrize("command, value, samples", [(31013, 0.0, 2), (31013, 100.0, 2), (31012, 1.0, 0)])
def test_a_slow_stream_obeys_a_new_speed_and_a_pause_at_once(command, value, samples, opened, sockets):
    """At the slowest speed a sample takes 100 s of wall time: the command must not wait for its end, in the first tick."""
    vehicle, link = quiet("ship-swaying", hz=1.0, speed=0.01), opened("udpin:127.0.0.1:0")
    sockets(to=link.address.port).send(frame_of(common.MAVLink_command_long_message(1, 1, command, 0, value, 0, 0, 0, 0, 0, 0)))
    stream = Stream(vehicle, link)
    for _ in range(3):
        stream.tick()
    assert stream.received["COMMAND_LONG"] == 1 and vehicle.simulation.samples == samples


def test_answers_go_to_the_link_of_the_question_and_both_into_the_log(opened, sockets, tmp_path):
    one, other = opened("udpin:127.0.0.1:0"), opened("udpin:127.0.0.1:0")
    client = sockets(to=other.address.port)
    with TlogWriter(tmp_path / "a.tlog") as recorder:
        stream = Stream(quiet("ship-swaying", speed=0.0), (one, other), recorder)
        stream.run(0.05)
        client.send(frame_of(ping(1)))
        wait_for(lambda: stream.serve() or stream.sent["PING"])
        kinds = {common.MAVLink(None).decode(bytearray(client.recv(2048))).get_type() for _ in range(2)}
    assert "PING" in kinds and [len(link.peers) for link in (one, other)] == [0, 1]
    assert one.statistics.sent_frames == 0 and stream.statistics.received_messages == 1
    _, frames = logged(tmp_path / "a.tlog")
    pings = [(frame[5], frame[6]) for frame in frames if frame[7] == common.MAVLINK_MSG_ID_PING]
    assert pings == [(255, 190), (1, 1)] and stream.recorded == len(stream.vehicle.parameters) + len(frames) - 1


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


def resident_mb():
    """Memory of this process, MB; 0 where it cannot be read."""
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6 if file.exists() else 0.0


@pytest.mark.parametrize("periods, seconds", [(3, 1.0), pytest.param(10, 60.0, marks=pytest.mark.slow)])
def test_a_stream_at_full_speed_has_flat_memory_and_accounts_for_every_number(tmp_path, monkeypatch, periods, seconds):
    monkeypatch.setattr("insenv.mavlink.stream.WATCH_S", 0.01)
    vehicle, log = Vehicle(load("car-city-drive"), speed=0.0), tmp_path / "long.tlog"
    with open_link("tcpin:127.0.0.1:0") as link, TlogWriter(log) as recorder:
        client = subprocess.Popen([sys.executable, "-c", COUNTING, str(link.address.port)], stdout=subprocess.PIPE, text=True)
        wait_for(lambda: link.receive() or link.peers)
        stream, memory, watched = Stream(vehicle, link, recorder), [], []
        for _ in range(periods):
            stream.run(seconds, watched.append)
            memory.append(resident_mb())
        for _ in range(100):  # send what is pending for the client
            link.receive()
            time.sleep(0.001 * seconds)
    received, skipped = map(int, client.communicate(timeout=60)[0].split())
    assert watched and 0.0 < vehicle.view.load <= 1.0
    assert seconds < 60.0 or max(memory[1:]) - min(memory[1:]) < 3.0
    total, statistics = sum(stream.sent.values()), link.statistics
    assert total == statistics.sent_messages == statistics.sent_frames + statistics.dropped_frames
    assert received == statistics.sent_frames and skipped % 256 == statistics.dropped_frames % 256
    assert stream.sent["HIL_SENSOR"] == round(200 * periods * seconds) and not vehicle.view.fields.refused
    numbers = [frame[4] for part in logged(log) for frame in part]
    assert len(numbers) == stream.recorded == len(vehicle.parameters) + total
    assert np.all(np.diff(numbers) % 256 == 1)
