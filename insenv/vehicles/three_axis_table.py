"""A three-axis turntable: it turns a unit to commanded roll, pitch and heading about a fixed point, and stays there.

Each angle follows its command smoothly, at a limited rate (`insenv.vehicles.tracker`). Angles are not limited: full turns and
a unit upside down are allowed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import log, log1p, pi
from typing import Any

import casadi as ca

from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.vehicles.nodes import PLACES
from insenv.vehicles.script import Script
from insenv.vehicles.tracker import Tracker, along_all, derivative_all
from insenv.vehicles.truth import SineCosine, Vehicle

ANGLES = ("roll", "pitch", "heading")
SCRIPT = Script((
    *(Row(name, f"Angle of the {name} axis, from that at time 0", "rad") for name in ANGLES),
    Row("rate", "Largest rate of each axis", "rad/s", start=10.0 * pi / 180.0, lower=1e-6, upper=20.0),
))  # fmt: skip
_TRACKERS = tuple(
    Tracker((f"table_{name}", f"table_{name}_rate", f"table_{name}_second"), f"Angle of the {name} axis", "rad")
    for name in ANGLES
)
PARAMETERS = Table((
    Row("mean_roll", "Roll at time 0", "rad"),
    Row("mean_pitch", "Pitch at time 0", "rad"),
    Row("start_heading", "Heading at time 0", "rad"),
    Row("table_bandwidth", "Bandwidth of each axis", "rad/s", start=3.0, lower=1e-2, upper=60.0),
))  # fmt: skip


SETTLED = 0.1 * pi / 180.0
"""Angle from its command (rad) at which an axis counts as standing there."""


def turning_time(turn: float, rate: float, sample_interval: float) -> float:
    """Time (s) that an axis at rest takes to come within `SETTLED` of a command that is `turn` (rad) away.

    rate: largest rate, rad/s; sample_interval: s.  With the bandwidth B the tracker gains the rate with the time constant
    1 / (2 B), keeps it until it is 2 rate / B from the command, and comes to rest there with two poles at B.
    """
    bandwidth = log1p(PARAMETERS["table_bandwidth"].start * sample_interval) / sample_interval  # that of its sampled poles
    turn, braking = abs(turn), 2.0 * rate / bandwidth
    if turn <= SETTLED:
        return 0.0
    if turn <= braking:
        return _rest(1.0, turn / SETTLED) / bandwidth
    return (turn - braking) / rate + (0.5 + _rest(2.0, rate / (bandwidth * SETTLED))) / bandwidth


def _rest(begin: float, ratio: float) -> float:
    """The u at which (begin + u) exp(-u) ratio is 1, by iteration; 0 if it is less from the start."""
    u = 0.0
    for _ in range(60):
        u = max(log((begin + u) * ratio), 0.0)
    return u


@lru_cache(maxsize=1)
def three_axis_table() -> Vehicle:
    """The turntable. Parameters: those of `PARAMETERS` and of the script (``segments``, ``segments_repeat``)."""
    state = sum((tracker.state for tracker in _TRACKERS), SCRIPT.state)

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        return [along_all(_TRACKERS, x, place * p.sample_interval) for place in PLACES]

    def angles(p: Values, x: Values) -> list[Any]:
        return [p.mean_roll + x.table_roll, p.mean_pitch + x.table_pitch, p.start_heading + x.table_heading]

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        return ca.SX.zeros(3)

    def hold(p: Values, x: Values, u: Values) -> dict[str, Any]:
        found = SCRIPT.count(p, x)
        for tracker, name in zip(_TRACKERS, ANGLES, strict=True):
            target = getattr(x, f"commanded_{name}")
            found |= tracker.hold(x, p.sample_interval, target, p.table_bandwidth, x.commanded_rate)
        return found

    return Vehicle(
        id="three-axis-table",
        title="Three-axis turntable",
        parameters=PARAMETERS + SCRIPT.parameters,
        state=state,
        along=along,
        derivative=lambda p, x: derivative_all(_TRACKERS, x),
        angles=angles,
        velocity_n=velocity_n,
        start=lambda p: SCRIPT.start(p, {}),
        hold=hold,
        inputs=SCRIPT.inputs,
        steps=SCRIPT.steps,
    )
