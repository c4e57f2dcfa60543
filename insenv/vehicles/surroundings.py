"""Surroundings of a moored ship that commands change: the size of its motion, and a wave that passes.

The motion of the scenario is multiplied by a size that follows the command ``sea`` slowly; the height of a passing wave, which
follows the command ``wave``, lifts the ship and heels it.  The rates of both are tracked (`insenv.vehicles.script`), so that
acceleration and attitude rate never jump.  At size 1 without a wave the motion is that of the scenario, to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from insenv.core.elementary import select
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.vehicles.script import Tracker, along_all, derivative_all
from insenv.vehicles.section import StickCommand

COMMANDS = (
    Row("sea", "Size of the ship's motion relative to that of the scenario", start=1.0, lower=0.0, upper=3.0),
    Row("wave", "Height of a passing wave at the ship", "m", lower=-3.0, upper=3.0),
)
STICKS = (
    StickCommand("sea", "SEA", "Size of the motion", ("z",), 2.0, 3.0, "", one_sided=True, released=None),
    StickCommand("wave", "WAVE", "Passing wave", ("y",), 1.0, 3.0, "m"),
)
_SEA = Tracker(("sea_rate", "sea_second", "sea_third"), "Rate of the size of the motion", "1/s")
_WAVE = Tracker(("passing_rate", "passing_second", "passing_third"), "Rate of the height of the passing wave", "m/s")
_OUTER = 4.0 / 27.0
"""Bandwidth of the loop around a tracked rate, relative to that of the tracker: the largest without overshoot."""
INPUTS = Table((
    *(replace(row, name=f"command_{row.name}", meaning=f"Command: {row.meaning}") for row in COMMANDS),
    Row("command_valid", "Whether the commands apply (1) or not (0)", lower=0, upper=1, flag=True),
))  # fmt: skip
PARAMETERS = Table((
    Row("sea_bandwidth", "Bandwidth with which the motion grows and fades", "rad/s", start=0.5, lower=1e-3, upper=10.0),
    Row("wave_bandwidth", "Bandwidth with which a passing wave rises and falls", "rad/s", start=4.0, lower=1e-3, upper=10.0),
    Row("wave_heel", "Heel by a passing wave, to starboard", "rad/m", start=0.03, lower=-0.2, upper=0.2),
))  # fmt: skip
_COMMANDED = Table(tuple(
    replace(row, name=f"commanded_{row.name}", meaning=f"Current command: {row.meaning}") for row in COMMANDS
))  # fmt: skip
STATE = Table((
    Row("sea", "Size of the motion relative to that of the scenario", start=1.0),
    Row("passing", "Height of the passing wave", "m"),
)) + _SEA.state + _WAVE.state + _COMMANDED  # fmt: skip


def hold(p: Values, x: Values, u: Values) -> dict[str, Any]:
    """Rows that are constant over the coming sample.

    The commands are taken here and not in a step of their own, so that the random streams are those without commands.
    """
    h = p.sample_interval
    sea = select(u.command_valid, u.command_sea, x.commanded_sea)
    wave = select(u.command_valid, u.command_wave, x.commanded_wave)
    return {
        "commanded_sea": sea,
        "commanded_wave": wave,
        **_SEA.hold(x, h, _OUTER * p.sea_bandwidth * (sea - x.sea), p.sea_bandwidth),
        **_WAVE.hold(x, h, _OUTER * p.wave_bandwidth * (wave - x.passing), p.wave_bandwidth),
    }


def along(x: Values, t: Any) -> dict[str, Any]:
    """Rows t seconds into the sample."""
    moved = {"sea": x.sea + _SEA.integral(x, t), "passing": x.passing + _WAVE.integral(x, t)}
    return {**moved, **along_all((_SEA, _WAVE), x, t)}


def derivative(x: Values) -> dict[str, Any]:
    """Time derivatives of the same rows."""
    return {"sea": x.sea_rate, "passing": x.passing_rate, **derivative_all((_SEA, _WAVE), x)}


def angles(p: Values, x: Values, sway: Sequence[Any]) -> list[Any]:
    """Roll, pitch and yaw (rad) about the mean, from those of the scenario."""
    roll, pitch, yaw = (x.sea * angle for angle in sway)
    return [roll + p.wave_heel * x.passing, pitch, yaw]


def velocity(x: Values, displacement: Any, rate: Any) -> Any:
    """Velocity of the centre of motion (3, m/s, n), from displacement (m) and velocity of the scenario."""
    down = [0.0, 0.0, x.passing_rate]
    moved = x.sea * rate + x.sea_rate * displacement
    for axis, lifted in enumerate(down):
        moved[axis] = moved[axis] - lifted
    return moved
