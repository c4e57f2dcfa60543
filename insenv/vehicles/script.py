"""Scripts: the commands of a vehicle, from a table of segments or from inputs.

A segment is a duration and a value for each command. The segments are stored in a parameter of fixed size. Loading the
next one is a separate step that runs only when a segment has ended, so that searching 64 rows costs nothing in between.
An external command (input ``command_valid`` not zero) replaces the commands and ends the script.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core.elementary import clamp, select
from insenv.core.model import Step, Values
from insenv.core.tables import Array, Row, Table

N_SEGMENTS = 64
"""Number of rows of the table of segments."""
NEVER = 1e15
"""Duration of the last command, s."""


@dataclass(frozen=True)
class Script:
    """The commands of a vehicle.

    commands: rows named after the commanded quantity (``"speed"``), with unit, meaning, start value and bounds. Each
    defines a state row ``commanded_<name>``, an input row ``command_<name>`` and a column of the parameter ``segments``
    after the duration.
    """

    commands: tuple[Row, ...]

    def __getitem__(self, name: str) -> Row:
        """The command of that name."""
        return next(row for row in self.commands if row.name == name)

    @property
    def parameters(self) -> Table:
        """The table of segments, and whether to repeat it."""
        columns = ", ".join(f"{row.name} {row.unit}" for row in self.commands)
        meaning = f"Script, one segment a row: duration s, {columns}; a duration of 0 ends it"
        shape = (N_SEGMENTS, 1 + len(self.commands))
        return Table((
            Row("segments", meaning, "1", shape),
            Row("segments_repeat", "Whether the script restarts at its end (1) or keeps the last (0)",
                lower=0, upper=1, flag=True),
        ))  # fmt: skip

    @property
    def state(self) -> Table:
        """The current commands and the position in the script."""
        commands = tuple(
            replace(row, name=f"commanded_{row.name}", meaning=f"Current command: {row.meaning}") for row in self.commands
        )
        return Table((
            *commands,
            Row("segment_number", "Number of the segment to load next"),
            Row("segment_left", "Time left of the segment", "s"),
            Row("segment_due", "Whether the next segment is to be loaded (1) or not (0)"),
        ))  # fmt: skip

    @property
    def inputs(self) -> Table:
        """External commands."""
        rows = [replace(row, name=f"command_{row.name}", meaning=f"Command: {row.meaning}") for row in self.commands]
        return Table((*rows, Row("command_valid", "Whether the commands apply (1) or not (0)", lower=0, upper=1, flag=True)))

    def start(self, p: Values, otherwise: Mapping[str, Any]) -> dict[str, Any]:
        """The first segment, or if there is none the commands `otherwise` (by name; default: their start values)."""
        duration = p.segments[0, 0]
        scripted = duration > 0.0
        state = {
            f"commanded_{row.name}": select(scripted, p.segments[0, 1 + i], otherwise.get(row.name, row.start))
            for i, row in enumerate(self.commands)
        }
        return state | {
            "segment_number": 1.0,
            "segment_left": select(scripted, duration, NEVER),
            "segment_due": ca.SX(0),
        }

    def count(self, p: Values, x: Values) -> dict[str, Any]:
        """Subtract one sample from the time left of the current segment."""
        left = x.segment_left - p.sample_interval
        return {"segment_left": left, "segment_due": left < 0.5 * p.sample_interval}

    @property
    def steps(self) -> Mapping[str, Step]:
        """The conditional steps, to be placed before the vehicle's step ``sample``."""
        return {"segment": Step(self._load, when="segment_due"), "command": Step(self._take, when="command_valid")}

    def _load(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        columns = 1 + len(self.commands)
        row = [ca.SX(0)] * columns
        for number in range(N_SEGMENTS):
            here = x.segment_number == float(number)
            row = [value + select(here, p.segments[number, i], 0.0) for i, value in enumerate(row)]
        over = row[0] <= 0.0
        again = ca.logic_and(over, p.segments_repeat > 0.0)
        row = [select(again, p.segments[0, i], value) for i, value in enumerate(row)]
        held = ca.logic_and(over, ca.logic_not(again))
        state = {
            f"commanded_{name.name}": select(held, getattr(x, f"commanded_{name.name}"), row[1 + i])
            for i, name in enumerate(self.commands)
        }
        return state | {
            "segment_number": select(again, 1.0, x.segment_number + 1.0),
            "segment_left": select(held, NEVER, x.segment_left + row[0]),
            "segment_due": ca.SX(0),
        }

    def _take(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        commands = {f"commanded_{row.name}": getattr(u, f"command_{row.name}") for row in self.commands}
        return commands | {"segment_left": ca.SX(NEVER), "segment_due": ca.SX(0)}

    def turn_rate(self, where: str, name: str, turn_deg: float, duration_s: float) -> float:
        """The command `name`, a rate (rad/s), that turns by an angle; `where`: the leg, for messages.

        Raises `InputError` for a rate out of the bounds of the command.
        """
        rate = math.radians(turn_deg) / duration_s
        if abs(rate) > self[name].upper:
            raise InputError(
                f"{where}: turn_deg = {turn_deg:g} in {duration_s:.3g} s is {math.degrees(rate):.4g} deg/s: allowed is up to "
                f"{self.fastest_deg(name):g} deg/s"
            )
        return rate

    def fastest_deg(self, name: str) -> float:
        """The largest value of the command `name`, a rate, in whole deg/s."""
        return math.floor(math.degrees(self[name].upper))

    def table(self, segments: Sequence[Mapping[str, float]]) -> Array:
        """Value of the parameter ``segments`` (N_SEGMENTS, 1 + commands) from segments by name, SI units,
        each with ``duration``.

        A command that a segment does not name keeps its value. Raises `InputError` for an unknown name, a
        value that is not finite or out of its bounds, a duration that is not positive, or more than
        N_SEGMENTS segments.
        """
        if len(segments) > N_SEGMENTS:
            raise InputError(f"{len(segments)} segments: allowed are at most {N_SEGMENTS}")
        rows = {"duration": Row("duration", "duration of a segment", "s", start=1.0, lower=1e-3, upper=1e9)}
        rows |= {row.name: row for row in self.commands}
        now = {row.name: float(row.start) for row in self.commands}
        table = np.zeros((N_SEGMENTS, 1 + len(self.commands)))
        for i, segment in enumerate(segments):
            if "duration" not in segment:
                raise InputError(f"segment {i + 1}: duration is missing (allowed is a positive number of s)")
            for name, value in segment.items():
                if name not in rows:
                    raise InputError(f"segment {i + 1}: no command named {name!r}{nearest(name, rows)}")
                try:
                    rows[name].check(np.array([float(value)]))
                except (TypeError, ValueError) as error:
                    raise InputError(f"segment {i + 1}: {error}") from None
            now |= {name: float(value) for name, value in segment.items() if name != "duration"}
            table[i] = [float(segment["duration"]), *now.values()]
        return table


# Trackers: the motion follows a command as a second-order, critically damped system.
#
# A tracker is (s, s', s''). s'' is set at the start of a sample and constant over it. Within a sample s is therefore an
# exact parabola, and over all samples s has a continuous derivative: velocity and attitude rate never jump.


@dataclass(frozen=True)
class Tracker:
    """One tracked quantity.

    names: rows of the quantity and its first and second time derivative, ``("speed", "acceleration", "jerk")``.
    meaning, unit: meaning and unit of the quantity.
    """

    names: tuple[str, str, str]
    meaning: str
    unit: str

    @property
    def state(self) -> Table:
        """The three state rows."""
        per = f"{self.unit}/s" if self.unit != "m/s" else "m/s^2"
        per2 = f"{self.unit}/s^2" if self.unit != "m/s" else "m/s^3"
        value, rate, second = self.names
        return Table((
            Row(value, self.meaning, self.unit),
            Row(rate, f"First time derivative of the {self.meaning[0].lower()}{self.meaning[1:]}", per),
            Row(second, f"Second time derivative, held over a sample, of the {self.meaning[0].lower()}{self.meaning[1:]}",
                per2),
        ))  # fmt: skip

    def hold(self, x: Values, h: Any, target: Any, bandwidth: Any, rate_limit: Any = None) -> dict[str, Any]:
        """The second derivative over the coming sample of h seconds, towards `target`.

        bandwidth: rad/s; rate_limit: the command never drives |s'| beyond it.

        Both poles of the controlled double integrator lie at z = 1 / (1 + bandwidth h): real, so that a target is never
        overshot, and inside the unit circle for every h. The error is first converted to a desired rate, and the limit
        applies to that rate, so that limiting causes no overshoot either: a speed with non-negative targets never
        becomes negative.
        """
        value, rate, second = self.names
        scale = 1.0 / (1.0 + bandwidth * h)
        stiffness = bandwidth * bandwidth * scale * scale
        damping = bandwidth * (2.0 + 1.5 * bandwidth * h) * scale * scale
        wanted = (target - getattr(x, value)) * (bandwidth / (2.0 + 1.5 * bandwidth * h))  # stiffness / damping
        if rate_limit is None:
            return {second: stiffness * (target - getattr(x, value)) - damping * getattr(x, rate)}
        return {second: damping * (clamp(wanted, -rate_limit, rate_limit) - getattr(x, rate))}

    def along(self, x: Values, t: Any) -> dict[str, Any]:
        """Quantity and first derivative t seconds into the sample."""
        value, rate, second = (getattr(x, name) for name in self.names)
        return {self.names[0]: value + t * (rate + 0.5 * t * second), self.names[1]: rate + t * second}

    def integral(self, x: Values, t: Any) -> Any:
        """Integral of the quantity over the first t seconds of the sample."""
        value, rate, second = (getattr(x, name) for name in self.names)
        return t * (value + t * (0.5 * rate + t * second / 6.0))

    def derivative(self, x: Values) -> dict[str, Any]:
        """Time derivatives of the quantity and its rate."""
        return {self.names[0]: getattr(x, self.names[1]), self.names[1]: getattr(x, self.names[2])}


def along_all(trackers: Sequence[Tracker], x: Values, t: Any) -> dict[str, Any]:
    """`Tracker.along` of several trackers."""
    return {name: value for tracker in trackers for name, value in tracker.along(x, t).items()}


def derivative_all(trackers: Sequence[Tracker], x: Values) -> dict[str, Any]:
    """`Tracker.derivative` of several trackers."""
    return {name: value for tracker in trackers for name, value in tracker.derivative(x).items()}
