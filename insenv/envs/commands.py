"""Vehicle commands of an agent: from action components in [-1, 1] to the state rows of the commands in force."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv.core.elementary import clamp, maximum, select
from insenv.core.model import Model
from insenv.core.tables import Row, Table
from insenv.vehicles.turntable import COMMANDED

CAR_ACCELERATION = 3.0
"""m/s^2, along and across the path."""
CAR_SPEED = 25.0
"""Top speed of a car, m/s."""
CAR_SLOW = 2.0
"""Speed below which the yaw rate is that at this speed, m/s."""
AIRCRAFT_ACCELERATION = 2.5
"""m/s^2, along the path."""
AIRCRAFT_SPEED = (60.0, 120.0)
"""Lowest and highest speed, m/s."""
AIRCRAFT_BANK = 0.7
"""Largest bank, rad (40 deg)."""
AIRCRAFT_CLIMB = 10.0
"""Largest rate of climb, m/s."""


@dataclass(frozen=True)
class Commands:
    """The commands of one kind of vehicle.

    actions: rows of the action.  start_speeds: range from which an episode draws its start speed, m/s.
    taken: ``(plant, p, x, u) -> {state row: value}``, the commands in force after an action.
    """

    actions: Table
    start_speeds: tuple[float, float] | None
    taken: Callable[[Model, Any, Any, Any], Mapping[str, Any]]


def _action(name: str, meaning: str) -> Row:
    return Row(name, meaning, lower=-1.0, upper=1.0)


def _by_script(plant: Model, p: Any, x: Any, u: Any, commands: Mapping[str, Any]) -> Mapping[str, Any]:
    """Run the plant's own step ``command`` with these inputs; it ends the scenario's script."""
    return plant.steps["command"].function(p, x, SimpleNamespace(**{**vars(u), **commands}))


def _drive(plant: Model, p: Any, x: Any, u: Any) -> Mapping[str, Any]:
    """Accelerate to the top speed, brake to a stop, or (at 0) hold the speed."""
    along, across = clamp(u.accelerate, -1.0, 1.0), clamp(u.steer, -1.0, 1.0)
    commands = {
        "command_speed": ca.SX(CAR_SPEED),
        "command_acceleration": along * CAR_ACCELERATION,
        "command_yaw_rate": across * CAR_ACCELERATION / maximum(x.speed, CAR_SLOW),
        **{f"command_{name}": getattr(x, f"commanded_{name}") for name in ("slope", "load_roll", "load_pitch", "load_down")},
    }
    return _by_script(plant, p, x, u, commands)


def _fly(plant: Model, p: Any, x: Any, u: Any) -> Mapping[str, Any]:
    along = clamp(u.accelerate, -1.0, 1.0)
    commands = {
        "command_speed": select(along > 0.0, AIRCRAFT_SPEED[1], AIRCRAFT_SPEED[0]),
        "command_acceleration": ca.fabs(along) * AIRCRAFT_ACCELERATION,
        "command_bank": clamp(u.bank, -1.0, 1.0) * AIRCRAFT_BANK,
        "command_climb_rate": clamp(u.climb, -1.0, 1.0) * AIRCRAFT_CLIMB,
    }
    return _by_script(plant, p, x, u, commands)


def _index(plant: Model, p: Any, x: Any, u: Any) -> Mapping[str, Any]:
    return {COMMANDED: clamp(u.index, -1.0, 1.0) * pi}


COMMANDS = {
    "car": Commands(
        Table((
            _action("accelerate", f"Acceleration along the path, in {CAR_ACCELERATION:g} m/s^2; negative: brake to a stop"),
            _action("steer", f"Acceleration across the path, positive to the right, in {CAR_ACCELERATION:g} m/s^2"),
        )),
        (2.0, 12.0),
        _drive,
    ),
    "aircraft": Commands(
        Table((
            _action("accelerate", f"Acceleration along the path, in {AIRCRAFT_ACCELERATION:g} m/s^2"),
            _action("bank", f"Bank of a coordinated turn, positive to the right, in {AIRCRAFT_BANK:g} rad"),
            _action("climb", f"Rate of climb, in {AIRCRAFT_CLIMB:g} m/s"),
        )),
        (70.0, 110.0),
        _fly,
    ),
    "turntable": Commands(Table((_action("index", "Target angle of the turntable, clockwise, in 180 deg"),)), None, _index),
}  # fmt: skip
"""Commands by kind of vehicle; "turntable": a vehicle that stays in place."""
