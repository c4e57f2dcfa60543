"""The section [gnss] of a scenario: a grade of the catalogue, values that replace its own, times, outages."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import field_validator

from insenv.base.errors import InputError
from insenv.base.toml import Number, key
from insenv.base.values import LeverArm, NotNegative, one_of
from insenv.sensors.catalogue import GNSS_GRADES, gnss_grade
from insenv.sensors.contract import Sensor
from insenv.sensors.figures import TimedSection
from insenv.sensors.gnss import GNSS

_ZERO = (0.0, 0.0, 0.0)
SHOWN_SIGMAS = 3.0
"""Drawn delays that are cut are worth a note if the range ends within so many sigmas of the mean."""
ROUNDING_S = 1e-9
"""Rounding of a delay at the end of its range."""


class GnssSection(TimedSection):
    """The GNSS receiver."""

    sensor: ClassVar[Sensor] = GNSS

    grade: Annotated[str, one_of(GNSS_GRADES)] = key("spp", "grade of the catalogue (docs/sensors.md)")
    epoch_offset_s: Number = key(0.0, "time from the epoch of a fix to its sample, below one sample", "s", ge=0, le=1)
    lever_arm_m: LeverArm = key(_ZERO, "from the inertial unit to the antenna: forward, right, down", "m")
    lever_arm_error_m: LeverArm = key(_ZERO, "actual minus stated lever arm", "m")
    lever_arm_sigma_m: NotNegative = key(_ZERO, "actual minus stated lever arm, 1 sigma of a part drawn at the start", "m")
    delay_error_s: Number = key(
        0.0, "time by which a fix is older than its age says; latency and this from 0 to less than the interval",
        "s", ge=-3600, le=3600,
    )  # fmt: skip
    delay_sigma_s: Number = key(0.0, "that time, 1 sigma of a part drawn at the start", "s", ge=0, le=3600)
    velocity: bool = key(True, "whether fixes contain a velocity", strict=True)
    position_noise_m: NotNegative | None = key(None, "white noise of position (1 sigma, NED); the grade's if absent", "m")
    velocity_noise_mps: NotNegative | None = key(None, "white noise of velocity (1 sigma, NED); the grade's if absent", "m/s")
    wander_sigma_m: NotNegative | None = key(None, "correlated error of position (1 sigma, NED); the grade's if absent", "m")
    wander_time_s: Number | None = key(None, "correlation time of that error; the grade's if absent", "s", gt=0, le=1e9)
    outlier_probability: Number = key(0.0, "probability that a position is an outlier", "", ge=0, le=1)
    outlier_size_m: Number = key(0.0, "length of an outlier", "m", ge=0, le=1e7)

    @field_validator("grade")
    @classmethod
    def _known(cls, value: str) -> str:
        gnss_grade(value)
        return value

    @property
    def oldest_s(self) -> float:
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
        return (
            f"gnss.delay_sigma_s = {self.delay_sigma_s:g} s: drawn delays are cut to {least:g} to {most:g} s, because no fix "
            "is from the future and only one at a time is pending",
        )

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
        rows = gnss_grade(self.grade).parameters()
        for row, value in (
            ("gnss_position_noise", self.position_noise_m),
            ("gnss_velocity_noise", self.velocity_noise_mps),
            ("gnss_wander_sigma", self.wander_sigma_m),
            ("gnss_wander_time", self.wander_time_s),
        ):
            rows |= {} if value is None else {row: np.array(value)}
        return {
            **rows,
            **timing,
            "gnss_epoch_offset": self.epoch_offset_s,
            "antenna_lever_arm_b": np.array(self.lever_arm_m),
            "antenna_lever_arm_error": np.array(self.lever_arm_error_m),
            "antenna_lever_arm_sigma": np.array(self.lever_arm_sigma_m),
            "gnss_delay_error": self.delay_error_s,
            "gnss_delay_sigma": self.delay_sigma_s,
            "gnss_has_velocity": float(self.velocity),
            "gnss_outlier_probability": self.outlier_probability,
            "gnss_outlier_size": self.outlier_size_m,
        }
