"""The TOML file of a scenario: its sections, keys, units and limits (pydantic)."""

from __future__ import annotations

import re
from typing import Annotated, Any

import numpy as np
from pydantic import PrivateAttr, Strict, field_validator, model_validator

from insenv.errors import InputError
from insenv.files.toml import Number, Parameter, Section, Vector3, key
from insenv.scenario.imu import ImuSection
from insenv.scenario.values import LeverArm, NotNegative, Sigmas, Window, one_of, within
from insenv.scenario.vehicles import VehicleSection
from insenv.sensors import GNSS_GRADES, check_timing, gnss_grade
from insenv.sensors.gnss import OUTAGES

MAX_DURATION_S = 86400.0
MAX_SEED = 2**53
_ZERO = (0.0, 0.0, 0.0)


class StartSection(Section):
    """Where the inertial unit is at time 0, and how the vehicle stands."""

    latitude_deg: Number = key(..., "geodetic latitude", "deg", ge=-89.999, le=89.999)
    longitude_deg: Number = key(..., "longitude, east positive", "deg", ge=-360, le=360)
    height_m: Number = key(0.0, "height above the WGS-84 ellipsoid", "m", ge=-1e4, le=1e5)
    heading_deg: Number = key(0.0, "heading, clockwise from north; of a swaying ship the mean", "deg", ge=-360, le=360)
    roll_deg: Number = key(0.0, "mean roll, right side down positive", "deg", ge=-28, le=28)
    pitch_deg: Number = key(0.0, "mean pitch, nose up positive", "deg", ge=-28, le=28)


