"""The messages that the vehicle makes, their rates, and the samples at which they are due.

A message of rate r is due at the first sample at or after each multiple of 1/r since its rate was set.  The mean rate
is therefore exact.  No message is due twice in a sample, so that the sample rate is the highest rate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf

from insenv.base.errors import InputError, nearest
from insenv.mavlink.messages import sensor, state
from insenv.mavlink.messages.fields import Message, Values
from insenv.mavlink.messages.view import View

Content = Callable[[View], "Values | None"]
"""The values of a message's fields at the present sample; None if it has no content yet."""
MAX_HZ = 1000.0


@dataclass(frozen=True)
class Streamed:
    """A streamed message.

    hz: default rate; 0: only on request.  values: what it holds.  stream: its data stream in REQUEST_DATA_STREAM; 0: none.
    """

    hz: float
    values: Content
    stream: int = 0


STREAMED: dict[str, Streamed] = {
    "HEARTBEAT": Streamed(1.0, state.heartbeat),
    "SYS_STATUS": Streamed(1.0, state.sys_status, 2),
    "SYSTEM_TIME": Streamed(1.0, lambda view: (view.unix_us, view.time_ms), 12),
    "EXTENDED_SYS_STATE": Streamed(1.0, state.extended_sys_state, 2),
    "CURRENT_MODE": Streamed(0.0, lambda view: (0, view.mode.number, view.mode.number)),
    "HOME_POSITION": Streamed(0.5, state.home_position),
    "GPS_GLOBAL_ORIGIN": Streamed(0.5, lambda view: (*view.place(*view.home), view.time_us)),
    "HIL_SENSOR": Streamed(200.0, lambda view: sensor.imu(view, "HIL_SENSOR")),
    "HIGHRES_IMU": Streamed(50.0, lambda view: sensor.imu(view, "HIGHRES_IMU"), 1),
    "RAW_IMU": Streamed(0.0, sensor.raw_imu, 1),
    "SCALED_IMU": Streamed(0.0, sensor.scaled_imu),
    "SCALED_PRESSURE": Streamed(2.0, sensor.scaled_pressure, 1),
    "GPS_RAW_INT": Streamed(5.0, sensor.gps_raw_int, 2),
    "HIL_GPS": Streamed(MAX_HZ, sensor.hil_gps),
    "HIL_STATE_QUATERNION": Streamed(20.0, state.hil_state_quaternion),
    "ATTITUDE": Streamed(20.0, lambda view: (view.time_ms, *view.derived("euler", "rate_nb_b")), 10),
    "ATTITUDE_QUATERNION": Streamed(20.0, state.attitude_quaternion, 10),
    "LOCAL_POSITION_NED": Streamed(  # velocity along the axes at the vehicle
        10.0, lambda view: (view.time_ms, *view.derived("offset"), *view.estimated_velocity_n.tolist()), 6
    ),
    "GLOBAL_POSITION_INT": Streamed(10.0, state.global_position_int, 6),
    "ODOMETRY": Streamed(20.0, state.odometry),
    "VFR_HUD": Streamed(5.0, state.vfr_hud, 11),
    "ALTITUDE": Streamed(5.0, state.altitude, 6),
    "ESTIMATOR_STATUS": Streamed(1.0, state.estimator_status, 12),
}
"""By name, in the order in which they are sent.  HIL_GPS is looked for at each sample and sent once per fix."""

DEFAULT_HZ = {name: message.hz for name, message in STREAMED.items()}
SILENT = dict.fromkeys(DEFAULT_HZ, 0.0)
"""Rates of a vehicle that sends no messages by itself."""

MESSAGES: dict[str, Content] = {
    **{name: message.values for name, message in STREAMED.items()},
    "AUTOPILOT_VERSION": state.autopilot_version,
    "AVAILABLE_MODES": lambda view: state.available_modes(view)[0],
}
"""Every message that the vehicle can make, by name."""


def make(view: View, name: str) -> Message | None:
    """A message of the present sample by name; None if it is unknown, has no content yet, or is refused (`Fields`)."""
    values = MESSAGES[name](view) if name in MESSAGES else None
    return None if values is None else view.fields.message(name, *values)


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
        self._begun = dict.fromkeys(self.rates, 0)
        self._due = {name: self._next(name, 0) for name in self.rates}

    def set(self, name: str, hz: float, sample: int) -> None:
        """Set a rate from `sample` on; 0 stops the message.  A rate above that of the samples is that.  Raises `InputError`."""
        check_rate(name, hz)
        hz = hz if hz == DEFAULT_HZ[name] else min(hz, self._sample_hz)
        if hz != self.rates[name]:
            self.rates[name] = hz
            self._begun[name] = sample
            self._due[name] = self._next(name, sample)

    def due(self, sample: int) -> list[str]:
        """The messages due at `sample`; call it once for every sample."""
        names = [name for name, at in self._due.items() if at <= sample]
        for name in names:
            self._due[name] = self._next(name, sample)
        return names

    def _next(self, name: str, sample: int) -> float:
        """The first sample after `sample` at which a message is due."""
        return next_due(self.rates[name], self._sample_hz, sample, self._begun[name])


def next_due(hz: float, sample_hz: float, sample: int, begun: int = 0) -> float:
    """The first sample after `sample` at which something of this rate is due that began at the sample `begun`."""
    if hz == 0.0:
        return inf
    period = sample_hz / hz
    count = int((sample - begun) / period + 1e-9) + 1
    return begun + ceil(count * period - 1e-9)


def check_rate(name: str, hz: float, highest: float = MAX_HZ) -> None:
    """Raise `InputError` unless `name` is a streamed message and `hz` a rate from 0 to `highest`."""
    if name not in STREAMED:
        raise InputError(f"no streamed message {name!r}{nearest(name, STREAMED, 'docs/mavlink.md')}")
    if not 0.0 <= hz <= highest:
        raise InputError(f"rate of {name} = {hz:g} Hz: allowed is 0 (never) to {highest:g} Hz")


def parse_rates(texts: Sequence[str], sample_hz: float = MAX_HZ) -> dict[str, float]:
    """Parse rates from ``MESSAGE=HZ`` texts; no message can be sent more often than samples come.  Raises `InputError`."""
    rates: dict[str, float] = {}
    for text in texts:
        name, _, number = text.partition("=")
        name = name.strip().upper()
        try:
            hz = float(number)
        except ValueError:
            hz = float("nan")
        if hz != hz:
            raise InputError(f"--rate {text!r}: allowed is MESSAGE=HZ, such as ATTITUDE=50")
        check_rate(name, hz, min(sample_hz, MAX_HZ))
        if name in rates:
            raise InputError(f"--rate {name} is given twice: {rates[name]:g} and {hz:g} Hz")
        rates[name] = hz
    return rates
