"""Lockstep with an autopilot: one simulated sample for each of its answers."""

from insenv.mavlink.lockstep.ardupilot import ArduPilotLockstep, Motion, moving
from insenv.mavlink.lockstep.contract import Controls, Progress, steering
from insenv.mavlink.lockstep.px4 import Px4Lockstep, px4_messages, px4_rates

__all__ = [
    "ArduPilotLockstep",
    "Controls",
    "Motion",
    "Progress",
    "Px4Lockstep",
    "moving",
    "px4_messages",
    "px4_rates",
    "steering",
]