class GnssSection(Section):
    """The GNSS receiver; without this section there is none."""

    grade: Annotated[str, one_of(GNSS_GRADES)] = key("spp", "grade of the catalogue (docs/sensors.md)")
    interval_s: Number = key(1.0, "time between fixes, a whole number of samples", "s", gt=0, le=3600)
    latency_s: Number = key(0.0, "how late a fix comes, a whole number of samples, below the interval", "s", ge=0, le=3600)
    epoch_offset_s: Number = key(0.0, "time by which the epoch precedes its sample, below one sample", "s", ge=0, le=1)
    lever_arm_m: LeverArm = key(_ZERO, "from the inertial unit to the antenna, forward, right, down", "m")
    velocity: bool = key(True, "whether fixes have a velocity", strict=True)
    position_noise_m: NotNegative | None = key(None, "white noise of position, north, east, down; the grade's if absent", "m")
    velocity_noise_mps: NotNegative | None = key(None, "white noise of velocity, likewise", "m/s")
    wander_sigma_m: NotNegative | None = key(None, "correlated error of position, standard deviation, likewise", "m")
    wander_time_s: Number | None = key(None, "its correlation time; the grade's if absent", "s", gt=0, le=1e9)
    outages_s: tuple[Window, ...] = key((), "times without fixes, pairs of begin and end", "s", max_length=OUTAGES)
    outlier_probability: Number = key(0.0, "probability that a position is an outlier", "", ge=0, le=1)
    outlier_size_m: Number = key(0.0, "length of an outlier", "m", ge=0, le=1e7)

    @field_validator("grade")
    @classmethod
    def _known(cls, value: str) -> str:
        gnss_grade(value)
        return value

    @field_validator("outages_s")
    @classmethod
    def _windows(cls, value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for begin, end in value:
            if not 0.0 <= begin < end:
                raise ValueError(f"the outage from {begin:g} s to {end:g} s must begin at 0 or later and end after it begins")
        return value

    def rows(self, sample_interval: float) -> dict[str, Any]:
        """Parameter rows, SI. Raises `InputError` for times that do not go together with the samples."""
        try:
            check_timing(sample_interval, self.interval_s, self.latency_s, self.epoch_offset_s)
        except InputError as error:
            raise InputError(re.sub(r"gnss_(interval|latency|epoch_offset)", r"gnss.\1_s", str(error))) from None
        rows = gnss_grade(self.grade).parameters()
        for row, value in (
            ("gnss_position_noise", self.position_noise_m),
            ("gnss_velocity_noise", self.velocity_noise_mps),
            ("gnss_wander_sigma", self.wander_sigma_m),
            ("gnss_wander_time", self.wander_time_s),
        ):
            rows |= {} if value is None else {row: np.array(value)}
        windows = np.zeros((2, OUTAGES))
        windows[:, : len(self.outages_s)] = np.array(self.outages_s).reshape(-1, 2).T
        return rows | {
            "gnss_interval": self.interval_s,
            "gnss_latency": self.latency_s,
            "gnss_epoch_offset": self.epoch_offset_s,
            "antenna_lever_arm_b": np.array(self.lever_arm_m),
            "gnss_has_velocity": float(self.velocity),
            "gnss_outage_start": windows[0],
            "gnss_outage_end": windows[1],
            "gnss_outlier_probability": self.outlier_probability,
            "gnss_outlier_size": self.outlier_size_m,
        }


class KnowledgeSection(Section):
    """What the estimators are told of the start: wrong by the errors given, or by errors drawn with the sigmas."""

    draw_errors: bool = key(True, "draw the errors that are not given, from the seed; false: they are 0", strict=True)
    roll_error_deg: Number | None = key(None, "roll as told less the true one", "deg", ge=-360, le=360)
    pitch_error_deg: Number | None = key(None, "pitch as told less the true one", "deg", ge=-360, le=360)
    heading_error_deg: Number | None = key(None, "heading as told less the true one", "deg", ge=-360, le=360)
    position_error_m: Annotated[Vector3, within(-1e5, 1e5)] | None = key(
        None, "position as told less the true one, north, east, down", "m"
    )
    velocity_error_mps: Annotated[Vector3, within(-1e3, 1e3)] | None = key(
        None, "velocity as told less the true one, north, east, down", "m/s"
    )
    tilt_sigma_deg: Number = key(0.5, "standard deviation told of roll and pitch", "deg", gt=0, le=180)
    heading_sigma_deg: Number = key(2.0, "standard deviation told of the heading", "deg", gt=0, le=360)
    position_sigma_m: Sigmas = key((1.0, 1.0, 1.0), "standard deviation told of the position, north, east, down", "m")
    velocity_sigma_mps: Sigmas = key((0.1, 0.1, 0.1), "standard deviation told of the velocity, north, east, down", "m/s")


class Scenario(Section):
    """A vehicle, its sensors and what is told of the start: everything in a scenario file."""

    title: str = key(..., "one line for listings, tables and figures", min_length=1, max_length=120)
    description: str = key("", "what it is for and where its numbers come from")
    duration_s: Number = key(..., "how long it lasts", "s", gt=0, le=MAX_DURATION_S)
    rate_hz: Number = key(200.0, "inertial samples per second", "Hz", ge=1, le=1e4)
    seed: Annotated[int, Strict()] = key(0, "seed of everything random", "", ge=0, le=MAX_SEED)
    estimators: tuple[str, ...] = key((), "ids of the estimators that run unless others are asked for")
    start: StartSection = key(..., "the start")
    vehicle: VehicleSection = key(..., "the vehicle")
    imu: ImuSection = key(ImuSection(), "the inertial unit; absent: a perfect one")
    gnss: GnssSection | None = key(None, "the GNSS receiver; absent: none")
    knowledge: KnowledgeSection = key(KnowledgeSection(), "what estimators are told of the start")
    estimator: dict[str, dict[str, Parameter]] = key(
        {}, 'parameters by estimator id, e.g. [estimator."loosely-coupled"] arw_deg_sqrt_h = 0.3; see below'
    )
    _name: str = PrivateAttr("")

    @property
    def name(self) -> str:
        """The file's name without ``.toml``; empty if it comes from no file."""
        return self._name

    @model_validator(mode="after")
    def _a_sample(self) -> Scenario:
        if round(self.duration_s * self.rate_hz) < 1:
            raise ValueError(f"duration_s = {self.duration_s:g} s is shorter than one sample of {1 / self.rate_hz:g} s")
        return self
