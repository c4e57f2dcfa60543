"""The limits of an episode: the errors that no method can fall below (`insenv.evaluation.limits`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from insenv.core.model import Model
from insenv.core.tables import Table
from insenv.envs.task import Task
from insenv.evaluation.limits import Limit
from insenv.scenario import Scenario, limit_along, prior_of
from insenv.sensors.imu_tables import IMU_PARAMETERS

Array = NDArray[np.float64]

LONGEST = 600.0
"""Longest time over which the limit of a navigation is averaged, s."""
RECORD_INTERVAL = 1.0
"""Time between limits that are averaged, s."""
NODES, EDGE = 11, 0.002
"""Number of units, from the better to the worse grade, whose limits are computed, and how closely they lie at the ends, where
an error that one grade does not have sets in.  The limits of those in between are interpolated: within 3 % between a marine
and a tactical grade, within 10 % between a marine and an industrial one."""


def episode_limits(
    task: Task, plant: Model, scenario: Scenario, bases: tuple[Array, ...], duration: float
) -> Callable[[Array], Array]:
    """Return a function of the plant's parameters of k episodes (k, parameters) that returns the 1-sigma limits of their
    error components, (k, components).

    bases: the plant's parameters, or those of the two grades between which units are drawn.  duration: of an episode, s.
    Alignment: attitude (rad, rotation about n) at the end.  Navigation: the root mean square over the episode of attitude
    (rad), velocity (m/s) and position (m).

    The trajectory, its heading and the mounting are those of the scenario: the limits of an alignment hardly depend on them.
    """
    navigates = task.model.parameters["limit"].size > 3
    samples = round((min(duration, LONGEST) if navigates else duration) * scenario.rate_hz)

    def limit(rows: Array) -> Array:
        found = limit_along(plant, rows, prior_of(scenario.knowledge), samples, scenario.vehicle.in_place)
        return _over_the_episode(found) if navigates else found.rotation[-1]

    from scipy.interpolate import PchipInterpolator

    if len(bases) == 1:
        same = limit(bases[0])
        return lambda vectors: np.tile(same, (len(vectors), 1))
    low, high = bases
    begin, end = _stretched(np.array([0.0, 1.0])).tolist()
    nodes = np.linspace(begin, end, NODES)
    odds = np.exp(nodes)
    fractions = np.clip((odds * (1 + EDGE) - EDGE) / (1 + odds), 0.0, 1.0)
    logarithms = np.log([limit(rows) for rows in between(low, high, fractions, plant.parameters)])
    level = PchipInterpolator(nodes, logarithms)
    fraction = _fraction_of(low, high, plant.parameters)
    return lambda vectors: np.exp(np.asarray(level(_stretched(fraction(vectors)))))


def _over_the_episode(found: Limit) -> Array:
    """Root mean square (9,) of the limits of attitude, velocity and position."""
    end = float(found.time[-1])
    times = np.arange(RECORD_INTERVAL, end + 1e-9, RECORD_INTERVAL) if end >= RECORD_INTERVAL else np.array([end])
    rotation = [np.sqrt(np.mean(np.interp(times, found.time, axis**2))) for axis in found.rotation.T]
    rms = found.rms(times)
    return np.array([*rotation, *(rms[name] for name in ("vn_mps", "ve_mps", "vd_mps", "north_m", "east_m", "down_m"))])


def _stretched(fractions: Array) -> Array:
    """Fractions of the way between two grades on a scale that is wide at both ends."""
    return np.log((fractions + EDGE) / (1.0 - fractions + EDGE))


def between(low: Array, high: Array, fractions: Array, parameters: Table) -> Array:
    """Interpolate the inertial figures of two grades: in the logarithm where both are positive, else linearly.

    low, high (parameters.size,): of the plant.  fractions (k,): of the way.  Returns (k, parameters.size), with all other
    parameters as in `low`.
    """
    found, fractions = np.tile(low, (len(fractions), 1)), np.asarray(fractions)[:, None]
    places = _figures(parameters)
    a, b = low[places], high[places]
    found[:, places] = a + (b - a) * fractions
    positive = places[(a > 0.0) & (b > 0.0)]
    found[:, positive] = low[positive] * (high[positive] / low[positive]) ** fractions
    return found


def _fraction_of(low: Array, high: Array, parameters: Table) -> Callable[[Array], Array]:
    """The function of parameters (k, parameters.size) that returns the fractions (k,) from which `between` made them."""
    places = _figures(parameters)
    a, b = low[places], high[places]
    telling = places[(a > 0.0) & (b > 0.0) & (a != b)]
    if not len(telling):
        return lambda vectors: np.zeros(len(vectors))
    start, whole = low[telling[0]], np.log(high[telling[0]] / low[telling[0]])
    return lambda vectors: np.log(vectors[:, telling[0]] / start) / whole


def _figures(parameters: Table) -> NDArray[np.intp]:
    """Places of the inertial figures in a plant's parameters."""
    parts = [parameters.slice(name) for name in IMU_PARAMETERS.names if name in parameters]
    return np.array([place for part in parts for place in range(part.start, part.stop)])
