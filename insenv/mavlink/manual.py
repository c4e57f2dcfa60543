"""MANUAL_CONTROL: from a joystick's axes to a vehicle's commands."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

AXIS_UNUSED = 32767
"""What an axis says that is not there."""
FULL = 1000.0
LOST_AFTER_S = 1.0
"""So long without MANUAL_CONTROL, simulated time, and the vehicle is let go: see `released`."""


@dataclass
class FullScale:
    """What full deflection commands: speed (m/s), turn rate (deg/s), bank (deg), climb rate (m/s)."""

    speed: float = 15.0
    turn_deg_s: float = 20.0
    bank_deg: float = 30.0
    climb: float = 5.0


DEFAULT_SCALES = {"ship": FullScale(10.0, 3.0), "car": FullScale(15.0, 20.0), "aircraft": FullScale(80.0, 3.0)}


def commanded(kind: str, scale: FullScale, x: int, y: int, z: int, r: int) -> dict[str, float]:
    """Commands (SI) of a vehicle of this kind from the axes: x forward (pitch), y right (roll), z thrust, r turn (yaw).

    Thrust, from nothing to full, is the speed.  Ships and cars turn by r, or where it is not there or at rest by y.  Aircraft
    bank by y and climb with the stick pulled (x negative).  An axis that is not there commands nothing.
    """
    axes = {name: None if value == AXIS_UNUSED else max(-1.0, min(1.0, value / FULL)) for name, value in _named(x, y, z, r)}
    values: dict[str, float] = {}
    if axes["z"] is not None:
        values["speed"] = max(axes["z"], 0.0) * scale.speed
    if kind == "aircraft":
        if axes["y"] is not None:
            values["bank"] = axes["y"] * radians(scale.bank_deg)
        if axes["x"] is not None:
            values["climb_rate"] = -axes["x"] * scale.climb
        return values
    turn = axes["r"] or axes["y"]
    if turn is None:
        turn = axes["r"]
    if turn is not None:
        values["turn_rate" if kind == "ship" else "yaw_rate"] = turn * radians(scale.turn_deg_s)
    return values


def released(kind: str) -> dict[str, float]:
    """Commands when the joystick is lost: ships and cars stop, an aircraft flies on level and straight at its speed."""
    if kind == "aircraft":
        return {"bank": 0.0, "climb_rate": 0.0}
    return {"speed": 0.0, "turn_rate" if kind == "ship" else "yaw_rate": 0.0}


def _named(x: int, y: int, z: int, r: int) -> tuple[tuple[str, int], ...]:
    return ("x", x), ("y", y), ("z", z), ("r", r)
