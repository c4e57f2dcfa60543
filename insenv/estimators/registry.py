"""The registry of estimators by id, and what an estimator is told before it starts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np

from insenv.core.model import Model
from insenv.core.tables import Vector
from insenv.errors import InputError, nearest

_ZERO = np.zeros(3)


@dataclass(frozen=True)
class SensorNotes:
    """What a data sheet says of the inertial unit, SI: the numbers that an estimator is tuned by.

    angle_random_walk rad/s^0.5, velocity_random_walk m/s^1.5; gyro_bias_sigma rad/s, accel_bias_sigma m/s^2; correlation
    times s.
    """

    angle_random_walk: float = 1e-6
    velocity_random_walk: float = 1e-4
    gyro_bias_sigma: float = 1e-7
    accel_bias_sigma: float = 1e-3
    gyro_correlation_time: float = 3600.0
    accel_correlation_time: float = 3600.0


@dataclass(frozen=True)
class Knowledge:
    """What is known when an estimator starts, SI and radians: the place, and for a navigating one the start velocity and
    attitude.

    latitude, longitude (rad), height (m); velocity_n (3, m/s); roll, pitch, heading (rad): as told, not as true.
    *_sigma: how good they are (1 sigma).  gyro_bias (rad/s, b), accel_bias (m/s^2, b): as far as known.
    antenna_lever_arm: IMU to antenna, b, m.
    """

    latitude: float
    longitude: float
    height: float
    sample_interval: float
    velocity_n: Vector = field(default_factory=lambda: _ZERO)
    roll: float = 0.0
    pitch: float = 0.0
    heading: float = 0.0
    position_sigma: Vector = field(default_factory=lambda: np.full(3, 1.0))
    velocity_sigma: Vector = field(default_factory=lambda: np.full(3, 0.1))
    tilt_sigma: float = 0.01
    heading_sigma: float = 0.1
    gyro_bias: Vector = field(default_factory=lambda: _ZERO)
    accel_bias: Vector = field(default_factory=lambda: _ZERO)
    antenna_lever_arm: Vector = field(default_factory=lambda: _ZERO)
    sensors: SensorNotes = SensorNotes()


@dataclass(frozen=True)
class Estimator:
    """A registered estimator.

    model: its equations.  kind: "alignment" (attitude of a vehicle that stays in place) or "navigation" (position and
    velocity too). aided: whether it takes GNSS fixes. prepare: its parameters, by row name, from what is known.
    read_file: rows by name from the file that its tuning key `file` names, for one that has learnt; None: it takes no file.
    smooths: id of the filter whose whole run `insenv.runs.smoothed` goes back over to give this one's results, or empty: the
    model's own outputs are the results. It is tuned as that filter is, with its own tuning on top.
    """

    model: Model
    kind: str
    aided: bool
    prepare: Callable[[Knowledge], Mapping[str, Any]]
    smooths: str = ""
    read_file: Callable[[str], Mapping[str, Any]] | None = None

    @property
    def id(self) -> str:
        """The name it is asked for by."""
        return self.model.id


def get(id: str) -> Estimator:
    """The estimator registered as `id`.  Raises `InputError` with the nearest name."""
    known = registered()
    if id not in known:
        raise InputError(f"no estimator {id!r}{nearest(id, known)}")
    return known[id]


MODULES = (
    "analytic",
    "ecef_kf",
    "q_method",
    "inertial_fir",
    "gyrocompass",
    "qakf",
    "wander_sins",
    "wander_sins_plain",
    "loosely_coupled",
    "aqe_ekf",
    "aqe_sukf",
    "lssvm",
    "smoother",
)
"""The modules of this package that define an `ESTIMATOR` (or several, `ESTIMATORS`), in the order of listings."""


@functools.cache
def registered() -> dict[str, Estimator]:
    """All estimators by id."""
    found: list[Estimator] = []
    for name in MODULES:
        module = import_module(f"insenv.estimators.{name}")
        found += getattr(module, "ESTIMATORS", None) or [module.ESTIMATOR]
    return {estimator.id: estimator for estimator in found}
