"""Inertial unit and GNSS receiver on a given truth, and bounds that chance exceeds about once in 10^5."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from scipy.stats import chi2

from insenv.core import noise
from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.sensors.gnss import GNSS_STATE, gnss_part
from insenv.sensors.imu import imu_part
from insenv.sensors.imu_tables import IMU_STATE

CHANCE = 1e-5
TRUTH = {
    "true_delta_angle": (3,),
    "true_delta_velocity": (3,),
    "latitude": (),
    "longitude": (),
    "height": (),
    "velocity_n": (3,),
    "acceleration_n": (3,),
    "q_nb": (4,),
    "rate_eb_b": (3,),
    "rate_change_b": (3,),
}
LEVEL = {"latitude": 0.7, "longitude": 1.9, "height": 50.0, "q_nb": (1.0, 0.0, 0.0, 0.0)}


@cache
def plant() -> Model:
    """The two sensors with the truth as inputs, which have the same names after `set_`."""
    given = Part(
        parameters=Table((SEED, Row("sample_interval", "Length of a sample", "s", start=0.005))),
        state=Table((STEP, *(Row(name, name, shape=shape) for name, shape in TRUTH.items()))),
        inputs=Table(tuple(Row(f"set_{name}", name, shape=shape) for name, shape in TRUTH.items())),
        steps={"sample": Step(lambda p, x, u: {name: getattr(u, f"set_{name}") for name in TRUTH})},
    )
    tick = Part(steps={"tick": Step(lambda p, x, u: {"step": x.step + 1})})
    outputs = IMU_STATE + GNSS_STATE
    parts = [given, imu_part(), gnss_part(lambda p, x: (x.rate_eb_b, x.rate_change_b, x.acceleration_n)), tick]
    return merge("sensors", "Sensors", parts, outputs, lambda p, x: {n: getattr(x, n) for n in outputs.names})


def simulate(n: int, parameters: dict[str, Any], truth: dict[str, Any] | None = None, backend: str | None = None):
    """Simulate n samples; truth by row name, constant or with a leading axis of n. Returns outputs by row name, (n, ...)."""
    model = plant()
    rows = {"gnss_interval": 1e9, **parameters}
    inputs = np.zeros((n, model.inputs.size))
    for name, value in {**LEVEL, **(truth or {})}.items():
        value = np.asarray(value, dtype=float)
        inputs[:, model.inputs.slice(f"set_{name}")] = value.reshape(n, -1) if value.ndim > len(TRUTH[name]) else value
    outputs = make_runner(model, rows, backend).run(n, inputs)
    assert np.isfinite(outputs).all()
    return model.outputs.unpack(outputs)


def starts(parameters: dict[str, Any], seeds: int) -> dict[str, Any]:
    """Start states of many seeds by row name, (seeds, ...)."""
    model = plant()
    r = np.array([noise.uniforms(s, 0, noise.START_STREAM, model.start_uniforms) for s in range(seeds)])
    p = model.parameters.pack(parameters)
    return model.state.unpack(np.asarray(model.functions["start"](p[:, None], r.T)).T)


def assert_variance(samples: Any, variance: float, freedom: float | None = None) -> None:
    """Assert that the mean square of zero-mean samples is within chi-square bounds (`freedom`: by default all samples)."""
    samples = np.ravel(samples)
    freedom = freedom or samples.size
    ratio = float(np.mean(samples**2)) / variance
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], freedom) / freedom
    assert low < ratio < high, (ratio, low, high)


def assert_mean(samples: Any, mean: float, std: float) -> None:
    """Assert that the mean of independent samples is within 4.5 of its standard deviations."""
    samples = np.ravel(samples)
    assert abs(samples.mean() - mean) < 4.5 * std / math.sqrt(samples.size)
