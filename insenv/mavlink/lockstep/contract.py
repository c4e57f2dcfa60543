"""Lockstep with an autopilot: the simulation goes one sample on, the autopilot answers with what its outputs are to be.

The two protocols share what they ask of a simulation, here, and what they count.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from insenv.core.tables import Vector


@dataclass(frozen=True)
class Controls:
    """An autopilot's outputs.

    time: its clock (s).  values: by channel, from -1 to 1 (a throttle from 0).  armed: whether it wants them followed.
    """

    time: float
    values: tuple[float, ...]
    armed: bool


@dataclass
class Progress:
    """How a lockstep goes.

    steps: samples simulated.  answers: outputs that came.  unanswered: steps that were not answered in time.  repeated:
    requests that came again and were answered again without a step.  missed: requests that were lost, by their numbers.
    refused: input that is none of the protocol's, or comes from another than the autopilot.  connections: how often an
    autopilot came, or began anew.
    """

    steps: int = 0
    answers: int = 0
    unanswered: int = 0
    repeated: int = 0
    missed: int = 0
    refused: int = 0
    connections: int = 0


class Motion(Protocol):
    """A simulated vehicle, step by step: what a Model's plant gives, in the units and frames of `insenv`."""

    def step(self) -> None:
        """One inertial sample on."""

    @property
    def time(self) -> float:
        """Simulation clock (s)."""

    @property
    def rate_ib_b(self) -> Vector:
        """Mean angular rate over the sample as the gyros measured it (3, rad/s)."""

    @property
    def specific_force_b(self) -> Vector:
        """Mean specific force over the sample as the accelerometers measured it (3, m/s^2)."""

    @property
    def position_n(self) -> Vector:
        """Position from the origin (3, m)."""

    @property
    def velocity_n(self) -> Vector:
        """Velocity (3, m/s)."""

    @property
    def q_nb(self) -> Vector:
        """Attitude (4)."""


Act = Callable[[Controls], None]
"""Takes an autopilot's outputs, before the step that follows them."""
Stop = Callable[[], bool]
"""Whether to end, asked after each step and while waiting."""
Messages = Callable[[], Sequence[Any]]
"""Goes one sample on and gives the messages to send, a HIL_SENSOR among them."""


def ignore(_: Controls) -> None:
    """For vehicles whose motion is prescribed."""


def never() -> bool:
    """Go on."""
    return False
