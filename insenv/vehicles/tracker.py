"""Trackers: the motion follows a command as a second-order, critically damped system.

A tracker is (s, s', s''). s'' is set at the start of a sample and constant over it. Within a sample s is therefore an
exact parabola, and over all samples s has a continuous derivative: velocity and attitude rate never jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from insenv.core.elementary import clamp
from insenv.core.model import Values
from insenv.core.tables import Row, Table


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
