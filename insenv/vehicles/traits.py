"""What interfaces to other tools need to know of a kind of vehicle, apart from its equations of motion."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians


@dataclass(frozen=True)
class StickCommand:
    """How the axes of a joystick set one command of a vehicle.

    command: the command's row without ``command_``, such as ``"yaw_rate"``. name, title: a short name, the same for all
    kinds of vehicle, and what it stands for. axes: the axes that set it, the preferred one first: ``"x"`` pitch (stick
    forward), ``"y"`` roll (stick right), ``"z"`` thrust, ``"r"`` yaw (to the right). full_scale, highest: the command
    at full deflection by default, and the largest full scale allowed, in `unit` ("m/s", "deg" or "deg/s"). sign: -1
    where a positive deflection lowers the command. one_sided: whether a negative deflection commands zero. released:
    the command (SI) when the joystick is lost; None: the one in force stays.
    """

    command: str
    name: str
    title: str
    axes: tuple[str, ...]
    full_scale: float
    highest: float
    unit: str
    sign: float = 1.0
    one_sided: bool = False
    released: float | None = 0.0

    def value(self, deflection: float, full_scale: float) -> float:
        """The command (SI) at a deflection from -1 to 1 for a full scale in `unit`."""
        deflection = self.sign * deflection
        if self.one_sided:
            deflection = max(deflection, 0.0)
        return deflection * (radians(full_scale) if self.unit.startswith("deg") else full_scale)


@dataclass(frozen=True)
class VehicleTraits:
    """A kind of vehicle as other tools see it.

    mavlink_type: MAV_TYPE of MAVLink, 0 for a generic vehicle.
    airspeed: whether it flies and so has a sensor of differential pressure.
    sticks: the commands that a joystick sets, in the order of the vehicle's command rows.
    """

    mavlink_type: int = 0
    airspeed: bool = False
    sticks: tuple[StickCommand, ...] = ()
