"""The message schedule: which message is due at which sample, by rates on the simulation clock.

A message of rate r is due at the first sample at or after each multiple of 1/r since its rate was set.  The mean rate
is therefore exact.  No message is due twice in a sample, so that the sample rate is the highest rate.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping
from math import ceil

from insenv.base.errors import InputError, nearest

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
