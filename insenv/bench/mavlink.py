"""MAVLink: cost of a message, and timing of the stream on the wall clock, that of a VectorNav unit too."""

from __future__ import annotations

import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from functools import lru_cache
from typing import Any

from insenv.bench.figure import Figure
from insenv.geodesy import NOMINAL_GRAVITY

SCENARIO = "car-city-drive"
SIMULATED_S = 30.0
STREAMED_S = 10.0
REPETITIONS = 5
DATAGRAMS = 2000


def message() -> Figure:
    """Cost to make, convert, pack and send a message of the default mix; the floor is sending the same number of bytes."""
    from insenv.mavlink import Vehicle
    from insenv.mavlink.messages import SILENT
    from insenv.mavlink.wire import open_link
    from insenv.scenario import load

    vehicle = Vehicle(load(SCENARIO), rates={}, speed=0.0)
    silent = Vehicle(load(SCENARIO), rates=SILENT, speed=0.0)
    steps = round(SIMULATED_S / REPETITIONS / vehicle.simulation.interval)
    costs, floors, total = [], [], 0
    with closing(_sink()) as sink, open_link(f"udpout:127.0.0.1:{sink.getsockname()[1]}") as link:
        for _ in range(REPETITIONS):
            begin = time.process_time()
            for _ in range(steps):
                silent.step()
            simulated = time.process_time() - begin
            sent, sizes = 0, 0
            begin = time.process_time()
            for _ in range(steps):
                for made in vehicle.step():
                    sizes += len(link.send(made))
                    sent += 1
            taken = time.process_time() - begin
            costs.append((taken - simulated) / sent * 1e6)
            floors.append(_sending(sink, sizes // sent))
            total += sent
    note = "processor time to make, convert, pack and send one message, without the simulation"
    return Figure(statistics.median(costs), statistics.median(floors), total, note)


def _sending(sink: socket.socket, size: int) -> float:
    """Microseconds to send a datagram of `size` bytes."""
    data = bytes(size)
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as out:
        begin = time.process_time()
        for _ in range(DATAGRAMS):
            out.sendto(data, sink.getsockname())
        return (time.process_time() - begin) / DATAGRAMS * 1e6


def _sink() -> socket.socket:
    sink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sink.bind(("127.0.0.1", 0))
    return sink


@lru_cache(maxsize=1)
def _streamed() -> tuple[float, float, float, float]:
    """Rate of HIL_SENSOR (Hz), lateness p50 and p99 (ms) and processor share (%) of the default stream in real time."""
    from insenv.mavlink import Stream, Vehicle
    from insenv.mavlink.wire import open_link
    from insenv.scenario import load

    vehicle = Vehicle(load(SCENARIO))
    with closing(_sink()) as sink, open_link(f"udpout:127.0.0.1:{sink.getsockname()[1]}") as link:
        stream = Stream(vehicle, link)
        stream.run(STREAMED_S)
        share, rate = stream.cpu_share, stream.sent["HIL_SENSOR"] / stream.wall_s
    late = stream.pacer.lateness
    return rate, late(0.5) * 1e3, late(0.99) * 1e3, share * 100.0


@lru_cache(maxsize=1)
def _empty() -> tuple[float, float, float, float]:
    """The same for a loop that only waits for its deadlines."""
    from insenv.mavlink.stream import Pacer

    pacer = Pacer(0.005, 1.0)
    begin, busy = time.monotonic(), time.process_time()
    for _ in range(round(STREAMED_S / 0.005)):
        pacer.wait(lambda: True)
    wall = time.monotonic() - begin
    rate, share = STREAMED_S / 0.005 / wall, (time.process_time() - busy) / wall
    return rate, pacer.lateness(0.5) * 1e3, pacer.lateness(0.99) * 1e3, share * 100.0


def _of_stream(place: int, note: str) -> Figure:
    return Figure(_streamed()[place], _empty()[place], round(STREAMED_S * 200), note)


def rate() -> Figure:
    """Achieved rate of HIL_SENSOR at 200 Hz, with the default telemetry; the floor is an empty loop with the same deadlines."""
    return _of_stream(0, "HIL_SENSOR, requested at 200 Hz, with the default telemetry")


def lateness() -> Figure:
    """99th percentile of the lateness of samples; the note gives the median."""
    return _of_stream(2, f"99 % of samples are no later than this; median {_streamed()[1]:.2g} ms")


def cpu() -> Figure:
    """Processor share of the default stream in real time."""
    return _of_stream(3, f"share of a core of the default stream of {SCENARIO} in real time")


def unit() -> Figure:
    """99th percentile of the lateness with which frames of a VN-300 arrive at the other end of a pseudo-terminal."""
    from insenv.mavlink import Vehicle
    from insenv.mavlink.messages import SILENT
    from insenv.mavlink.vectornav import MODELS, Unit, UnitStream
    from insenv.mavlink.wire import open_link
    from insenv.scenario import load

    scenario = load(SCENARIO)
    vehicle = Vehicle(scenario, rates=SILENT)
    master, slave = os.openpty()
    late, interval = [], vehicle.simulation.interval
    try:
        with open_link(f"serial:{os.ttyname(slave)}:921600") as port:
            stream = UnitStream(vehicle, Unit(MODELS["vn300"], scenario.rate_hz), port)
            begun = time.monotonic()
            stream.pacer.restart(1.0)
            for number in range(1, round(STREAMED_S / interval) + 1):
                stream.tick()
                os.read(master, 4096)  # each sample has a frame
                late.append(time.monotonic() - begun - number * interval)
    finally:
        os.close(master)
        os.close(slave)
    p50, p99 = (statistics.quantiles(late, n=100)[place] * 1e3 for place in (49, 98))
    return Figure(p99, _empty()[2], len(late), f"99 % of samples have arrived on a serial line by then; median {p50:.2g} ms")


# Lockstep with a stand-in for PX4: how many times faster than real time vehicle and stand-in run.
#
# The stand-in runs in a separate process (this module as a program).  It answers each HIL_SENSOR at once with actuator
# outputs of the same time.  The floor is the same exchange with a constant message instead of a vehicle: sockets and
# processes alone.

STEPS, ROUNDS = 2000, 3


def lockstep() -> Figure:
    """Speed of the simulated car in lockstep with the stand-in, in multiples of real time."""
    from insenv.mavlink import Vehicle
    from insenv.mavlink.lockstep import px4_rates
    from insenv.scenario import load

    scenario = load(SCENARIO)
    vehicle = Vehicle(scenario, rates=px4_rates(scenario.rate_hz), speed=0.0)
    interval = vehicle.simulation.interval
    values = [_speed(vehicle.step, interval) for _ in range(ROUNDS)]
    floors = [_speed(_constant(interval), interval) for _ in range(ROUNDS)]
    note = f"{SCENARIO} in lockstep with a stand-in for PX4 over TCP, multiple of real time; floor: no vehicle"
    return Figure(statistics.median(values), statistics.median(floors), ROUNDS * STEPS, note)


def _constant(interval: float) -> Callable[[], list[Any]]:
    from insenv.mavlink.wire import dialect

    message = dialect().MAVLink_hil_sensor_message(0, 0, 0, -NOMINAL_GRAVITY, 0, 0, 0, 0.2, 0, 0.4, 1013, 0, 0, 20, 0x1FFF)

    def step() -> list[Any]:
        message.time_usec += round(interval * 1e6)
        return [message]

    return step


def _speed(step: Callable[[], list[Any]], interval: float) -> float:
    from insenv.mavlink.lockstep import Px4Lockstep

    with Px4Lockstep(step, interval, address="tcpin:127.0.0.1:0") as simulator:
        command = [sys.executable, "-m", "insenv.bench.mavlink", str(simulator.link.address.port)]
        with subprocess.Popen(command) as stand_in:
            try:
                while not simulator.in_step:  # until the stand-in has started, connected and answered
                    simulator.run(1)
                begun = time.perf_counter()
                simulator.run(STEPS)
                wall = time.perf_counter() - begun
            finally:
                stand_in.terminate()
    return STEPS * interval / wall


def answer_all(port: int) -> None:
    """Act as the stand-in until the process is terminated."""
    from insenv.mavlink.wire import dialect, open_link

    module = dialect()
    with open_link(f"tcpout:127.0.0.1:{port}") as link:
        while True:
            link.wait(0.1)
            for _, message in link.receive():
                if message.get_type() == "HIL_SENSOR":
                    link.send(module.MAVLink_hil_actuator_controls_message(message.time_usec, [0.0] * 16, 0, 1))


if __name__ == "__main__":
    answer_all(int(sys.argv[1]))
