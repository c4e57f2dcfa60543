"""A stationary vehicle on a turntable that rotates about the vertical on command (indexing).

The table rotates the vehicle, with its roll, pitch, load and engine, about the vertical through the centre of motion.
It moves smoothly to the commanded angle at a limited rate and stays there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi
from typing import Any

from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.vehicles.nodes import PLACES
from insenv.vehicles.tracker import Tracker
from insenv.vehicles.truth import Vehicle

BANDWIDTH = 3.0
"""Bandwidth of the table, rad/s."""
RATE = 10.0 * pi / 180.0
"""Largest rate of the table, rad/s."""

_INDEX = Tracker(("index_angle", "index_rate", "index_acceleration"), "Angle of the turntable, clockwise from above", "rad")
COMMANDED = "commanded_index"
"""State row of the commanded angle (rad), set by other parts."""


def on_turntable(vehicle: Vehicle) -> Vehicle:
    """`vehicle`, which must be stationary, with the angle of the turntable added to its heading; same parameters."""
    base_hold = vehicle.hold

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        places = vehicle.along(p, x)
        return [{**rows, **_INDEX.along(x, place * p.sample_interval)} for rows, place in zip(places, PLACES, strict=True)]

    def derivative(p: Values, x: Values) -> dict[str, Any]:
        return {**vehicle.derivative(p, x), **_INDEX.derivative(x)}

    def angles(p: Values, x: Values) -> Sequence[Any]:
        roll, pitch, heading, *others = vehicle.angles(p, x)
        return [roll, pitch, heading + x.index_angle, *others]

    def hold(p: Values, x: Values, u: Values, *r: Any) -> dict[str, Any]:
        held = {} if base_hold is None else base_hold(p, x, u, *r)
        return {**held, **_INDEX.hold(x, p.sample_interval, getattr(x, COMMANDED), BANDWIDTH, RATE)}

    commanded = Table((Row(COMMANDED, "Commanded angle of the turntable", "rad"),))
    return replace(
        vehicle,
        id=f"{vehicle.id}-turntable",
        title=f"{vehicle.title} on a turntable",
        state=vehicle.state + _INDEX.state + commanded,
        along=along,
        derivative=derivative,
        angles=angles,
        hold=hold,
    )
