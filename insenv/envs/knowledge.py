"""What a navigator is told before it starts, as rows of a model: constant through an episode, part of every observation."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Knowledge, SensorNotes
from insenv.scenario import Scenario, start_errors
from insenv.sensors.imu_tables import HUGE

Array = NDArray[np.float64]

TOLD = Table((
    Row("told_sample_interval", "Time from one inertial sample to the next", "s", lower=0.0, upper=1.0),
    Row("told_latitude", "Latitude of the start, as told: with longitude and height the reference of positions", "rad",
        lower=-pi / 2, upper=pi / 2),
    Row("told_longitude", "Longitude of the start, as told", "rad", lower=-2 * pi, upper=2 * pi),
    Row("told_height", "Height of the start above the ellipsoid, as told", "m", lower=-1e6, upper=1e6),
    Row("told_position_sigma", "Standard deviation told of that position", "m", (3,), "n", lower=0.0, upper=1e7),
    Row("told_velocity_n", "Velocity at the start, as told", "m/s", (3,), "n", lower=-1e4, upper=1e4),
    Row("told_velocity_sigma", "Standard deviation told of that velocity", "m/s", (3,), "n", lower=0.0, upper=1e4),
    Row("told_attitude", "Roll, pitch, heading at the start, as told", "rad", (3,), "n", lower=-1e3, upper=1e3),
    Row("told_tilt_sigma", "Standard deviation told of roll and pitch", "rad", lower=0.0, upper=4 * pi),
    Row("told_heading_sigma", "Standard deviation told of the heading", "rad", lower=0.0, upper=4 * pi),
    Row("told_antenna_lever_arm", "From the inertial unit to the antenna", "m", (3,), "b", lower=-1e3, upper=1e3),
    Row("told_angle_random_walk", "Gyro white noise, of the data sheet", "rad/sqrt(s)", lower=0.0, upper=1e3),
    Row("told_velocity_random_walk", "Accelerometer white noise, of the data sheet", "m/s/sqrt(s)", lower=0.0, upper=1e3),
    Row("told_gyro_bias_sigma", "Gyro bias, 1 sigma, of the data sheet", "rad/s", lower=0.0, upper=1e3),
    Row("told_accel_bias_sigma", "Accelerometer bias, 1 sigma, of the data sheet", "m/s^2", lower=0.0, upper=1e4),
    Row("told_gyro_correlation_time", "Correlation time of the gyro bias", "s", lower=0.0, upper=HUGE),
    Row("told_accel_correlation_time", "Correlation time of the accelerometer bias", "s", lower=0.0, upper=HUGE),
))  # fmt: skip


def told_rows(
    scenario: Scenario, parameters: Mapping[str, Array], state: Mapping[str, Array], notes: list[SensorNotes]
) -> Array:
    """Values of `TOLD` for episodes at their start, (k, TOLD.size).

    parameters, state: rows of the plant by name, the first axis being the episodes; notes: the data sheet of each.  The
    errors of what is told are those that `insenv.scenario.build` draws for the same seeds.
    """
    section = scenario.knowledge
    error = np.array([start_errors(section, int(seed)) for seed in parameters["seed"].ravel()])
    place = (state[name].ravel() for name in ("latitude", "longitude", "height"))
    latitude, longitude, height = geodesy.numeric.geodetic_from_ned_offset(error[:, 3:6], *place)
    sheets = np.array([
        (n.angle_random_walk, n.velocity_random_walk, n.gyro_bias_sigma, n.accel_bias_sigma, n.gyro_correlation_time,
         n.accel_correlation_time) for n in notes
    ])  # fmt: skip
    k = len(error)
    lever_arm = parameters["antenna_lever_arm_b"] if "antenna_lever_arm_b" in parameters else np.zeros((k, 3))
    columns = (
        parameters["sample_interval"].reshape(k, 1),
        np.stack([latitude, longitude, height], axis=1),
        np.tile(np.broadcast_to(section.position_sigma_m, 3), (k, 1)),
        state["velocity_n"] + error[:, 6:9],
        np.tile(np.broadcast_to(section.velocity_sigma_mps, 3), (k, 1)),
        np.stack(attitude.numeric.to_euler(state["q_nb"]), axis=1) + error[:, 0:3],
        np.tile(np.radians([section.tilt_sigma_deg, section.heading_sigma_deg]), (k, 1)),
        lever_arm,
        np.broadcast_to(sheets, (k, sheets.shape[1])),
    )
    return np.concatenate(columns, axis=1)


def knowledge_of(told: Mapping[str, Any]) -> Knowledge:
    """What an estimator's `prepare` takes, from the rows of `TOLD` by name (one episode's; others are passed over)."""
    roll, pitch, heading = (float(angle) for angle in told["told_attitude"])
    plain: dict[str, Any] = {name: float(told[f"told_{name}"]) for name in _NUMBERS}
    plain |= {name: np.array(told[f"told_{name}"]) for name in _VECTORS}
    sheet = SensorNotes(**{name: float(told[f"told_{name}"]) for name in _SHEET})
    return Knowledge(**plain, roll=roll, pitch=pitch, heading=heading, sensors=sheet)


_NUMBERS = ("sample_interval", "latitude", "longitude", "height", "tilt_sigma", "heading_sigma")
_VECTORS = ("position_sigma", "velocity_n", "velocity_sigma", "antenna_lever_arm")
_SHEET = (
    "angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma", "gyro_correlation_time",
    "accel_correlation_time",
)  # fmt: skip
