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

Its errors, timing, figures and grades are declared as those of an instrument (`insenv.sensors.instrument`), and its keys, rows,
sources and steps, the states of fusion filters and of the limit follow from them as theirs do.  It is no `Instrument`
because its equation is another one: the epoch lies between samples and the fix is delivered after a delay that is drawn, so
that what is measured is the motion before the sample, with accelerations; positions are converted to geodetic coordinates after
the errors are added; the fix states its own accuracy; and estimators take position and velocity, with or without the latter, as
one measurement.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from insenv.attitude import rotate
from insenv.base.errors import InputError
from insenv.base.remarks import clock, declared
from insenv.base.toml import LeverArm, NotNegative, Number, key
from insenv.core.compose import Part
from insenv.core.elementary import TWO_PI, clamp, maximum, normals, select, sin_cos
from insenv.core.model import Step, Values
from insenv.core.tables import Array, Row, Table
from insenv.geodesy import bounded_place_rows, geodetic_from_ned_offset
from insenv.sensors.contract import ErrorSource, Instant, Sensor, Stated
from insenv.sensors.figures import Figure, Grade, TimedSection, by_name, figures_section, find_grade
from insenv.sensors.instrument import Estimated, Term, drift, sigma_row, sources_of, white
from insenv.sensors.sampled import counted, gauss_markov, lost_epoch, timing_rows, timing_sources, timing_state
from insenv.sensors.units import one_sigma_from_cep, one_sigma_from_r50

GNSS_UNIFORMS = 13
START_UNIFORMS = 8
SIGMA_FLOOR = 1e-3
"""Smallest standard deviation that the receiver reports, m and m/s; never 0, so that an estimator may divide by it."""

ARM = Row("antenna_lever_arm", "From the inertial unit to the antenna", "m", (3,), "b", lower=-1e3, upper=1e3)
"""The stated lever arm."""
TERMS = (
    Term(
        "lever_arm", "GNSS lever arm", "constant", (3,), "m", "b",
        fixed=Row("antenna_lever_arm_error", "Actual minus stated lever arm, fixed part", "m", (3,), "b", lower=-1e3,
                  upper=1e3),
        sigma=Row("antenna_lever_arm_sigma", "Actual minus stated lever arm, 1 sigma of the part drawn at the start", "m", (3,),
                  "b", lower=0.0),
        value=Row("antenna_lever_arm_true", "Actual position of the antenna relative to the IMU", "m", (3,), "b"),
        stated=(sigma_row("antenna_lever_arm_sigma", "Error of the lever arm of the antenna", "m", (3,), "b"),),
        states=(Estimated("gnss_lever_arm", "lever arm of the antenna", start=ARM.name, assumed=0.1),),
    ),
    Term(
        "delay", "GNSS delay not stated", "constant", (), "s",
        fixed=Row("gnss_delay_error", "True minus stated age of a fix, fixed part", "s", lower=-3600.0, upper=3600.0),
        sigma=Row("gnss_delay_sigma", "True minus stated age of a fix, 1 sigma of the part drawn at the start", "s", lower=0.0,
                  upper=3600.0),
        value=Row("gnss_delay_true", "True minus stated age of a fix", "s"),
        stated=(sigma_row("gnss_delay_sigma", "Error of the age of a fix: true minus stated", "s"),),
        states=(Estimated("gnss_delay", "age of the fixes beyond the stated age", assumed=0.02),),
    ),
    white("gnss_position_noise", "GNSS position noise", "White position noise", "m", (3,), "n", sigma_shape=(3,)),
    white("gnss_velocity_noise", "GNSS velocity noise", "White velocity noise", "m/s", (3,), "n", sigma_shape=(3,)),
    replace(
        drift("gnss_wander", "wander", "GNSS wander", "Correlated position error", "m", (3,), "n", sigma_shape=(3,),
              start_time=60.0),
        stated=(
            Row("fix_wander_sigma", "Part of a fix's position sigma that changes slowly", "m", (3,), "n", lower=0, upper=1e6),
            Row("fix_wander_time", "Correlation time of that part", "s", start=60.0, lower=1e-3, upper=1e9),
        ),
        states=(Estimated("gnss_wander", "slowly varying error of the fixes: measured minus true", sigma="fix_wander_sigma",
                          time="fix_wander_time"),),
    ),
)  # fmt: skip
"""Its errors; what it states of its noise comes with every fix."""
LEVER_ARM, DELAY, *_, WANDER = TERMS
_TIMING, _COUNTERS = timing_rows("gnss"), timing_state("gnss")

