"""The simulated vehicle's motion for the lockstep, and an autopilot's outputs as its commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from insenv import geodesy
from insenv.mavlink.lockstep.contract import Act, Controls, Motion, Move

if TYPE_CHECKING:
    from insenv.mavlink.vehicle import Vehicle

AXIS = 1000


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
    pitch, roll, throttle, yaw = channels

    def act(controls: Controls) -> None:
        if controls.armed and vehicle.simulation.commands:
            x, y, z, r = (round(AXIS * min(max(controls.values[c], -1.0), 1.0)) for c in (pitch, roll, throttle, yaw))
            vehicle.steer(x, y, z, r)

    return act
