"""From numbers to MAVLink messages: the one place where values are rounded and limited to the range of their fields.

A value is given in its field's unit, as a float of any size.  For integer fields it is rounded to the nearest, ties to
even.  A value out of range is replaced by the nearest value that the field can hold, and counted.  NaN means "unknown":
it becomes the value by which MAVLink says so where the field has one (`UNKNOWN`), or stays NaN where that is documented
(`MAY_BE_NAN`).  A message with NaN in any other field, such as a position, is not made, and is counted.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, degrees, inf, isfinite
from typing import Any

from insenv.base.errors import InputError, nearest
from insenv.mavlink.wire.frames import message_class

Message = Any
"""A message object of `pymavlink.dialects.v20.common`."""

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

_BITS = {"int8_t": 8, "int16_t": 16, "int32_t": 32, "int64_t": 64}


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
    if kind == "float":
        return -FLOAT32_MAX, FLOAT32_MAX
    if kind == "double":
        return -inf, inf
    bits = _BITS.get(kind.removeprefix("u"), 8)
    return (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind.startswith("int") else (0, 2**bits - 1)


# The message schedule: which message is due at which sample, by rates on the simulation clock.
#
# A message of rate r is due at the first sample at or after each multiple of 1/r since its rate was set.  The mean rate
# is therefore exact.  No message is due twice in a sample, so that the sample rate is the highest rate.

MAX_HZ = 1000.0

DEFAULT_HZ: dict[str, float] = {
    "HEARTBEAT": 1.0,
    "SYS_STATUS": 1.0,
    "SYSTEM_TIME": 1.0,
    "EXTENDED_SYS_STATE": 1.0,
    "CURRENT_MODE": 0.0,
    "HOME_POSITION": 0.5,
    "GPS_GLOBAL_ORIGIN": 0.5,
    "HIL_SENSOR": 200.0,
    "HIGHRES_IMU": 50.0,
    "RAW_IMU": 0.0,
    "SCALED_IMU": 0.0,
    "SCALED_PRESSURE": 2.0,
    "GPS_RAW_INT": 5.0,
    "HIL_GPS": MAX_HZ,
    "HIL_STATE_QUATERNION": 20.0,
    "ATTITUDE": 20.0,
    "ATTITUDE_QUATERNION": 20.0,
    "LOCAL_POSITION_NED": 10.0,
    "GLOBAL_POSITION_INT": 10.0,
    "ODOMETRY": 20.0,
    "VFR_HUD": 5.0,
    "ALTITUDE": 5.0,
    "ESTIMATOR_STATUS": 1.0,
}
"""Default rate (Hz) of every streamed message.  HIL_GPS is looked for at each sample and sent once per fix."""

STREAMS: dict[int, tuple[str, ...]] = {
    1: ("HIGHRES_IMU", "RAW_IMU", "SCALED_PRESSURE"),
    2: ("SYS_STATUS", "GPS_RAW_INT", "EXTENDED_SYS_STATE"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ALTITUDE"),
    10: ("ATTITUDE", "ATTITUDE_QUATERNION"),
    11: ("VFR_HUD",),
    12: ("SYSTEM_TIME", "ESTIMATOR_STATUS"),
}
"""Messages of each data stream of REQUEST_DATA_STREAM, by its number; stream 0 means all of these."""


class Schedule:
    """Rates of messages and the samples at which they are due.

    sample_hz: sample rate.  rates: Hz by message, instead of the default; 0: never.  fixed: the messages named in
    `rates`.  Raises `InputError` for an unknown message or a rate out of range.
    """

    def __init__(self, sample_hz: float, rates: Mapping[str, float] | None = None) -> None:
        self._sample_hz = sample_hz
        self.rates = dict(DEFAULT_HZ)
        for name, hz in (rates or {}).items():
            check_rate(name, hz)
            self.rates[name] = hz
        self.fixed = frozenset(rates or ())
        self._serial = dict.fromkeys(self.rates, 0)
        self._begun: dict[str, int] = {}
        self._due: list[tuple[int, int, str, int]] = []
        for name in self.rates:
            self._begin(name, 0)

    def set(self, name: str, hz: float, sample: int) -> None:
        """Set a rate from `sample` on; 0 stops the message.  A rate above that of the samples is that.  Raises `InputError`."""
        check_rate(name, hz)
        hz = hz if hz == DEFAULT_HZ[name] else min(hz, self._sample_hz)
        if hz != self.rates[name]:
            self.rates[name] = hz
            self._begin(name, sample)

    def reset(self, name: str, sample: int) -> None:
        """Restore the default rate."""
        self.set(name, DEFAULT_HZ[name], sample)

    def due(self, sample: int) -> list[str]:
        """The messages due at `sample`; call it once for every sample."""
        found: list[str] = []
        while self._due and self._due[0][0] <= sample:
            _, order, name, serial = heapq.heappop(self._due)
            if serial != self._serial[name]:
                continue  # its rate has changed since
            found.append(name)
            per = self._sample_hz / self.rates[name]
            count = int((sample - self._begun[name]) / per + 1e-9) + 1
            heapq.heappush(self._due, (self._begun[name] + ceil(count * per - 1e-9), order, name, serial))
        return found

    def _begin(self, name: str, sample: int) -> None:
        self._serial[name] += 1
        self._begun[name] = sample
        if self.rates[name] > 0.0:
            order = list(DEFAULT_HZ).index(name)
            first = sample + ceil(self._sample_hz / self.rates[name] - 1e-9)
            heapq.heappush(self._due, (first, order, name, self._serial[name]))


def check_rate(name: str, hz: float, most: float = MAX_HZ) -> None:
    """Raise `InputError` unless `name` is a streamed message and `hz` a rate from 0 to `most`."""
    if name not in DEFAULT_HZ:
        raise InputError(f"no streamed message {name!r}{nearest(name, DEFAULT_HZ, 'docs/mavlink.md')}")
    if not 0.0 <= hz <= most:
        raise InputError(f"rate of {name} = {hz:g} Hz: allowed is 0 (never) to {most:g} Hz")


def parse_rates(texts: list[str], sample_hz: float = MAX_HZ) -> dict[str, float]:
    """Parse rates from ``MESSAGE=HZ`` texts; no message can be sent more often than samples come.  Raises `InputError`."""
    rates: dict[str, float] = {}
    for text in texts:
        name, sign, number = text.partition("=")
        name = name.strip().upper()
        try:
            hz = float(number)
        except ValueError:
            hz = float("nan")
        if not sign or hz != hz:
            raise InputError(f"--rate {text!r}: allowed is MESSAGE=HZ, such as ATTITUDE=50")
        check_rate(name, hz, min(sample_hz, MAX_HZ))
        if name in rates:
            raise InputError(f"--rate {name} is given twice: {rates[name]:g} and {hz:g} Hz")
        rates[name] = hz
    return rates
