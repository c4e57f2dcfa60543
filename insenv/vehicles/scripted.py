"""What a car, an aircraft and a multirotor have in common: they follow commands, in gusts, with the vibration of an engine.

Trackers follow the commands of a script; what each kind adds is how its heading moves and how angles and velocity follow from
all of these.  The state has the rows of the heading, the engine, the gusts, the script and the trackers, in this order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.core.elementary import normal_pair
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.vehicles.phasors import Phasors
from insenv.vehicles.script import Script, Tracker, along_all, derivative_all
from insenv.vehicles.truth import PLACES, SineCosine, Vehicle

# Gusts.
#
# Each sample draws a new value of a Gauss-Markov process, and a tracker follows it, so that the motion is continuously
# differentiable. The factor of the process over a sample is (1 - a)/(1 + a), a = h / (2 T), instead of exp(-h / T), with
# the noise scaled accordingly: the variance is exact at every rate, the correlation time is correct to second order.


@dataclass(frozen=True)
class Gusts:
    """Disturbances with one correlation time.

    name: prefix of the parameter ``<name>_time_constant``.
    channels: names and units, ``(("gust_roll", "rad"), ...)``; each channel has the parameter ``<channel>_sigma``
        (standard deviation of the Gauss-Markov process) and the state rows ``<channel>_target``, ``<channel>``,
        ``<channel>_rate``, ``<channel>_second``.
    """

    name: str
    channels: tuple[tuple[str, str], ...]

    @property
    def trackers(self) -> tuple[Tracker, ...]:
        """The trackers that follow the processes."""
        return tuple(
            Tracker((name, f"{name}_rate", f"{name}_second"), f"Disturbance {name}", unit) for name, unit in self.channels
        )

    @property
    def parameters(self) -> Table:
        """Standard deviations and the correlation time."""
        rows = [
            Row(f"{self.name}_time_constant", f"Correlation time of the {self.name}", "s", start=3.0, lower=1e-2, upper=1e6)
        ]
        rows += [
            Row(f"{name}_sigma", f"Standard deviation of the Gauss-Markov process behind {name}", unit, lower=0.0)
            for name, unit in self.channels
        ]
        return Table(tuple(rows))

    @property
    def state(self) -> Table:
        """The processes and their trackers."""
        rows = tuple(Row(f"{name}_target", f"Gauss-Markov process behind {name}", unit) for name, unit in self.channels)
        return sum((tracker.state for tracker in self.trackers), Table(rows))

    @property
    def uniforms(self) -> int:
        """Number of uniforms that a sample uses; the start uses as many."""
        return 2 * -(-len(self.channels) // 2)

    def _normals(self, r: Any) -> list[Any]:
        return [n for i in range(0, self.uniforms, 2) for n in normal_pair(r[i], r[i + 1])][: len(self.channels)]

    def start(self, p: Values, r: Any) -> dict[str, Any]:
        """Processes drawn from their stationary distribution, with trackers that start on them."""
        rows: dict[str, Any] = {}
        for (name, _), normal in zip(self.channels, self._normals(r), strict=True):
            value = getattr(p, f"{name}_sigma") * normal
            rows |= {f"{name}_target": value, name: value}
        return rows

    def hold(self, p: Values, x: Values, bandwidth: Any, r: Any) -> dict[str, Any]:
        """The next values of the processes and the second derivatives of the trackers over the coming sample."""
        a = p.sample_interval / (2.0 * getattr(p, f"{self.name}_time_constant"))
        factor, scale = (1.0 - a) / (1.0 + a), 2.0 * ca.sqrt(a) / (1.0 + a)
        rows: dict[str, Any] = {}
        for (name, _), tracker, normal in zip(self.channels, self.trackers, self._normals(r), strict=True):
            noise = getattr(p, f"{name}_sigma") * scale * normal
            target = factor * getattr(x, f"{name}_target") + noise
            rows |= {f"{name}_target": target, **tracker.hold(x, p.sample_interval, target, bandwidth)}
        return rows


AIR_GUSTS = Gusts("gust", (
    ("gust_roll", "rad"), ("gust_pitch", "rad"), ("gust_yaw", "rad"),
    ("gust_north", "m/s"), ("gust_east", "m/s"), ("gust_down", "m/s"),
))  # fmt: skip
"""Those of a vehicle in the air."""


def engine_phasors(components: int) -> Phasors:
    """The vibration of an engine in roll, pitch (rad) and down (m); components: number of its angular frequencies."""
    return Phasors("engine", {"roll": "rad", "pitch": "rad", "down": "m"}, components)


Hold = Callable[[Values, Values, Values, Any], dict[str, Any]]


def scripted(
    id: str,
    title: str,
    *,
    parameters: Table,
    script: Script,
    trackers: Sequence[Tracker],
    gusts: Gusts,
    engine: Phasors,
    heading: Table,
    start: Callable[[Values], dict[str, Any]],
    turned: Callable[[Values, Any], dict[str, Any]],
    turning: Callable[[Values], dict[str, Any]],
    angles: Callable[[Values, Values], list[Any]],
    velocity_n: Callable[[Values, Values, Sequence[SineCosine]], Any],
    hold: Hold,
) -> Vehicle:
    """A vehicle that follows a script.

    parameters: beside those of script, gusts and engine.  heading: its rows of the state.  start: ``p -> rows``, of the heading
    and of trackers; those that a command has too are that command without a script.  turned: ``(x, t) -> rows`` of the heading
    t seconds later; turning: ``x -> rows``, their time derivatives.  The others are those of `Vehicle`.
    """
    moving = (*trackers, *gusts.trackers)

    def begun(p: Values, r: Any) -> dict[str, Any]:
        rows = start(p)
        commanded = {row.name: rows[row.name] for row in script.commands if row.name in rows}
        return rows | engine.start(p) | gusts.start(p, r) | script.start(p, commanded)

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        places = engine.along(x)
        for rows, place in zip(places, PLACES, strict=True):
            t = place * p.sample_interval
            rows |= along_all(moving, x, t) | turned(x, t)
        return places

    return Vehicle(
        id=id,
        title=title,
        parameters=parameters + engine.parameters + gusts.parameters + script.parameters,
        state=sum((tracker.state for tracker in trackers), heading + engine.state + gusts.state + script.state),
        along=along,
        derivative=lambda p, x: {**engine.derivative(p, x), **derivative_all(moving, x), **turning(x)},
        angles=angles,
        velocity_n=velocity_n,
        start=begun,
        start_uniforms=gusts.uniforms,
        hold=hold,
        hold_uniforms=gusts.uniforms,
        inputs=script.inputs,
        steps=script.steps,
    )
