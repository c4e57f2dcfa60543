"""loosely-coupled: consistency of its errors with its covariance, and its gate."""

import numpy as np
import pytest
from changed_scenario import changed
from navigation import error_state, true_state
from scipy.stats import chi2

from insenv import geodesy
from insenv.core import symmetric
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.scenario import build
from insenv.scenario.chunks import input_rows


def navigated(seed, gnss, imu=(), **parameters):
    """(columns, runner at the end, outputs) of 150 s of the city drive."""
    estimator = get("loosely-coupled")
    plant = build(changed("car-city-drive", gnss={"grade": "rtk", "outages_s": (), **gnss}, imu=dict(imu)), seed, 150.0)
    for key in plant.parameters:
        if "scale_factor" in key or "misalignment" in key:  # the filter does not model them
            plant.parameters[key] = np.zeros_like(np.asarray(plant.parameters[key], dtype=float))
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    known = {**estimator.parameters(plant.knowledge), "rotation_error": 0.0, "thrust_error": 0.0, **parameters}
    runner = make_runner(estimator.model, known)
    rows = input_rows(estimator.model, columns, plant.samples)
    return columns, runner, estimator.model.outputs.unpack(runner.run(plant.samples, rows))


@pytest.mark.parametrize("seeds", [4, pytest.param(24, marks=pytest.mark.slow)])
def test_covariance_is_consistent_over_seeds(seeds):
    """Normalised error of position, velocity and attitude inside the 99.9 % chi-square bounds."""
    total = 0.0
    for seed in range(seeds):
        columns, runner, _ = navigated(seed, {"outlier_probability": 0.0}, {"grade": "leador"})
        error = error_state(runner.x, true_state(runner.x, columns))[:9]
        total += error @ np.linalg.solve(symmetric.full_array(runner.state["covariance"], 15)[:9, :9], error)
    low, high = chi2.ppf([0.0005, 0.9995], 9 * seeds)
    assert low < total < high


def test_outliers_are_gated():
    wild, errors = {"outlier_probability": 0.05, "outlier_size_m": 50.0}, {}
    for gate in (0.0, 5.0):
        columns, _, y = navigated(2, wild, innovation_gate=gate, fix_wander_sigma=np.zeros(3))
        places = [(t["latitude"], t["longitude"], t["height"]) for t in (y, columns)]
        errors[gate] = np.abs(geodesy.numeric.ned_offset(*places[0], *places[1])[12000:]).max()
        assert (y["nis_refused_count"][-1].sum() > 0) == (gate > 0)
    assert errors[5.0] < 0.3 < 5 < errors[0.0]
