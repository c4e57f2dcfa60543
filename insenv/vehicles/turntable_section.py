"""The section [vehicle] of a three-axis turntable: a plan of orientations."""

from __future__ import annotations

from math import ceil, degrees, radians
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.toml import Number, Section, key
from insenv.vehicles.section import MAX_LEGS, StartSection, VehicleSection, in_legs
from insenv.vehicles.three_axis_table import ANGLES, SCRIPT, three_axis_table, turning_time
from insenv.vehicles.truth import Vehicle


class TurntableLeg(Section):
    """One orientation, from that of [start]: an angle that is absent stays; the table turns there and then stands."""

    duration_s: Number = key(..., "duration of the turn and the standing", "s", gt=0, le=86400)
    roll_deg: Number | None = key(None, "angle of the roll axis", "deg", ge=-36000, le=36000)
    pitch_deg: Number | None = key(None, "angle of the pitch axis", "deg", ge=-36000, le=36000)
    heading_deg: Number | None = key(None, "angle of the heading axis", "deg", ge=-36000, le=36000)
    rate_deg_s: Number | None = key(None, "largest rate of each axis, from this leg on (initially 10)", "deg/s", gt=0, le=1000)


class TurntableSection(VehicleSection):
    """A three-axis turntable that turns the unit in place, to calibrate it or to average its biases."""

    kind: Literal["turntable"] = key(..., "kind of vehicle")
    legs: tuple[TurntableLeg, ...] = key((), "the plan, orientation by orientation", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", strict=True)

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

    def _table(self) -> NDArray[np.float64]:
        segments = []
        for leg in self.legs:
            turned = {name: getattr(leg, f"{name}_deg") for name in ANGLES} | {"rate": leg.rate_deg_s}
            segments.append({"duration": leg.duration_s} | {k: radians(v) for k, v in turned.items() if v is not None})
        return in_legs(lambda: SCRIPT.table(segments))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI)."""
        return {"segments": self._table(), "segments_repeat": float(self.repeat_legs)}


LARGEST_TURN = 0.2
"""rad in a sample, of each of three axes."""
