"""What the two lockstep protocols share: the loop, its counts and the autopilot's outputs.

The simulation advances by one sample, and the autopilot answers with its outputs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

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


def steering(vehicle: Vehicle, channels: tuple[int, int, int, int]) -> Act:
    """A function that steers the vehicle with an autopilot's outputs as if they were a joystick's axes.

    channels: those of pitch, roll, throttle and yaw, from 0.  The vehicles have no rudders but follow commands of
    speed, turn rate, bank and climb rate, which the outputs set in proportion.
    """

    def act(controls: Controls) -> None:
        if controls.armed and vehicle.simulation.commands:
            vehicle.steer(*(round(FULL * min(max(controls.values[channel], -1.0), 1.0)) for channel in channels))

    return act