GNSS_PARAMETERS = Table((
    _TIMING["gnss_interval"],
    _TIMING["gnss_latency"],
    Row("gnss_epoch_offset", "Time by which the epoch precedes the sample on which it is processed, below one sample", "s",
        lower=0.0, upper=1.0),
    replace(ARM, name="antenna_lever_arm_b"),
    *(row for term in TERMS for row in term.rows),
    Row("gnss_outlier_probability", "Probability that a position is an outlier", lower=0.0, upper=1.0),
    Row("gnss_outlier_size", "Length of an outlier's displacement, in a random direction", "m", lower=0.0),
    Row("gnss_has_velocity", "1 if the receiver measures velocity, 0 if not", start=1.0, lower=0.0, upper=1.0, flag=True),
    _TIMING["gnss_outage_start"],
    _TIMING["gnss_outage_end"],
))  # fmt: skip

FIX = Table((
    Row("gnss_valid", "1 on the one sample with which a fix arrives", lower=0.0, upper=1.0, flag=True),
    Row("gnss_age", "Time from the epoch of the latest fix to the end of that sample", "s", lower=-1.0, upper=10.0),
    *bounded_place_rows("gnss_", " of the antenna, latest fix"),
    Row("gnss_position_sigma", "Standard deviation of position that the receiver reports", "m", (3,), "n", 1.0, 1e-6, 1e9),
    Row("gnss_velocity_valid", "1 where gnss_valid is and the fix has a velocity", lower=0.0, upper=1.0, flag=True),
    Row("gnss_velocity_n", "Velocity relative to the Earth of the antenna, latest fix", "m/s", (3,), "n"),
    Row("gnss_velocity_sigma", "Standard deviation of velocity that the receiver reports", "m/s", (3,), "n", 1.0, 1e-6, 1e9),
))  # fmt: skip
"""A fix: outputs of a plant, and inputs of estimators, which have these bounds."""


@dataclass(frozen=True)
class GnssFixes:
    """Fixes of the antenna at their times of validity.

    time (m,) s, on the IMU's clock; latitude, longitude (m,) rad; height (m,) m above the ellipsoid.
    position_sigma (m, 3) m, N E D; velocity_n (m, 3) m/s and velocity_sigma (m, 3) m/s, or None. NaN: not stated.
    arrival, age (m,) s: when each fix arrived, and its age then; None: at its time of validity. Raises
    `InputError` for a standard deviation that no estimator takes: with 0 a fix would be exact.
    """

    time: Array
    latitude: Array
    longitude: Array
    height: Array
    position_sigma: Array
    velocity_n: Array | None = None
    velocity_sigma: Array | None = None
    arrival: Array | None = None
    age: Array | None = None

    def __post_init__(self) -> None:
        for name in ("position_sigma", "velocity_sigma"):
            sigma, row = getattr(self, name), FIX[f"gnss_{name}"]
            if sigma is None:
                continue
            bad = np.argwhere((sigma < row.lower) | (sigma > row.upper))
            if bad.size:
                at, axis = bad[0]
                raise InputError(
                    f"{name} of the fix at {clock(self.time[at], 10)} s, {'NED'[axis]}: {sigma[at, axis]:g} {row.unit}: "
                    f"allowed is from {row.lower:g} to {row.upper:g} {row.unit} ({len(bad)} such values)"
                )


_NAMES = ("latitude", "longitude", "height", "velocity_n")


def _value(term: Term) -> Row:
    assert term.value is not None
    return term.value


def _simulated(row: Row, **changes: Any) -> Row:
    """A row of a fix as the plant has it, whose bounds are not those of an estimator."""
    return replace(row, **changes) if row.flag else replace(row, lower=-math.inf, upper=math.inf, **changes)


