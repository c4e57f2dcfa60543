"""A stationary vehicle on a turntable that rotates about the vertical on command (indexing).

The table rotates the vehicle, with its roll, pitch, load and engine, about the vertical through the centre of motion.
It moves smoothly to the commanded angle at a limited rate and stays there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import ceil, degrees, log, log1p, pi, radians
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from insenv.base.errors import InputError
from insenv.base.keys import rows_of
from insenv.base.toml import Number, Section, key
from insenv.core.elementary import clamp
from insenv.core.model import Values
from insenv.core.tables import Array, Row, Table
from insenv.vehicles.script import Script, Tracker, along_all, derivative_all
from insenv.vehicles.section import MAX_LEGS, Actions, StartSection, VehicleSection, VehicleTraits, action, in_legs, lasting
from insenv.vehicles.truth import PLACES, SineCosine, Vehicle

BANDWIDTH = 3.0
"""Bandwidth of the table, rad/s."""
RATE = 10.0 * pi / 180.0
"""Largest rate of the table, rad/s."""

_INDEX = Tracker(("index_angle", "index_rate", "index_acceleration"), "Angle of the turntable, clockwise from above", "rad")
COMMANDED = "commanded_index"
"""State row of the commanded angle (rad), set by other parts."""
INDEXING = Actions(
    Table((action("index", "Target angle of the turntable, clockwise, in 180 deg"),)),
    lambda x, action: {"index": clamp(action.index, -1.0, 1.0) * pi},
)
"""How an agent turns a vehicle `on_turntable`."""


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


# A three-axis turntable: it turns a unit to commanded roll, pitch and heading about a fixed point, and stays there.
#
# Each angle follows its command smoothly, at a limited rate (`insenv.vehicles.script`). Angles are not limited: full turns and
# a unit upside down are allowed.

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
        rows = SCRIPT.count(p, x)
        for tracker, name in zip(_TRACKERS, ANGLES, strict=True):
            target = getattr(x, f"commanded_{name}")
            rows |= tracker.hold(x, p.sample_interval, target, p.table_bandwidth, x.commanded_rate)
        return rows

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


# The section [vehicle] of a three-axis turntable: a plan of orientations.


class TurntableLeg(Section):
    """One orientation, from that of [start]: an angle that is absent stays; the table turns there and then stands."""

    duration_s: Number = lasting("duration of the turn and the standing", ...)
    roll_deg: Number | None = key(None, "angle of the roll axis", "deg", ge=-36000, le=36000)
    pitch_deg: Number | None = key(None, "angle of the pitch axis", "deg", ge=-36000, le=36000)
    heading_deg: Number | None = key(None, "angle of the heading axis", "deg", ge=-36000, le=36000)
    rate_deg_s: Number | None = key(None, "largest rate of each axis, from this leg on (initially 10)", "deg/s", gt=0, le=1000)


class TurntableSection(VehicleSection):
    """A three-axis turntable that turns the unit in place, to calibrate it or to average its biases."""

    traits: ClassVar[VehicleTraits] = VehicleTraits(actions=INDEXING, turns_in_place=True)

    kind: Literal["turntable"] = key(..., "kind of vehicle")
    legs: tuple[TurntableLeg, ...] = key((), "the plan, orientation by orientation", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", row="segments_repeat", strict=True)

    @property
    def in_place(self) -> bool:
        """It turns about a fixed point."""
        return True

    def vehicle(self) -> Vehicle:
        """Equations of motion."""
        return three_axis_table()

    def check_interval(self, sample_interval: float) -> None:
        """Raise `InputError` for a rate that turns the unit too far in a sample, and for a leg too short for its turn."""
        fastest = max((leg.rate_deg_s or 0.0 for leg in self.legs), default=0.0)
        turned = radians(fastest) * sample_interval
        if turned > LARGEST_TURN:
            raise InputError(
                f"vehicle.legs: rate_deg_s = {fastest:g} turns by {turned:.2g} rad in a sample: allowed is {LARGEST_TURN} rad; "
                "use a higher rate_hz"
            )
        self._check_turns(sample_interval)

    def _check_turns(self, sample_interval: float) -> None:
        """Raise `InputError` for a leg too short for its turn, also for the first one where it follows the last."""
        legs = list(enumerate(self._table()[: len(self.legs)]))
        before = np.zeros(len(ANGLES))
        for number, leg in legs + legs[: self.repeat_legs]:
            turns, before = np.abs(leg[1:4] - before), leg[1:4]
            axis = int(np.argmax(turns))
            needed = turning_time(float(turns[axis]), float(leg[4]), sample_interval)
            if needed > leg[0]:
                raise InputError(
                    f"vehicle.legs[{number}]: duration_s = {leg[0]:g} is too short for {ANGLES[axis]}_deg = "
                    f"{degrees(leg[1 + axis]):g}: a turn by {degrees(turns[axis]):g} deg at {degrees(leg[4]):g} deg/s takes "
                    f"{ceil(10.0 * needed) / 10.0:g} s until the table stands"
                )

    def _table(self) -> Array:
        segments = []
        for leg in self.legs:
            turned = {name: getattr(leg, f"{name}_deg") for name in ANGLES} | {"rate": leg.rate_deg_s}
            segments.append({"duration": leg.duration_s} | {k: radians(v) for k, v in turned.items() if v is not None})
        return in_legs(lambda: SCRIPT.table(segments))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI)."""
        return {**rows_of(self), "segments": self._table()}


LARGEST_TURN = 0.2
"""rad in a sample, of each of three axes."""
