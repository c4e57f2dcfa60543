"""GNSS receiver: fixes of the antenna's position and velocity, at their own rate, with latency and noise.

At the epoch, which precedes the sample on which it is processed by tau = `gnss_epoch_offset`, from the truth at the
IMU:

    r_antenna = C_nb l
    v_antenna = v + C_nb (omega_eb x l)
    a_antenna = a + C_nb (omega_eb' x l + omega_eb x (omega_eb x l))
    offset    = r_antenna - v_antenna tau + a_antenna tau^2 / 2    (m, tangent plane at the IMU)
    velocity  = v_antenna - a_antenna tau

l is the actual lever arm: the stated one, and an error that is drawn at the start.  So is the delay: the time by which a fix is
older than its age says.  The errors of position are white noise, a first-order Gauss-Markov process stepped exactly from
epoch to epoch, and outliers; the error of velocity is white noise.  The sum of offset and errors is converted to
geodetic coordinates exactly. The fix is delivered after `gnss_latency`, with its age.  A sample without a fix only
increments a counter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

import casadi as ca
import numpy as np
from pydantic import field_validator

from insenv.attitude import rotate
from insenv.base.errors import InputError
from insenv.base.keys import rows_of
from insenv.base.remarks import declared
from insenv.base.toml import LeverArm, NotNegative, Number, key, one_of
from insenv.core.compose import Part
from insenv.core.elementary import TWO_PI, clamp, exp, maximum, normals, select, sin_cos
from insenv.core.model import Step, Values
from insenv.core.tables import Row, Table
from insenv.geodesy import geodetic_from_ned_offset, place_rows
from insenv.sensors.catalogue import GNSS_GRADES, gnss_grade
from insenv.sensors.contract import ErrorSource, Instant, Sensor, Stated
from insenv.sensors.figures import TimedSection
from insenv.sensors.imu_tables import HUGE
from insenv.sensors.instrument import sigma_row
from insenv.sensors.sampled import OUTAGES

GNSS_UNIFORMS = 13
START_UNIFORMS = 8
SIGMA_FLOOR = 1e-3
"""Smallest standard deviation that the receiver reports, m and m/s; never 0, so that an estimator may divide by it."""

GNSS_PARAMETERS = Table((
    Row("gnss_interval", "Time between fixes, a whole number of samples; the first comes one interval after the start", "s",
        start=1.0, lower=1e-4, upper=HUGE),
    Row("gnss_latency", "Time from the sample of the epoch to delivery, a whole number of samples, below the interval", "s",
        lower=0.0, upper=3600.0),
    Row("gnss_epoch_offset", "Time by which the epoch precedes the sample on which it is processed, below one sample", "s",
        lower=0.0, upper=1.0),
    Row("antenna_lever_arm_b", "Position of the antenna relative to the IMU", "m", (3,), "b", lower=-1e3, upper=1e3),
    Row("antenna_lever_arm_error", "Actual minus stated lever arm, fixed part", "m", (3,), "b", lower=-1e3, upper=1e3),
    Row("antenna_lever_arm_sigma", "Actual minus stated lever arm, 1 sigma of the part drawn at the start", "m", (3,), "b",
        lower=0.0),
    Row("gnss_delay_error", "True minus stated age of a fix, fixed part", "s", lower=-3600.0, upper=3600.0),
    Row("gnss_delay_sigma", "True minus stated age of a fix, 1 sigma of the part drawn at the start", "s", lower=0.0,
        upper=3600.0),
    Row("gnss_position_noise", "White position noise, standard deviation", "m", (3,), "n", lower=0.0),
    Row("gnss_velocity_noise", "White velocity noise, standard deviation", "m/s", (3,), "n", lower=0.0),
    Row("gnss_wander_sigma", "Correlated position error (Gauss-Markov), standard deviation", "m", (3,), "n", lower=0.0),
    Row("gnss_wander_time", "Correlated position error (Gauss-Markov), correlation time", "s", start=60.0, lower=1e-3,
        upper=HUGE),
    Row("gnss_outlier_probability", "Probability that a position is an outlier", lower=0.0, upper=1.0),
    Row("gnss_outlier_size", "Length of an outlier's displacement, in a random direction", "m", lower=0.0),
    Row("gnss_has_velocity", "1 if the receiver measures velocity, 0 if not", start=1.0, lower=0.0, upper=1.0, flag=True),
    Row("gnss_outage_start", "Outage windows: first epoch lost, time since the start", "s", (OUTAGES,)),
    Row("gnss_outage_end", "Outage windows: first epoch no longer lost; a window that ends as it starts is empty", "s",
        (OUTAGES,)),
))  # fmt: skip

_NAMES = ("latitude", "longitude", "height", "velocity_n")


def _fix(prefix: str, when: str) -> tuple[Row, ...]:
    velocity = Row(f"{prefix}velocity_n", f"Velocity relative to the Earth of the antenna, {when}", "m/s", (3,), "n")
    return (*place_rows(prefix, f" of the antenna, {when}"), velocity)


GNSS_STATE = Table((
    Row("gnss_valid", "1 on the one sample on which a fix is delivered", lower=0.0, upper=1.0, flag=True),
    Row("gnss_velocity_valid", "1 where gnss_valid is and the fix has a velocity", lower=0.0, upper=1.0, flag=True),
    *_fix("gnss_", "latest fix delivered"),
    Row("gnss_position_sigma", "Standard deviation of position that the receiver reports", "m", (3,), "n", 1.0),
    Row("gnss_velocity_sigma", "Standard deviation of velocity that the receiver reports", "m/s", (3,), "n", 1.0),
    Row("gnss_age", "Time from the epoch of the latest fix to its delivery", "s"),
    *_fix("gnss_pending_", "latest epoch, not yet delivered"),
    Row("gnss_pending", "1 if the latest epoch gave a fix", lower=0.0, upper=1.0),
    Row("gnss_wander", "Correlated position error at the latest epoch", "m", (3,), "n"),
    Row("gnss_epochs", "Number of epochs so far"),
    Row("gnss_counter", "Samples since the latest epoch"),
    Row("gnss_due", "1 on a sample that ends with a measurement", lower=0.0, upper=1.0),
    Row("antenna_lever_arm_true", "Actual position of the antenna relative to the IMU", "m", (3,), "b"),
    Row("gnss_delay_true", "True minus stated age of a fix", "s"),
    Row("gnss_latency_true", "Actual time from the sample of the epoch to delivery, whole samples", "s"),
    Row("gnss_epoch_offset_true", "Actual time by which the epoch precedes its sample, below one sample", "s"),
))  # fmt: skip


def gnss_part(instant: Instant) -> Part:
    """The receiver as a part of a plant.

    Reads the parameter ``sample_interval`` (s) and the true state rows at the IMU: ``latitude``, ``longitude`` (rad),
    ``height`` (m), ``velocity_n`` (m/s) and ``q_nb``; from these, `instant` computes the true angular rate omega_eb^b
    (3, rad/s), its time derivative (3, rad/s^2) and that of velocity_n (3, m/s^2). Steps: "sample", "gnss" (when
    ``gnss_due``, 13 uniforms), "gnss_delivery" (when ``gnss_valid``); the start uses 8 uniforms.
    """

    def measure(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
        return _measure(p, x, r, *instant(p, x))

    return Part(
        parameters=GNSS_PARAMETERS,
        state=GNSS_STATE,
        steps={
            "sample": Step(_sample),
            "gnss": Step(measure, when="gnss_due", uniforms=GNSS_UNIFORMS),
            "gnss_delivery": Step(_deliver, when="gnss_valid"),
        },
        start=_start,
        start_uniforms=START_UNIFORMS,
    )


GNSS_STATED = Table((
    sigma_row("antenna_lever_arm_sigma", "Error of the lever arm of the antenna", "m", (3,), "b"),
    sigma_row("gnss_delay_sigma", "Error of the age of a fix: true minus stated", "s"),
))  # fmt: skip
"""What is told of a receiver beside the fields of `insenv.Knowledge`."""


def _stated_errors(rows: Mapping[str, Any]) -> dict[str, Any]:
    delay = float(np.hypot(rows["gnss_delay_error"], rows["gnss_delay_sigma"]))
    return {
        "antenna_lever_arm_sigma": np.hypot(rows["antenna_lever_arm_error"], rows["antenna_lever_arm_sigma"]),
        "gnss_delay_sigma": delay,
    }


def _stated(p: Values, x: Values) -> dict[str, Any]:
    """The standard deviations that the receiver reports."""
    position = ca.sqrt(p.gnss_position_noise**2 + p.gnss_wander_sigma**2)
    return {
        "gnss_position_sigma": maximum(position, SIGMA_FLOOR),
        "gnss_velocity_sigma": maximum(p.gnss_velocity_noise, SIGMA_FLOOR),
    }


GNSS_ERRORS = (
    ErrorSource("GNSS position noise", ("gnss_position_noise",)),
    ErrorSource("GNSS velocity noise", ("gnss_velocity_noise",)),
    ErrorSource("GNSS wander", ("gnss_wander_sigma",)),
    ErrorSource("GNSS outliers", ("gnss_outlier_probability",)),
    ErrorSource("GNSS latency", ("gnss_latency", "gnss_epoch_offset")),
    ErrorSource("GNSS delay not stated", ("gnss_delay_error", "gnss_delay_sigma")),
    ErrorSource("GNSS lever arm", ("antenna_lever_arm_error", "antenna_lever_arm_sigma")),
    ErrorSource("GNSS outages", ("gnss_outage_start", "gnss_outage_end")),
)

GNSS = Sensor(
    "gnss",
    gnss_part,
    outputs=(
        "gnss_valid",
        "gnss_age",
        "gnss_latitude",
        "gnss_longitude",
        "gnss_height",
        "gnss_position_sigma",
        "gnss_velocity_valid",
        "gnss_velocity_n",
        "gnss_velocity_sigma",
    ),
    truth=("antenna_lever_arm_true", "gnss_delay_true"),
    stated_errors=_stated_errors,
    errors=GNSS_ERRORS,
    stated=Stated("gnss_valid", _stated),
)


def _start(p: Values, r: Any) -> dict[str, Any]:
    """Draw the wander, the lever arm and the delay.

    The true age of a fix is the stated one plus the delay, but at least 0 and below the interval, because only one fix can be
    pending.
    """
    n = normals(r)
    stated = p.gnss_latency + p.gnss_epoch_offset
    drawn = p.gnss_delay_error + p.gnss_delay_sigma * n[7]
    age = clamp(stated + drawn, 0.0, p.gnss_interval - p.sample_interval)
    samples = ca.floor(age / p.sample_interval + 1e-9)
    late = drawn != 0.0
    return {
        "gnss_wander": p.gnss_wander_sigma * n[0:3],
        "antenna_lever_arm_true": p.antenna_lever_arm_b + p.antenna_lever_arm_error + p.antenna_lever_arm_sigma * n[4:7],
        "gnss_delay_true": select(late, age - stated, 0.0),
        "gnss_latency_true": select(late, samples * p.sample_interval, p.gnss_latency),
        "gnss_epoch_offset_true": select(late, maximum(age - samples * p.sample_interval, 0.0), p.gnss_epoch_offset),
    }


def _sample(p: Values, x: Values, u: Values) -> dict[str, Any]:
    """Count the sample; determine whether the pending fix is delivered and whether another is due."""
    counter = x.gnss_counter + 1.0
    late = counter * p.sample_interval - x.gnss_latency_true
    arrives = ca.fabs(late) < 0.5 * p.sample_interval
    return {
        "gnss_counter": counter,
        "gnss_due": (counter + 0.5) * p.sample_interval > p.gnss_interval,
        "gnss_valid": arrives * x.gnss_pending,
        "gnss_velocity_valid": 0.0,
    }


def _measure(p: Values, x: Values, r: Any, rate_eb_b: Any, rate_change_b: Any, acceleration_n: Any) -> dict[str, Any]:
    """The measurement at an epoch: antenna, errors, outages."""
    n = normals(r[0:10])
    tau = x.gnss_epoch_offset_true
    speed = ca.cross(rate_eb_b, x.antenna_lever_arm_true)
    velocity = x.velocity_n + rotate(x.q_nb, speed)
    bend = ca.cross(rate_change_b, x.antenna_lever_arm_true) + ca.cross(rate_eb_b, speed)
    acceleration = acceleration_n + rotate(x.q_nb, bend)
    offset = rotate(x.q_nb, x.antenna_lever_arm_true) - velocity * tau + acceleration * (0.5 * tau * tau)

    decay = exp(-p.gnss_interval / p.gnss_wander_time)
    wander = decay * x.gnss_wander + p.gnss_wander_sigma * ca.sqrt((1.0 - decay) * (1.0 + decay)) * n[3:6]
    outlier = (r[10] < p.gnss_outlier_probability) * p.gnss_outlier_size * direction(r[11], r[12])
    latitude, longitude, height = geodetic_from_ned_offset(
        offset + p.gnss_position_noise * n[0:3] + wander + outlier, x.latitude, x.longitude, x.height
    )

    epochs = x.gnss_epochs + 1.0
    # a microsecond decides ties, which rounding would otherwise decide arbitrarily
    time = epochs * p.gnss_interval - tau + 1e-6
    lost = 0.0
    for i in range(OUTAGES):
        lost = lost + (time >= p.gnss_outage_start[i]) * (time < p.gnss_outage_end[i])
    fix = lost == 0.0
    return {
        "gnss_pending": fix,
        "gnss_pending_latitude": latitude,
        "gnss_pending_longitude": longitude,
        "gnss_pending_height": height,
        "gnss_pending_velocity_n": velocity - acceleration * tau + p.gnss_velocity_noise * n[6:9],
        "gnss_wander": wander,
        "gnss_epochs": epochs,
        "gnss_counter": 0.0,
        "gnss_valid": fix * (x.gnss_latency_true < 0.5 * p.sample_interval),
    }


def direction(u1: Any, u2: Any) -> Any:
    """Unit vector (3) uniform over the sphere, from two uniforms."""
    z = 2.0 * u1 - 1.0
    sine, cosine = sin_cos(TWO_PI * u2)
    radius = ca.sqrt(1.0 - z * z)
    return ca.vertcat(radius * cosine, radius * sine, z)


def _deliver(p: Values, x: Values, u: Values) -> dict[str, Any]:
    """The pending fix becomes the latest one."""
    state: dict[str, Any] = {f"gnss_{name}": getattr(x, f"gnss_pending_{name}") for name in _NAMES}
    delivered_at = select(x.gnss_latency_true < 0.5 * p.sample_interval, 0.0, x.gnss_counter)
    return state | {
        **_stated(p, x),
        "gnss_age": delivered_at * p.sample_interval + x.gnss_epoch_offset_true - x.gnss_delay_true,
        "gnss_velocity_valid": p.gnss_has_velocity,
    }


# The section [gnss] of a scenario: a grade of the catalogue, values that replace its own, times, outages.

_ZERO = (0.0, 0.0, 0.0)
SHOWN_SIGMAS = 3.0
"""Drawn delays that are cut are worth a note if the range ends within so many sigmas of the mean."""
ROUNDING_S = 1e-9
"""Rounding of a delay at the end of its range."""
_DELAYS_CUT = declared(
    "delays-cut",
    "gnss.delay_sigma_s = {sigma:g} s: drawn delays are cut to {least:g} to {most:g} s, because no fix is from the future and "
    "only one at a time is pending",
)


class GnssSection(TimedSection):
    """The GNSS receiver."""

    sensor: ClassVar[Sensor] = GNSS

    grade: Annotated[str, one_of(GNSS_GRADES)] = key("spp", "grade of the catalogue (docs/sensors.md)")
    epoch_offset_s: Number = key(
        0.0, "time from the epoch of a fix to its sample, below one sample", "s", row="gnss_epoch_offset", ge=0, le=1
    )
    lever_arm_m: LeverArm = key(
        _ZERO, "from the inertial unit to the antenna: forward, right, down", "m", row="antenna_lever_arm_b"
    )
    lever_arm_error_m: LeverArm = key(_ZERO, "actual minus stated lever arm", "m", row="antenna_lever_arm_error")
    lever_arm_sigma_m: NotNegative = key(
        _ZERO, "actual minus stated lever arm, 1 sigma of a part drawn at the start", "m", row="antenna_lever_arm_sigma"
    )
    delay_error_s: Number = key(
        0.0, "time by which a fix is older than its age says; latency and this from 0 to less than the interval",
        "s", row="gnss_delay_error", ge=-3600, le=3600,
    )  # fmt: skip
    delay_sigma_s: Number = key(
        0.0, "that time, 1 sigma of a part drawn at the start", "s", row="gnss_delay_sigma", ge=0, le=3600
    )
    velocity: bool = key(True, "whether fixes contain a velocity", row="gnss_has_velocity", strict=True)
    position_noise_m: NotNegative | None = key(
        None, "white noise of position (1 sigma, NED); the grade's if absent", "m", row="gnss_position_noise"
    )
    velocity_noise_mps: NotNegative | None = key(
        None, "white noise of velocity (1 sigma, NED); the grade's if absent", "m/s", row="gnss_velocity_noise"
    )
    wander_sigma_m: NotNegative | None = key(
        None, "correlated error of position (1 sigma, NED); the grade's if absent", "m", row="gnss_wander_sigma"
    )
    wander_time_s: Number | None = key(
        None, "correlation time of that error; the grade's if absent", "s", row="gnss_wander_time", gt=0, le=1e9
    )
    outlier_probability: Number = key(
        0.0, "probability that a position is an outlier", row="gnss_outlier_probability", ge=0, le=1
    )
    outlier_size_m: Number = key(0.0, "length of an outlier", "m", row="gnss_outlier_size", ge=0, le=1e7)

    @field_validator("grade")
    @classmethod
    def _known(cls, value: str) -> str:
        gnss_grade(value)
        return value

    @property
    def max_age_s(self) -> float:
        """Largest age of a fix when it arrives, s; of a drawn delay `SHOWN_SIGMAS`, as far as the interval allows it."""
        drawn = self.delay_error_s + SHOWN_SIGMAS * self.delay_sigma_s
        stated = self.latency_s + self.epoch_offset_s
        return max(stated, min(stated + drawn, self.interval_s))

    def _delays(self, sample: float) -> tuple[float, float]:
        """Smallest and largest delay that `_start` of the receiver does not cut, s, at samples of `sample` (s)."""
        stated = self.latency_s + self.epoch_offset_s
        return 0.0 - stated, max(self.interval_s - sample - stated, 0.0)

    def notes(self, rate_hz: float) -> tuple[str, ...]:
        """The range to which drawn delays are cut, where it cuts more than a few of them."""
        least, most = self._delays(1.0 / rate_hz)
        reach = SHOWN_SIGMAS * self.delay_sigma_s
        if reach == 0.0 or (least <= self.delay_error_s - reach and self.delay_error_s + reach <= most):
            return ()
        return (_DELAYS_CUT.filled(sigma=self.delay_sigma_s, least=least, most=most),)

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for times that do not fit the samples."""
        sample = 1.0 / rate_hz
        if self.epoch_offset_s >= sample:
            raise InputError(
                f"gnss.epoch_offset_s = {self.epoch_offset_s:g} s: allowed is from 0 to less than one sample of {sample:g} s"
            )
        timing = self.timing(rate_hz)
        least, most = self._delays(sample)
        if not least - ROUNDING_S <= self.delay_error_s <= most + ROUNDING_S:
            raise InputError(
                f"gnss.delay_error_s = {self.delay_error_s:g} s: allowed is from {least:g} to {most:g} s where latency_s + "
                f"epoch_offset_s = {self.latency_s + self.epoch_offset_s:g} s and interval_s = {self.interval_s:g} s, because "
                "no fix is from the future and only one at a time is pending"
            )
        return {**gnss_grade(self.grade).parameters(), **timing, **rows_of(self)}
