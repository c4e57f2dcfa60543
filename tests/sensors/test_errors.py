"""Errors of the sensors over long runs: sizes, correlation, and the standard deviations that the receiver reports."""

import json

import numpy as np
import pytest

from insenv import geodesy
from insenv.core.runner import make_runner
from insenv.scenario import build, load

SIGMA = {
    "position_noise_m": (0.6, 0.8, 1.5),
    "velocity_noise_mps": (0.03, 0.04, 0.05),
    "wander_sigma_m": (0.8, 0.6, 2.0),
    "wander_time_s": 5.0,
}


def fixes(seconds=8000.0, **gnss):
    """Rows of the plant of a parked car at 1 Hz, a fix every row."""
    data = json.loads(load("car-city-drive").model_dump_json())
    data["gnss"] |= {"outages_s": (), "outlier_probability": 0.0, "latency_s": 0.0, "epoch_offset_s": 0.0, "interval_s": 1.0}
    data["gnss"] |= {"lever_arm_m": (0.0, 0.0, 0.0)} | SIGMA | gnss
    data["vehicle"] |= {"legs": [{"wait_s": seconds + 1}], "engine": []}
    data["rate_hz"] = 4.0
    plant = build(load(data), seed=2, duration_s=seconds)
    return plant.model.outputs.unpack(make_runner(plant.model, plant.parameters, "interpreter").run(plant.samples, every=4))


@pytest.fixture(scope="module")
def parked():
    return fixes()


def test_reported_sigmas_are_those_of_the_errors(parked):
    """The root sum of squares of white and slow part, component by component."""
    error = geodesy.numeric.ned_offset(
        *(parked[f"gnss_{name}"] for name in ("latitude", "longitude", "height")),
        *(parked[name] for name in ("latitude", "longitude", "height")),
    )
    expected = np.hypot(SIGMA["position_noise_m"], SIGMA["wander_sigma_m"])
    assert np.allclose(parked["gnss_position_sigma"], expected, rtol=1e-12)
    assert np.allclose(error.std(axis=0), expected, rtol=0.08)
    assert np.allclose(parked["gnss_velocity_sigma"], SIGMA["velocity_noise_mps"], rtol=1e-12)
    speed = parked["gnss_velocity_n"] - parked["velocity_n"]
    assert np.allclose(speed.std(axis=0), SIGMA["velocity_noise_mps"], rtol=0.04)
    # correlation from one fix to the next: the share of the slow part times exp(-1 s / T)
    lag = np.mean(error[1:] * error[:-1], axis=0) / error.var(axis=0)
    share = (np.array(SIGMA["wander_sigma_m"]) / expected) ** 2
    assert np.allclose(lag, share * np.exp(-1 / 5.0), atol=0.06)
