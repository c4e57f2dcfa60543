"""The simulated vehicle as a lockstep sees it (`insenv.mavlink.lockstep.contract.Motion`), and an autopilot's outputs as
commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from insenv import geodesy
from insenv.core.tables import Vector
from insenv.mavlink.lockstep.contract import Controls

if TYPE_CHECKING:
    from insenv.mavlink.vehicle import Vehicle

AXIS = 1000


class VehicleMotion:
    """A `Vehicle` step by step; the origin is its home.

    step: goes one sample on; None: the vehicle's own, and the messages that are due are thrown away (give it rates of 0).
    """

    def __init__(self, vehicle: Vehicle, step: Callable[[], object] | None = None) -> None:
        self._vehicle = vehicle
        self._simulation = vehicle.simulation
        self._step = vehicle.step if step is None else step

    def step(self) -> None:
        """One inertial sample on."""
        self._step()

    @property
    def time(self) -> float:
        """Simulation clock (s)."""
        return self._simulation.time

    @property
    def rate_ib_b(self) -> Vector:
        """Measured mean angular rate (3, rad/s)."""
        return self._simulation.last_increment[:3] / self._simulation.interval

    @property
    def specific_force_b(self) -> Vector:
        """Measured mean specific force (3, m/s^2)."""
        return self._simulation.last_increment[3:] / self._simulation.interval

    @property
    def position_n(self) -> Vector:
        """True position from home (3, m)."""
        truth = self._simulation.truth
        offset = geodesy.numeric.ned_offset(truth["latitude"], truth["longitude"], truth["height"], *self._vehicle.view.home)
        return np.asarray(offset, dtype=np.float64)

    @property
    def velocity_n(self) -> Vector:
        """True velocity (3, m/s)."""
        return np.asarray(self._simulation.truth["velocity_n"])

    @property
    def q_nb(self) -> Vector:
        """True attitude (4)."""
        return np.asarray(self._simulation.truth["q_nb"])


def steering(vehicle: Vehicle, channels: tuple[int, int, int, int]) -> Callable[[Controls], None]:
    """Outputs as a joystick's axes: channels (counted from 0) of pitch, roll, throttle and yaw.

    The vehicles here follow speeds, turn rates and climb rates, no rudders: an autopilot's outputs set these in proportion.
    """
    pitch, roll, throttle, yaw = channels

    def act(controls: Controls) -> None:
        if controls.armed and vehicle.simulation.commands:
            x, y, z, r = (round(AXIS * min(max(controls.values[c], -1.0), 1.0)) for c in (pitch, roll, throttle, yaw))
            vehicle.steer(x, y, z, r)

    return act
