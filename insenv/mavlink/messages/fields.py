"""From numbers to MAVLink messages: the one place where values are rounded and limited to the range of their fields.

A value is given in its field's unit, as a float of any size.  For integer fields it is rounded to the nearest, ties to
even.  A value out of range is replaced by the nearest value that the field can hold, and counted.  NaN means "unknown":
it becomes the value by which MAVLink says so where the field has one (`UNKNOWN`), or stays NaN where that is documented
(`MAY_BE_NAN`).  A message with NaN in any other field, such as a position, is not made, and is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import degrees, inf, isfinite
from typing import Any

import numpy as np

from insenv.mavlink.wire.frames import Message, message_class

Values = tuple[Any, ...]
"""Values of a message's fields, in the order of its definition; trailing extension fields may be omitted."""

DEG_E7 = degrees(1.0) * 1e7
"""Units of 1e-7 degree per radian."""
CENTI_DEG = degrees(1.0) * 1e2
FLOAT32_MAX = 3.4028234663852886e38

UNKNOWN: dict[str, dict[str, int]] = {
    "GPS_RAW_INT": {"eph": 65535, "epv": 65535, "vel": 65535, "cog": 65535, "satellites_visible": 255, "yaw": 0},
    "HIL_GPS": {"eph": 65535, "epv": 65535, "vel": 65535, "cog": 65535, "satellites_visible": 255, "yaw": 0},
    "GLOBAL_POSITION_INT": {"hdg": 65535},
    "SYS_STATUS": {"voltage_battery": 65535, "current_battery": -1, "battery_remaining": -1},
}
"""The value that means "unknown" in an integer field, by message and field."""

MAY_BE_NAN: dict[str, frozenset[str]] = {
    "ODOMETRY": frozenset({"pose_covariance", "velocity_covariance"}),
    "ESTIMATOR_STATUS": frozenset((
        "vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio", "hagl_ratio", "tas_ratio",
        "pos_horiz_accuracy", "pos_vert_accuracy",
    )),
    "ALTITUDE": frozenset({"altitude_terrain", "bottom_clearance"}),
    "COMMAND_LONG": frozenset(f"param{i}" for i in range(1, 8)),
}  # fmt: skip
"""Float fields in which NaN means "unknown", by message."""


@dataclass(frozen=True)
class _Field:
    """One field: integer or not, range, length (0: no array), the value for "unknown", whether NaN is allowed."""

    name: str
    whole: bool
    low: float
    high: float
    length: int
    unknown: int | None
    may_be_nan: bool


class Fields:
    """Maker of messages, which counts values that do not fit.

    saturated: how often a value was out of its field's range, by "MESSAGE.field".  refused: how often a message was not
    made because a value was NaN, by the same name.
    """

    def __init__(self) -> None:
        self.saturated: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()

    def message(self, name: str, *values: float | Sequence[float] | bytes | str) -> Message | None:
        """Make the message `name` from the values of its fields, in the order of its definition; None if refused.

        Trailing extension fields may be omitted.  Text is truncated to its field.
        """
        make, plan = _plan(name)
        converted: list[Any] = []
        value: Any
        # not strict: extension fields may be omitted
        for field, value in zip(plan, values):  # noqa: B905
            whole, low, high = field.whole, field.low, field.high
            if field.length:
                if isinstance(value, (bytes, str)):
                    text = value.encode("ascii", "replace") if isinstance(value, str) else value
                    converted.append(text[: field.length])
                    continue
                part = [self._number(name, field, item) for item in value]
                if None in part:
                    return None
                converted.append(part)
            elif low <= value <= high:
                converted.append(round(value) if whole else value)
            else:
                number = self._number(name, field, value)
                if number is None:
                    return None
                converted.append(number)
        return make(*converted)

    def named(self, time_ms: int, values: Mapping[str, float]) -> list[Message]:
        """NAMED_VALUE_FLOAT of each value by name, without those that are NaN."""
        made = [self.message("NAMED_VALUE_FLOAT", time_ms, name, value) for name, value in values.items()]
        return [message for message in made if message is not None]

    def _number(self, name: str, field: _Field, value: float) -> float | None:
        if value != value:
            if field.whole and field.unknown is not None:
                return field.unknown
            if field.may_be_nan:
                return value
            self.refused[f"{name}.{field.name}"] += 1
            return None
        rounded = round(value) if field.whole and isfinite(value) else value
        if field.low <= rounded <= field.high:
            return rounded
        self.saturated[f"{name}.{field.name}"] += 1
        return field.low if rounded < field.low else field.high


@lru_cache(maxsize=256)
def _plan(name: str) -> tuple[Callable[..., Message], list[_Field]]:
    """The class of a message and its fields, in the order of its definition."""
    make = message_class(name)
    unknown, nan = UNKNOWN.get(name, {}), MAY_BE_NAN.get(name, frozenset())
    plan = []
    for place, (field, kind) in enumerate(zip(make.fieldnames, make.fieldtypes, strict=True)):
        low, high = _range(kind)
        if unknown.get(field) == high:
            high -= 1  # a saturated value must not mean "unknown"
        length = int(make.array_lengths[make.orders[place]])
        plan.append(_Field(field, kind not in ("float", "double"), low, high, length, unknown.get(field), field in nan))
    return make, plan


def _range(kind: str) -> tuple[float, float]:
    """Lowest and highest value of a type."""
    if kind in ("float", "double"):
        limit = FLOAT32_MAX if kind == "float" else inf
        return -limit, limit
    limits = np.iinfo("uint8" if kind == "char" else kind.removesuffix("_t"))
    return limits.min, limits.max
