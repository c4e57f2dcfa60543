"""A vehicle in place on a turntable: indexing turns about the vertical, on command.

The table carries the vehicle, whose roll, pitch, load and engine turn with it, about the vertical through the centre of
motion.  It goes to the angle commanded at a limited rate, smoothly, and stays there.
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
"""rad/s, of the table's following its command."""
RATE = 10.0 * pi / 180.0
"""rad/s that the table turns at, at most."""

_INDEX = Tracker(("index_angle", "index_rate", "index_acceleration"), "Angle of the turntable, clockwise from above", "rad")
COMMANDED = "commanded_index"
"""State row of the angle to go to (rad), for others to set."""


def on_turntable(vehicle: Vehicle) -> Vehicle:
    """`vehicle`, which must stay in place, with the turntable's angle added to its heading.  Its parameters are the
    same."""
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

    commanded = Table((Row(COMMANDED, "Angle that the turntable goes to", "rad"),))
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
