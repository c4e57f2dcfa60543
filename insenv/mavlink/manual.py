"""MANUAL_CONTROL: from the axes of a joystick to a vehicle's commands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from insenv.mavlink.parameters import NOW, Parameter
from insenv.vehicles import StickCommand

AXIS_UNUSED = 32767
"""The value of an axis that the joystick does not have."""
FULL = 1000.0
LOST_AFTER_S = 1.0
"""Simulated time without MANUAL_CONTROL after which it counts as lost."""


class Sticks:
    """A joystick that sets the commands of a vehicle.

    commands: the vehicle's stick commands.  full_scale: what full deflection commands, by `StickCommand.name` and in
    its unit; may be changed at any time.
    """

    def __init__(self, commands: Iterable[StickCommand]) -> None:
        self.commands = tuple(commands)
        self.full_scale = {stick.name: stick.full_scale for stick in self.commands}

    def commanded(self, x: int, y: int, z: int, r: int) -> dict[str, float]:
        """Commands (SI) at these axes, -1000 to 1000 each; `AXIS_UNUSED` commands nothing.

        Of several axes that set one command the first that is deflected counts.
        """
        values: dict[str, float] = {}
        axes = {"x": x, "y": y, "z": z, "r": r}
        for stick in self.commands:
            present = [axes[axis] for axis in stick.axes if axes[axis] != AXIS_UNUSED]
            if present:
                axis = next((value for value in present if value), 0)
                deflection = max(-1.0, min(1.0, axis / FULL))
                values[stick.command] = stick.value(deflection, self.full_scale[stick.name])
        return values

    def released(self) -> dict[str, float]:
        """Commands (SI) when the joystick is lost."""
        return {stick.command: stick.released for stick in self.commands if stick.released is not None}

    def parameters(self) -> Iterator[Parameter]:
        """The full scales as parameters."""
        scale = self.full_scale
        for stick in self.commands:

            def read(name: str = stick.name) -> float:
                return scale[name]

            def write(value: float, name: str = stick.name) -> None:
                scale[name] = value

            meaning = f"{stick.title} at full deflection of MANUAL_CONTROL"
            yield Parameter(f"MAN_{stick.name}", meaning, stick.unit, NOW, 0.0, stick.highest, read, write)
