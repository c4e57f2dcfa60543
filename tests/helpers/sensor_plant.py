"""Sensors on a given truth, and bounds that chance exceeds about once in 10^5."""

import math
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from insenv.core import noise
from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.sensors import registry
from insenv.sensors.gnss import GNSS_STATE, gnss_part
from insenv.sensors.imu import imu_part
from insenv.sensors.imu_tables import IMU_STATE
from insenv.sensors.sampled import Sampled

CHANCE = 1e-5
INSTRUMENTS = registry.instruments()
TRUTH = {
    "true_delta_angle": (3,), "true_delta_velocity": (3,), "latitude": (), "longitude": (), "height": (), "velocity_n": (3,),
    "acceleration_n": (3,), "q_nb": (4,), "rate_eb_b": (3,), "rate_change_b": (3,),
}  # fmt: skip
LEVEL = {"latitude": 0.7, "longitude": 1.9, "height": 50.0, "q_nb": (1.0, 0.0, 0.0, 0.0)}
DT = 0.01
"""Length of a sample, and time between measurements, of an instrument (s)."""


@cache
def plant(instrument: str = "") -> Model:
    """Inertial unit and receiver, or an instrument, with the truth as inputs named after `set_`."""
    place = [Row(f"start_{name}", name, start=LEVEL[name]) for name in ("latitude", "longitude", "height") if instrument]
    given = Part(
        parameters=Table((SEED, Row("sample_interval", "Length of a sample", "s", start=0.005), *place)),
        state=Table((STEP, *(Row(name, name, shape=shape) for name, shape in TRUTH.items()))),
        inputs=Table(tuple(Row(f"set_{name}", name, shape=shape) for name, shape in TRUTH.items())),
        steps={"sample": Step(lambda p, x, u: {name: getattr(u, f"set_{name}") for name in TRUTH})},
    )
    tick = Part(steps={"tick": Step(lambda p, x, u: {"step": x.step + 1})})
    outputs, parts = IMU_STATE + GNSS_STATE, [imu_part(), gnss_part(_instant)]
    if instrument:
        equations = Sampled(INSTRUMENTS[instrument])
        outputs, parts = equations.all_state, [equations.sensor().part(_instant)]
    return merge("sensors", "Sensors", [given, *parts, tick], outputs, lambda p, x: {n: getattr(x, n) for n in outputs.names})


def _instant(p: Any, x: Any) -> tuple[Any, Any, Any]:
    return x.rate_eb_b, x.rate_change_b, x.acceleration_n


def simulate(n: int, parameters: dict[str, Any], truth: dict[str, Any] | None = None, of: str = "") -> dict[str, Any]:
    """Simulate n samples; truth by row name, constant or with a leading axis of n. Returns outputs by row name, (n, ...).

    of: an instrument, which measures every sample of `DT`; by default inertial unit and receiver, which gives no fix.
    """
    model = plant(of)
    rows = {f"{of}_interval": DT, "sample_interval": DT} if of else {"gnss_interval": 1e9}
    inputs = np.zeros((n, model.inputs.size))
    for name, value in {**LEVEL, **(truth or {})}.items():
        value = np.asarray(value, dtype=float)
        inputs[:, model.inputs.slice(f"set_{name}")] = value.reshape(n, -1) if value.ndim > len(TRUTH[name]) else value
    outputs = make_runner(model, rows | parameters).run(n, inputs)
    assert np.isfinite(outputs).all()
    return model.outputs.unpack(outputs)


def starts(parameters: dict[str, Any], seeds: int, model: Model | None = None, of: str = "") -> dict[str, Any]:
    """Start states of many seeds of a model, by default the plant, by row name, (seeds, ...)."""
    model = model or plant(of)
    p = model.parameters.pack(parameters)
    r = np.array([noise.uniforms(s, 0, noise.START_STREAM, model.start_uniforms) for s in range(seeds)])
    return model.state.unpack(np.asarray(model.functions["start"](p[:, None], r.T)).T)


def attitudes(n: int) -> tuple[Any, Any]:
    """Attitudes (n,) of all kinds, and their quaternions, scalar first."""
    turned = Rotation.random(n, random_state=5)
    return turned, turned.as_quat(scalar_first=True)


def assert_variance(samples: Any, variance: Any, freedom: float | None = None) -> None:
    """Assert that the mean square of zero-mean samples is within chi-square bounds (`freedom`: by default all samples).

    variance: one for all samples, or one for each column.
    """
    if np.ndim(variance):
        for k, one in enumerate(variance):
            assert_variance(np.asarray(samples)[:, k], one, freedom)
        return
    samples = np.ravel(samples)
    freedom = freedom or samples.size
    ratio = float(np.mean(samples**2)) / variance
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], freedom) / freedom
    assert low < ratio < high, (ratio, low, high)


def assert_gauss_markov(samples: Any, sigma: float, time: float, dt: float = DT) -> None:
    """Assert variance and one-step correlation of processes, (n, k)."""
    samples = np.asarray(samples).reshape(len(samples), -1)
    decay = math.exp(-dt / time)
    freedom = samples.size * (1 - decay**2) / (1 + decay**2)  # independent samples with the same scatter of the mean square
    assert_variance(samples, sigma**2, freedom)
    assert_variance(samples[1:] - decay * samples[:-1], sigma**2 * (1 - decay**2))


def assert_mean(samples: Any, mean: float, std: float) -> None:
    """Assert that the mean of independent samples is within 4.5 of its standard deviations."""
    samples = np.ravel(samples)
    assert abs(samples.mean() - mean) < 4.5 * std / math.sqrt(samples.size)
