"""The error limits of an episode: the errors that the sensors leave, whatever the method."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from insenv import estimators, geodesy
from insenv.core.runner import make_runner
from insenv.envs.task import Task
from insenv.estimators import SensorNotes
from insenv.evaluation.limits import closed_forms as limits
from insenv.plant.feeding import input_rows
from insenv.scenario import Scenario, build, load

Array = NDArray[np.float64]

LONGEST = 600.0
"""Longest time over which the filter's covariance is averaged, s."""
RECORD_INTERVAL = 1.0
"""Time between covariances that are averaged, s."""


def episode_limits(
    task: Task, scenario: Scenario, rows: Mapping[str, Array], notes: list[SensorNotes], duration: float
) -> Array:
    """Return the 1-sigma limits of the error components of k episodes, (k, components).

    rows: plant parameters by name, with the episodes along the first axis.  notes: the data sheet of each episode.
    duration: of an episode, s.  Alignment: the tilts and heading (rad, rotation about n) that biases of 1 sigma and
    white noise over `duration` leave, see `insenv.evaluation.limits`.  Navigation: `navigation_limit`, the same for all
    episodes.
    """
    if task.model.parameters["limit"].size > 3:
        return np.tile(navigation_limit(scenario.model_dump_json(), duration), (len(notes), 1))
    found = np.empty((len(notes), 3))
    for row, sheet in enumerate(notes):
        latitude, height = float(rows["start_latitude"][row]), float(rows["start_height"][row])
        g = float(geodesy.numeric.normal_gravity(np.sin(latitude), height))
        tilt = sheet.accel_bias_sigma / g
        heading = np.hypot(tilt * np.tan(latitude), sheet.gyro_bias_sigma / (geodesy.OMEGA_IE * np.cos(latitude)))
        noise = limits.noise_tilts(sheet.angle_random_walk, sheet.velocity_random_walk, latitude, height, duration)
        found[row] = np.hypot([tilt, tilt, heading], noise)
    return found


@lru_cache(maxsize=32)
def navigation_limit(scenario_json: str, duration: float) -> Array:
    """Return the root mean square over time of the 15-state filter's stated sigmas in a scenario, (9,).

    The components are attitude (rad, rotation about n), velocity (m/s) and position (m).  The position limit includes
    the part of the fix error that changes too slowly to be averaged.  The values come from one run with the scenario's
    seed over at most `LONGEST` seconds: the covariance depends on the motion and hardly on the noise.
    """
    scenario = load(json.loads(scenario_json))
    plant = build(scenario, duration_s=min(duration, LONGEST))
    estimator = estimators.get("loosely-coupled")
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns = {**shown, "dt": np.full(plant.samples, plant.sample_interval)}
    every = max(1, round(RECORD_INTERVAL / plant.sample_interval))
    outputs = make_runner(estimator.model, plant.parameters_of(estimator)).run(
        plant.samples, input_rows(estimator.model, columns, plant.samples), min(every, plant.samples)
    )
    rows = estimator.model.outputs.unpack(outputs)
    names = ("attitude_sigma", "velocity_sigma", "position_sigma")
    sigma = np.sqrt(np.mean(np.concatenate([rows[name] for name in names], axis=1) ** 2, axis=0))
    sigma[6:9] = np.hypot(sigma[6:9], np.asarray(plant.parameters["gnss_wander_sigma"], dtype=float))
    return sigma
