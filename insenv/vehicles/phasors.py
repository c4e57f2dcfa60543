"""Sums of sinusoids as rotating phasors, which need no sine during the motion.

A sinusoid A sin(w t + phase) is stored as the pair (A sin, A cos). Advancing by a fixed time rotates the pair by a
fixed angle: four multiplications and two additions with constants that ``start`` computes. From the start of a sample
through its Gauss-Lobatto nodes to its end there are three rotations by two different angles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv.core.elementary import TWO_PI, sin_cos
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.vehicles.truth import EDGE, INNER


@dataclass(frozen=True)
class Phasors:
    """Sinusoids with common angular frequencies in one or more channels.

    name: prefix of the rows' names.
    channels: unit of the amplitude by name of the channel, ``{"roll": "rad", "down": "m"}``.
    components: number of angular frequencies.
    seeded: whether ``start`` adds a uniform random angle to the phases of each frequency, the same in all channels.

    Rows (n = components; a single channel with the name of the bank is named once): parameters
    ``<name>_angular_frequency`` (n,) rad/s, ``<name>_<channel>_amplitude`` (n,), ``<name>_<channel>_phase`` (n,) rad;
    state ``<name>_<channel>_sine``, ``<name>_<channel>_cosine`` (n,) and the constants of the two rotations.
    """

    name: str
    channels: Mapping[str, str]
    components: int
    seeded: bool = False

    def label(self, channel: str) -> str:
        """Prefix of the rows of a channel."""
        return self.name if channel == self.name else f"{self.name}_{channel}"

    @property
    def start_uniforms(self) -> int:
        """Number of uniforms that ``start`` uses."""
        return self.components if self.seeded else 0

    @property
    def parameters(self) -> Table:
        """Frequencies, amplitudes, phases."""
        shape, name = (self.components,), self.name
        rows = [Row(f"{name}_angular_frequency", f"Angular frequencies of the {name} motion", "rad/s", shape, lower=0)]
        for channel, unit in self.channels.items():
            label = self.label(channel)
            rows.append(Row(f"{label}_amplitude", f"Amplitudes A of A sin(w t + phase), {name}, {channel}", unit, shape))
            rows.append(Row(f"{label}_phase", f"Phases of A sin(w t + phase), {name}, {channel}", "rad", shape))
        return Table(tuple(rows))

    @property
    def state(self) -> Table:
        """Phasors and the constants of their rotations."""
        shape, name = (self.components,), self.name
        rows = []
        for place in ("edge", "inner"):
            for part in ("cosine", "sine"):
                meaning = f"{part.capitalize()} of the rotation of the {name} motion over the {place} part of the sample"
                rows.append(Row(f"{name}_{place}_{part}", meaning, "1", shape))
        for channel, unit in self.channels.items():
            label = self.label(channel)
            rows.append(Row(f"{label}_sine", f"A sin(w t + phase), {name}, {channel}", unit, shape))
            rows.append(Row(f"{label}_cosine", f"A cos(w t + phase), {name}, {channel}", unit, shape))
            rows.append(Row(f"{label}_half_weight", f"1 / (2 A^2), {name}, {channel}", f"1/{unit}^2", shape))
        return Table(tuple(rows))

    def start(self, p: Values, r: Any = None) -> dict[str, Any]:
        """State at time 0; r: uniforms (n,) if seeded."""
        frequency = getattr(p, f"{self.name}_angular_frequency")
        state: dict[str, Any] = {}
        for place, part in (("edge", EDGE), ("inner", INNER)):
            sine, cosine = sin_cos(frequency * (part * p.sample_interval))
            state[f"{self.name}_{place}_sine"], state[f"{self.name}_{place}_cosine"] = sine, cosine
        for channel in self.channels:
            label = self.label(channel)
            amplitude, phase = getattr(p, f"{label}_amplitude"), getattr(p, f"{label}_phase")
            sine, cosine = sin_cos(phase + TWO_PI * r if self.seeded else phase)
            state[f"{label}_sine"], state[f"{label}_cosine"] = amplitude * sine, amplitude * cosine
            none = amplitude == 0.0
            state[f"{label}_half_weight"] = (1.0 - none) * 0.5 / (amplitude * amplitude + none)
        return state

    def along(self, x: Values) -> list[dict[str, Any]]:
        """Phasors at `nodes.PLACES` of a sample that starts at x, with their radius restored at the end.

        One Newton step, z (3/2 - |z|^2 / 2 A^2), keeps rounding errors of the radius from accumulating.
        """

        def turn(place: str) -> tuple[Any, Any]:
            return getattr(x, f"{self.name}_{place}_cosine"), getattr(x, f"{self.name}_{place}_sine")

        turns = [turn(place) for place in ("edge", "inner", "edge")]
        places: list[dict[str, Any]] = [{} for _ in turns]
        for channel in self.channels:
            label = self.label(channel)
            sine, cosine = getattr(x, f"{label}_sine"), getattr(x, f"{label}_cosine")
            for (c, s), rows in zip(turns, places, strict=True):
                sine, cosine = sine * c + cosine * s, cosine * c - sine * s
                rows[f"{label}_sine"], rows[f"{label}_cosine"] = sine, cosine
            scale = 1.5 - getattr(x, f"{label}_half_weight") * (sine * sine + cosine * cosine)
            places[-1][f"{label}_sine"], places[-1][f"{label}_cosine"] = sine * scale, cosine * scale
        return places

    def derivative(self, p: Values, x: Values) -> dict[str, Any]:
        """Time derivatives of the phasors."""
        frequency = getattr(p, f"{self.name}_angular_frequency")
        rates: dict[str, Any] = {}
        for channel in self.channels:
            label = self.label(channel)
            rates[f"{label}_sine"] = frequency * getattr(x, f"{label}_cosine")
            rates[f"{label}_cosine"] = -frequency * getattr(x, f"{label}_sine")
        return rates

    def value(self, x: Values, channel: str) -> Any:
        """The channel's sum of A sin(w t + phase); 0 if there is no such channel."""
        return _sum(getattr(x, f"{self.label(channel)}_sine")) if channel in self.channels else 0.0

    def rate(self, p: Values, x: Values, channel: str) -> Any:
        """The channel's sum of A w cos(w t + phase); 0 if there is no such channel."""
        if channel not in self.channels:
            return 0.0
        return _sum(getattr(p, f"{self.name}_angular_frequency") * getattr(x, f"{self.label(channel)}_cosine"))


def _sum(column: Any) -> Any:
    """Sum of a column's elements."""
    return ca.sum1(column)


def total(banks: Sequence[Phasors], x: Values, channel: str) -> Any:
    """Sum of a channel over banks of phasors."""
    return sum((bank.value(x, channel) for bank in banks if channel in bank.channels), ca.SX(0))


def total_rate(banks: Sequence[Phasors], p: Values, x: Values, channel: str) -> Any:
    """Sum of a channel's rate over banks of phasors."""
    return sum((bank.rate(p, x, channel) for bank in banks if channel in bank.channels), ca.SX(0))
