"""The limits that errors in an environment are measured in: what the sensors leave, whatever the method."""

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
from insenv.evaluation import limits
from insenv.plant.feeding import input_rows
from insenv.scenario import Scenario, build, load

Array = NDArray[np.float64]

LONGEST = 600.0
"""s of a flight or drive that the filter's covariance is taken over, at most."""
RECORD_INTERVAL = 1.0


def limits_of(task: Task, scenario: Scenario, rows: Mapping[str, Array], notes: list[SensorNotes], duration: float) -> Array:
    """1-sigma limits of the error's components (k, components), for episodes with plant rows `rows` and data sheets `notes`.

    Alignment: tilts and heading (rad about n) that the biases (1 sigma) and the white noise over `duration` leave, see
    `insenv.evaluation.limits`.  Navigation: see `navigation_limit`; the same for all episodes.
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
    """What the covariance of the 15-state filter says on a scenario, root mean square over its time: attitude (rad about n),
    velocity (m/s) and position (m), (9,).

    To the position comes the part of the fixes' error that changes too slowly to be averaged.  Taken from one run with the
    scenario's seed, over at most `LONGEST` seconds: a covariance depends on the motion, hardly on the noise.
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
