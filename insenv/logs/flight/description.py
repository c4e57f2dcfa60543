"""The TOML file beside a flight log, for what the log does not hold: lever arm, start, tuning."""

from __future__ import annotations

from pydantic import field_validator, model_validator

from insenv.logs.description import EvaluationSection, InitialSection
from insenv.logs.fields import Number, Parameter, Section, Sigma3, Vector3, key
from insenv.sensors import imu_grade


class FlightDescription(Section):
    """A flight log and what is known besides."""

    flight: str = key(
        ..., "the log: .tlog, .BIN or .ulg, relative to this TOML file; .gz and one-file .zip are unpacked", min_length=1
    )
    title: str = key("", "one line for tables and figures; absent: the log's name")
    source: str = key("", "where the log comes from")
    licence: str = key("", "its licence, or that none is stated")
    start_s: Number | None = key(None, "use the log from this time on (its own clock)", "s")
    stop_s: Number | None = key(None, "use the log until this time", "s")
    imu: str = key("", 'the inertial unit, where the best is not wanted: "HIGHRES_IMU", "IMU[1]", "sensor_combined"')
    gnss: str = key("", 'the receiver, likewise: "GPS_RAW_INT", "GPS[1]"; "none": without GNSS')
    reference: str = key("", 'the solution to compare with, likewise: "ATTITUDE"; "none": nothing')
    grade: str = key("", "grade of the catalogue (docs/sensors.md) that estimators are tuned for")
    max_gap_s: Number = key(
        1.0, "a longer hole in the samples ends the stretch; shorter ones are bridged and counted", "s", ge=0, le=60
    )
    lever_arm_m: Vector3 = key((0.0, 0.0, 0.0), "from the IMU to the antenna: forward, right, down", "m")
    gnss_delay_s: Number = key(
        0.0, "taken off the fixes' times: how much later than valid the log stamps them", "s", ge=-5, le=5
    )
    position_sigma_m: Sigma3 | None = key(None, "standard deviations N, E, D of the fixes, instead of the log's", "m")
    velocity_sigma_mps: Sigma3 | None = key(None, "the same of their velocities", "m/s")
    undulation_m: Number | None = key(
        None, "height of the geoid over the ellipsoid, where the log has heights over the sea", "m"
    )
    initial: InitialSection = key(InitialSection(), "what is known at the start, as of any log")
    evaluation: EvaluationSection = key(EvaluationSection(), "where errors are taken, as of any log")
    estimator: dict[str, dict[str, Parameter]] = key({}, "parameters by estimator id, as of any log")

    @field_validator("grade")
    @classmethod
    def _grade(cls, value: str) -> str:
        if value:
            imu_grade(value)
        return value

    @model_validator(mode="after")
    def _window(self) -> FlightDescription:
        if self.start_s is not None and self.stop_s is not None and self.stop_s <= self.start_s:
            raise ValueError(f"stop_s = {self.stop_s} s must be after start_s = {self.start_s} s")
        return self
