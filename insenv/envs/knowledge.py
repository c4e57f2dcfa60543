"""The initial knowledge as rows of a model: constant during an episode, and part of every observation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import lru_cache
from math import pi
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.core.model import Model
from insenv.core.tables import Array, Row, Table
from insenv.estimators.knowledge import Knowledge
from insenv.scenario import reported_attitude, start_errors
from insenv.scenario.description import KnowledgeSection
from insenv.sensors.data_sheet import ImuDataSheet, motion_errors
from insenv.sensors.gnss import ARM
from insenv.sensors.imu_tables import HUGE

_FIELDS = {field.name for field in fields(ImuDataSheet)}

KNOWN = Table((
    Row("known_sample_interval", "Time between inertial samples", "s", lower=0.0, upper=1.0),
    *geodesy.bounded_place_rows("known_", " of the start as reported, the reference of positions"),
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
    Row("known_bare_gyro_bias_sigma", "Gyro bias without what gravity makes of the g-sensitivity, 1 sigma", "rad/s",
        lower=0.0, upper=1e3),
    Row("known_bare_accel_bias_sigma", "Accelerometer bias without what gravity makes of scale factors, 1 sigma",
        "m/s^2", lower=0.0, upper=1e4),
    Row("known_bare_gyro_correlation_time", "Its correlation time", "s", lower=0.0, upper=HUGE),
    Row("known_bare_accel_correlation_time", "Its correlation time", "s", lower=0.0, upper=HUGE),
    Row("known_gyro_scale_sigma", "Gyro scale factor, 1 sigma, from the data sheet", "1", lower=0.0, upper=10.0),
    Row("known_accel_scale_sigma", "Accelerometer scale factor, 1 sigma, from the data sheet", "1", lower=0.0, upper=10.0),
    Row("known_gyro_misalignment_sigma", "Gyro misalignment, 1 sigma, from the data sheet", "1", lower=0.0, upper=10.0),
    Row("known_accel_misalignment_sigma", "Accelerometer misalignment, 1 sigma, data sheet", "1", lower=0.0, upper=10.0),
    Row("known_gyro_g_sensitivity_sigma", "Gyro g-sensitivity, 1 sigma, from the data sheet", "rad s/m", lower=0.0, upper=10.0),
))  # fmt: skip
"""Rows of the initial knowledge."""


def known_rows(section: KnowledgeSection, model: Model, p: Array, x: Array, sheets: Mapping[str, Array]) -> Array:
    """Return the values of `KNOWN` for k episodes at their start, (k, KNOWN.size).

    section: of the scenario.  model: of a plant.
    p (k, parameters), x (k, state): its vectors.  sheets: the data sheets of the episodes, (k,) or (1,)
    by field of `ImuDataSheet`.  The initial errors are those that `insenv.scenario.build` draws for the same seeds.
    """
    parameters, state = model.parameters.slice, model.state.slice
    error = start_errors(section, p[:, parameters("seed").start])
    place = (x[:, state(name).start] for name in ("latitude", "longitude", "height"))
    at = geodesy.numeric.geodetic_from_ned_offset(error[:, 3:6], *place)
    attitude_n = np.stack(attitude.numeric.to_euler(x[:, state("q_nb")]), axis=1)
    vectors = np.tile(_reported(section), (len(error), 1))
    vectors[:, _PLACES["sample_interval"]] = p[:, parameters("sample_interval")]
    for name, value in zip(("latitude", "longitude", "height"), at, strict=True):
        vectors[:, _PLACES[name].start] = value
    vectors[:, _PLACES["velocity_n"]] = x[:, state("velocity_n")] + error[:, 6:9]
    vectors[:, _PLACES["attitude"]] = reported_attitude(attitude_n, error[:, 0:3])
    if "antenna_lever_arm_b" in model.parameters:
        vectors[:, _PLACES["antenna_lever_arm"]] = p[:, parameters("antenna_lever_arm_b")]
    for name in _SHEET:
        vectors[:, _PLACES[name].start] = sheets[name]
    return vectors


@lru_cache(maxsize=64)
def _reported(section: KnowledgeSection) -> Array:
    """Return the values of `KNOWN` (KNOWN.size,) with the standard deviations that a section reports; others are 0."""
    vector = np.zeros(KNOWN.size)
    for name, value in section.sigmas.items():
        vector[_PLACES[name]] = value
    return vector


def knowledge_of(known: Mapping[str, Any], same: Knowledge | None = None) -> Knowledge:
    """Return the `Knowledge` in the rows of `KNOWN` of one episode, by name; other rows are ignored.

    same: of the scenario, whose other fields are those of all episodes: errors of the instruments, and what else the data sheet
    of the unit says.
    """
    values: dict[str, Any] = {
        name: np.array(value) if np.ndim(value) else float(value) for name, value in fields_known(known).items()
    }
    values["sensors"] = replace(same.sensors if same else ImuDataSheet(), **{name: values.pop(name) for name in _SHEET})
    values["instruments"] = {**(same.instruments if same else {}), ARM.name: values.pop(ARM.name)}
    return Knowledge(**values) if same is None else replace(same, **values)


def fields_known(known: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the rows of `KNOWN`, (...) or (..., 3), by the names of the fields of `Knowledge`."""
    values = {row.name.removeprefix("known_"): known[row.name] for row in KNOWN}
    angles = np.asarray(values.pop("attitude"))
    values |= {name: angles[..., k] for k, name in enumerate(("roll", "pitch", "heading"))}
    return values | motion_errors(values)


_SHEET = tuple(row.name.removeprefix("known_") for row in KNOWN if row.name.removeprefix("known_") in _FIELDS)
"""Fields of `ImuDataSheet`, in the order of `KNOWN`."""
_PLACES = {row.name.removeprefix("known_"): KNOWN.slice(row.name) for row in KNOWN}

KNOWN_FIELDS = frozenset(fields_known(KNOWN.unpack(np.zeros(KNOWN.size))))
"""Fields of `Knowledge` and `ImuDataSheet` that `KNOWN` tells."""
