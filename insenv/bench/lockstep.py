"""Lockstep with a stand-in for PX4: how many times faster than real time vehicle and stand-in run.

The stand-in runs in a separate process (this module as a program).  It answers each HIL_SENSOR at once with actuator outputs of
the same time.  The floor is the same exchange with a constant message instead of a vehicle: sockets and processes alone.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from insenv.bench.figure import Figure
from insenv.geodesy import NOMINAL_GRAVITY

SCENARIO = "car-city-drive"
STEPS, ROUNDS = 2000, 3


def px4() -> Figure:
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
        command = [sys.executable, "-m", "insenv.bench.lockstep", str(simulator.link.address.port)]
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