GNSS_STATE = Table((
    *map(_simulated, FIX),
    *(_simulated(row, name=row.name.replace("gnss_", "gnss_pending_"), meaning=f"{row.meaning}; pending")
      for row in FIX if row.name.removeprefix("gnss_") in _NAMES),
    _COUNTERS["gnss_pending"],
    _value(WANDER),
    *(_COUNTERS[f"gnss_{name}"] for name in ("epochs", "counter", "due")),
    _value(LEVER_ARM),
    _value(DELAY),
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


COMMON = Row(
    "fix_common_sigma", "Error that the fixes have in common: part of the stated position sigma alone", "m", (3,), "n", lower=0,
    upper=1e6,
)  # fmt: skip
GNSS_STATED = Table((ARM, *(row for term in (LEVER_ARM, DELAY, WANDER) for row in term.stated), COMMON))
"""What is stated of a receiver to an estimator: the lever arm, and errors."""


def _stated_errors(rows: Mapping[str, Any]) -> dict[str, Any]:
    return {
        ARM.name: rows["antenna_lever_arm_b"],
        "antenna_lever_arm_sigma": np.hypot(rows["antenna_lever_arm_error"], rows["antenna_lever_arm_sigma"]),
        "gnss_delay_sigma": float(np.hypot(rows["gnss_delay_error"], rows["gnss_delay_sigma"])),
        "fix_wander_sigma": rows["gnss_wander_sigma"],
        "fix_wander_time": rows["gnss_wander_time"],
    }


def _stated(p: Values, x: Values) -> dict[str, Any]:
    """The standard deviations that the receiver reports."""
    position = ca.sqrt(p.gnss_position_noise**2 + p.gnss_wander_sigma**2)
    return {
        "gnss_position_sigma": maximum(position, SIGMA_FLOOR),
        "gnss_velocity_sigma": maximum(p.gnss_velocity_noise, SIGMA_FLOOR),
    }


_LATE, _CUT_OFF = timing_sources("gnss", "GNSS")
GNSS_ERRORS = (
    *sources_of(TERMS[2:]),
    ErrorSource("GNSS outliers", ("gnss_outlier_probability",)),
    replace(_LATE, rows=(*_LATE.rows, "gnss_epoch_offset")),
    *sources_of((DELAY, LEVER_ARM)),
    _CUT_OFF,
)

GNSS = Sensor(
    "gnss",
    gnss_part,
    outputs=FIX.names,
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
    return {**counted("gnss", "gnss_valid", p, x, x.gnss_latency_true), "gnss_velocity_valid": 0.0}


def _measure(p: Values, x: Values, r: Any, rate_eb_b: Any, rate_change_b: Any, acceleration_n: Any) -> dict[str, Any]:
    """The measurement at an epoch: antenna, errors, outages."""
    n = normals(r[0:10])
    tau = x.gnss_epoch_offset_true
    speed = ca.cross(rate_eb_b, x.antenna_lever_arm_true)
    velocity = x.velocity_n + rotate(x.q_nb, speed)
    bend = ca.cross(rate_change_b, x.antenna_lever_arm_true) + ca.cross(rate_eb_b, speed)
    acceleration = acceleration_n + rotate(x.q_nb, bend)
    offset = rotate(x.q_nb, x.antenna_lever_arm_true) - velocity * tau + acceleration * (0.5 * tau * tau)

    wander = gauss_markov(x.gnss_wander, p.gnss_wander_sigma, p.gnss_wander_time, p.gnss_interval, n[3:6])
    outlier = (r[10] < p.gnss_outlier_probability) * p.gnss_outlier_size * direction(r[11], r[12])
    latitude, longitude, height = geodetic_from_ned_offset(
        offset + p.gnss_position_noise * n[0:3] + wander + outlier, x.latitude, x.longitude, x.height
    )

    epochs = x.gnss_epochs + 1.0
    fix = lost_epoch("gnss", p, epochs * p.gnss_interval - tau) == 0.0
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


# The grades, with the keys of the errors that they have: standard deviations north, east, down.

FIGURES = {
    "position_noise_m": Figure("gnss_position_noise", "m", vector=True),
    "velocity_noise_mps": Figure("gnss_velocity_noise", "m/s", vector=True),
    "wander_sigma_m": Figure("gnss_wander_sigma", "m", vector=True),
    "wander_time_s": Figure("gnss_wander_time", "s"),
}


def _grade(name: str, title: str, source: str, position: Sequence[float], velocity: Sequence[float], **more: Any) -> Grade:
    return Grade.of(name, title, source, position_noise_m=tuple(position), velocity_noise_mps=tuple(velocity), **more)


def _single_point(name: str, title: str, cep: float) -> Grade:
    """A receiver of this CEP (m), with half of the variance white and half correlated."""
    horizontal = one_sigma_from_cep(cep) / 2.0**0.5
    # 95 % bounds: 13 m down, 1.960 sigma of one axis; 8 m horizontally, 2.448 sigma of each of two
    down = horizontal * (13.0 / 1.960) / (8.0 / 2.448)
    source = (
        f"Typical of u-blox M8, data sheet: {cep} m CEP, 0.05 m/s (50 %); down by the ratio of the 95 % "
        "bounds of the GPS SPS Performance Standard 2020 (13 m, 8 m); insenv's choice: half of the variance "
        "white, half correlated over 60 s"
    )
    position, velocity = (horizontal, horizontal, down), (one_sigma_from_r50(0.05),) * 3
    return _grade(name, title, source, position, velocity, wander_sigma_m=position, wander_time_s=60.0)


GNSS_GRADES = by_name(
    Grade("perfect", "No errors"),
    _single_point("spp", "Single-point positioning", 2.5),
    _single_point("sbas", "Single-point positioning with SBAS corrections", 2.0),
    _grade(
        "rtk",
        "Real-time kinematic, fixed ambiguities",
        "Typical of u-blox ZED-F9P, data sheet: 0.01 m CEP horizontally, 0.01 m R50 vertically (+ 1 ppm of the "
        "baseline, not modelled), 0.05 m/s (50 %)",
        (one_sigma_from_cep(0.01), one_sigma_from_cep(0.01), one_sigma_from_r50(0.01)),
        (one_sigma_from_r50(0.05),) * 3,
    ),
    _grade(
        "centimetre",
        "Post-processed carrier phase, as in the airborne paper",
        "Airborne navigation paper: centimetre grade; insenv's choice: 1, 1, 2 cm, as the RTK (1-2 cm) of "
        "KF-GINS's data, and 1 cm/s",
        (0.01, 0.01, 0.02),
        (0.01, 0.01, 0.01),
    ),
)
"""GNSS grades by name."""


def gnss_grade(name: str) -> Grade:
    """The GNSS grade of that name; raises `InputError`, naming the nearest, if there is none."""
    return find_grade(name, GNSS_GRADES, "GNSS grade")


# The section [gnss] of a scenario: a grade of the catalogue, values that replace its own, times, outages.

_ZERO = (0.0, 0.0, 0.0)
SHOWN_SIGMAS = 3.0
"""Drawn delays that are cut are worth a note if the range ends within so many sigmas of the mean."""
ROUNDING_S = 1e-9
"""Rounding of a delay at the end of its range."""
_DELAYS_CUT = declared(
    "delays-cut",
    "gnss.delay_sigma_s = {sigma:g} s: drawn delays are limited to {least:g} to {most:g} s: a fix cannot come "
    "from the future, and only one at a time can be under way",
)


_FIGURES = figures_section("GnssFigures", GNSS_PARAMETERS, GNSS_GRADES, FIGURES, "spp", "docs/sensors.md")


class GnssSection(_FIGURES, TimedSection):  # type: ignore[misc, valid-type]
    """The GNSS receiver."""

    sensor: ClassVar[Sensor] = GNSS

    epoch_offset_s: Number = key(
        0.0, "time from the epoch of a fix to its sample, below one sample", "s", row=GNSS_PARAMETERS["gnss_epoch_offset"]
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
        "s", row=GNSS_PARAMETERS["gnss_delay_error"],
    )  # fmt: skip
    delay_sigma_s: Number = key(
        0.0, "that time, 1 sigma of a part drawn at the start", "s", row=GNSS_PARAMETERS["gnss_delay_sigma"]
    )
    velocity: bool = key(True, "whether fixes contain a velocity", row="gnss_has_velocity", strict=True)
    outlier_probability: Number = key(
        0.0, "probability that a position is an outlier", row=GNSS_PARAMETERS["gnss_outlier_probability"]
    )
    outlier_size_m: Number = key(0.0, "length of an outlier", "m", row="gnss_outlier_size", ge=0, le=1e7)

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
        return {**timing, **self.error_rows()}
