"""What the two lockstep protocols share: the loop, its counts, the vehicle's motion and the autopilot's outputs.

The simulation advances by one sample, and the autopilot answers with its outputs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from insenv import geodesy
from insenv.core.tables import Vector
from insenv.mavlink.stream import Stop, never
from insenv.mavlink.vehicle import FULL, Vehicle

_Lockstep = TypeVar("_Lockstep", bound="Lockstep")


@dataclass(frozen=True)
class Controls:
    """An autopilot's outputs.

    time: the autopilot's clock (s).  values: by channel, -1 to 1 (throttle: 0 to 1).  armed: whether they are to be
    followed.
    """

    time: float
    values: tuple[float, ...]
    armed: bool


@dataclass(frozen=True)
class Motion:
    """The motion of a vehicle at the end of a sample.

    time: simulation clock (s).  rate_ib_b (3, rad/s), specific_force_b (3, m/s^2): measured means over the sample.
    position_n: true position relative to the origin (3, m).  velocity_n: true velocity (3, m/s).  q_nb: true attitude
    (4).
    """

    time: float
    rate_ib_b: Vector
    specific_force_b: Vector
    position_n: Vector
    velocity_n: Vector
    q_nb: Vector


@dataclass
class Progress:
    """Counts of a lockstep.

    steps: samples simulated.  answers: outputs received.  unanswered: steps not answered in time.  repeated: requests
    received again, and answered again without a step.  missed: lost requests, by their numbers.  refused: input that
    does not follow the protocol or is not from the autopilot.  connections: how often an autopilot connected or
    restarted.  samples_per_answer: covered by each answer, as learnt.
    """

    steps: int = 0
    answers: int = 0
    unanswered: int = 0
    repeated: int = 0
    missed: int = 0
    refused: int = 0
    connections: int = 0
    samples_per_answer: int = 1


Act = Callable[[Controls], None]
"""Receives an autopilot's outputs, before the next step."""
Move = Callable[[], Motion]
"""Advances by one sample and returns the motion at its end."""


def ignore(_: Controls) -> None:
    """Ignore the outputs: for vehicles whose motion is prescribed."""


class Lockstep(ABC):
    """The simulator's side of a lockstep.  progress: its counts."""

    def __init__(self) -> None:
        self.progress = Progress()

    def run(self, steps: int | None = None, stop: Stop = never) -> Progress:
        """Simulate `steps` samples (None: without end), or until `stop`, which is called after each step and while waiting."""
        end = None if steps is None else self.progress.steps + steps
        while not stop() and (end is None or self.progress.steps < end):
            self._turn(stop)
        return self.progress

    @abstractmethod
    def _turn(self, stop: Stop) -> None:
        """Simulate at most one sample, or wait a short time for the autopilot."""

    @abstractmethod
    def close(self) -> None:
        """Close the connection."""

    def __enter__(self: _Lockstep) -> _Lockstep:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def moving(vehicle: Vehicle) -> Move:
    """The steps of a vehicle as its motion relative to home; its messages are discarded."""
    simulation = vehicle.simulation

    def step() -> Motion:
        vehicle.step()
        truth, increment = simulation.truth, simulation.last_increment
        place = truth["latitude"], truth["longitude"], truth["height"]
        return Motion(
            time=simulation.time,
            rate_ib_b=increment[:3] / simulation.interval,
            specific_force_b=increment[3:] / simulation.interval,
            position_n=np.array(geodesy.numeric.ned_offset(*place, *vehicle.view.home)),
            velocity_n=np.array(truth["velocity_n"]),
            q_nb=np.array(truth["q_nb"]),
        )

    return step


def steering(vehicle: Vehicle, channels: tuple[int, int, int, int]) -> Act:
    """A function that steers the vehicle with an autopilot's outputs as if they were a joystick's axes.

    channels: those of pitch, roll, throttle and yaw, from 0.  The vehicles have no rudders but follow commands of
    speed, turn rate, bank and climb rate, which the outputs set in proportion.
    """

    def act(controls: Controls) -> None:
        if controls.armed and vehicle.simulation.commands:
            vehicle.steer(*(round(FULL * min(max(controls.values[channel], -1.0), 1.0)) for channel in channels))

    return act
