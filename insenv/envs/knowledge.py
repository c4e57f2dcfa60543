"""The initial knowledge as rows of a model: constant during an episode, and part of every observation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Knowledge, SensorNotes
from insenv.geodesy.rows import bounded_place_rows
from insenv.scenario import Scenario, reported_attitude, start_errors
from insenv.sensors.imu_tables import HUGE

Array = NDArray[np.float64]

KNOWN = Table((
    Row("known_sample_interval", "Time between inertial samples", "s", lower=0.0, upper=1.0),
    *bounded_place_rows("known_", " of the start as reported, the reference of positions"),
    Row("known_position_sigma", "Reported standard deviation of that position", "m", (3,), "n", lower=0.0, upper=1e7),
    Row("known_velocity_n", "Reported velocity at the start", "m/s", (3,), "n", lower=-1e4, upper=1e4),
    Row("known_velocity_sigma", "Reported standard deviation of that velocity", "m/s", (3,), "n", lower=0.0, upper=1e4),
    Row("known_attitude", "Reported roll, pitch and heading at the start", "rad", (3,), "n", lower=-1e3, upper=1e3),
    Row("known_tilt_sigma", "Reported standard deviation of roll and pitch", "rad", lower=0.0, upper=4 * pi),
    Row("known_heading_sigma", "Reported standard deviation of the heading", "rad", lower=0.0, upper=4 * pi),
    Row("known_antenna_lever_arm", "From the inertial unit to the antenna", "m", (3,), "b", lower=-1e3, upper=1e3),
    Row("known_angle_random_walk", "Gyro white noise, from the data sheet", "rad/s^0.5", lower=0.0, upper=1e3),
    Row("known_velocity_random_walk", "Accelerometer white noise, from the data sheet", "m/s^1.5", lower=0.0, upper=1e3),
    Row("known_gyro_bias_sigma", "Gyro bias, 1 sigma, from the data sheet", "rad/s", lower=0.0, upper=1e3),
    Row("known_accel_bias_sigma", "Accelerometer bias, 1 sigma, from the data sheet", "m/s^2", lower=0.0, upper=1e4),
    Row("known_gyro_correlation_time", "Correlation time of the gyro bias", "s", lower=0.0, upper=HUGE),
    Row("known_accel_correlation_time", "Correlation time of the accelerometer bias", "s", lower=0.0, upper=HUGE),
))  # fmt: skip
"""Rows of the initial knowledge."""


def known_rows(
    scenario: Scenario, parameters: Mapping[str, Array], state: Mapping[str, Array], notes: list[SensorNotes]
) -> Array:
    """Return the values of `KNOWN` for k episodes at their start, (k, KNOWN.size).

    parameters, state: rows of the plant by name, with the episodes along the first axis.  notes: the data sheet of each
    episode.  The initial errors are those that `insenv.scenario.build` draws for the same seeds.
    """
    section = scenario.knowledge
    error = np.array([start_errors(section, int(seed)) for seed in parameters["seed"].ravel()])
    place = (state[name].ravel() for name in ("latitude", "longitude", "height"))
    latitude, longitude, height = geodesy.numeric.geodetic_from_ned_offset(error[:, 3:6], *place)
    sheets = np.array([[getattr(sheet, name) for name in _SHEET] for sheet in notes])
    k = len(error)
    lever_arm = parameters["antenna_lever_arm_b"] if "antenna_lever_arm_b" in parameters else np.zeros((k, 3))
    columns = (
        parameters["sample_interval"].reshape(k, 1),
        np.stack([latitude, longitude, height], axis=1),
        np.tile(np.broadcast_to(section.position_sigma_m, 3), (k, 1)),
        state["velocity_n"] + error[:, 6:9],
        np.tile(np.broadcast_to(section.velocity_sigma_mps, 3), (k, 1)),
        reported_attitude(np.stack(attitude.numeric.to_euler(state["q_nb"]), axis=1), error[:, 0:3]),
        np.tile(np.radians([section.tilt_sigma_deg, section.heading_sigma_deg]), (k, 1)),
        lever_arm,
        np.broadcast_to(sheets, (k, sheets.shape[1])),
    )
    return np.concatenate(columns, axis=1)


def knowledge_of(known: Mapping[str, Any], instruments: Mapping[str, Any] | None = None) -> Knowledge:
    """Return the `Knowledge` in the rows of `KNOWN` of one episode, by name; other rows are ignored.

    instruments: what is told of the aiding instruments (`Knowledge.instruments`), which is the same in all episodes.
    """
    values = {row.name.removeprefix("known_"): known[row.name] for row in KNOWN}
    values = {name: np.array(value) if np.ndim(value) else float(value) for name, value in values.items()}
    roll, pitch, heading = (float(angle) for angle in values.pop("attitude"))
    sheet = SensorNotes(**{name: values.pop(name) for name in _SHEET})
    return Knowledge(**values, roll=roll, pitch=pitch, heading=heading, sensors=sheet, instruments=instruments or {})


_SHEET = tuple(field.name for field in fields(SensorNotes))
