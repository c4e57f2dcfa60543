"""The stream on links: completeness, pauses, speeds, signed commands; its log; when samples are due."""

import os
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common
from streamed_vehicle import Clock, frame_of, logged, lost, ping, quiet, wait_for

from insenv.logs.formats.tlog import TlogWriter
from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.stream import BURST_MESSAGES, GIVE_UP_S, Pacer
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
    assert pings == [(255, 190), (1, 1)] and stream.log.count == len(stream.vehicle.parameters) + len(frames) - 1


@pytest.mark.slow
def test_a_stream_at_full_speed_has_flat_memory_and_tells_its_load(opened, tmp_path, monkeypatch):
    monkeypatch.setattr("insenv.mavlink.stream.WATCH_S", 0.01)
    vehicle, memory, watched = Vehicle(load("car-city-drive"), speed=0.0), [], []
    with TlogWriter(tmp_path / "long.tlog") as recorder:
        stream = Stream(vehicle, opened("udpout:127.0.0.1:9"), recorder)
        for _ in range(6):
            stream.run(60.0, watched.append)
            memory.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6)
    assert max(memory[1:]) - min(memory[1:]) < 3.0  # MB
    assert watched and 0.0 < vehicle.view.load <= 1.0 and not vehicle.view.fields.refused
    numbers = [frame[4] for part in logged(tmp_path / "long.tlog") for frame in part]
    assert len(numbers) == stream.log.count == len(vehicle.parameters) + sum(stream.sent.values())
    assert np.all(np.diff(numbers) % 256 == 1)


def test_deadlines_are_absolute_and_bursts_have_pauses():
    clock = Clock(0.0)
    pacer = Pacer(0.005, 2.0, clock, clock.sleep)
    for _ in range(1000):
        pacer.wait(lambda: True)
        clock.now += 0.001  # the time that a sample takes
    assert clock.now == pytest.approx(2.5 + 0.001, abs=1e-9) and pacer.lateness(1.0) < 1e-9
    clock.now += 1.0  # a stall of 400 samples: caught up, in bursts
    clock.slept.clear()
    for _ in range(400):
        pacer.wait(lambda: True)
        pacer.sent(2)
    assert len(clock.slept) >= 400 * 2 // BURST_MESSAGES - 1 and pacer.slips == 0
    assert pacer.lateness(0.99) > 0.5
    clock.now += GIVE_UP_S + 2.0
    pacer.wait(lambda: True)
    assert pacer.slips == 1 and pacer.slipped == pytest.approx(GIVE_UP_S + 2.0, abs=0.2)
    served = []
    slow = Pacer(1.0, 1.0, clock, clock.sleep)
    assert slow.wait(lambda: served.append(clock.now) is None)
    assert len(served) > 40  # answers continue during a long wait


def test_a_new_speed_counts_at_once_and_keeps_the_part_of_the_sample_that_has_passed():
    clock = Clock(0.0)
    pacer = Pacer(1.0, 0.01, clock, clock.sleep)  # 100 s a sample
    assert not pacer.wait(lambda: clock.now < 25.0)  # interrupted after a quarter
    pacer.change(1.0)
    assert pacer.wait(lambda: True) and clock.now == pytest.approx(25.75, abs=0.05)
    # changes that follow one another without end do not delay a sample
    begun, speeds = clock.now, [1.0, 0.5]
    while not pacer.wait(lambda: False):
        speeds.reverse()
        pacer.change(speeds[0])
    assert 1.0 <= clock.now - begun < 2.0
