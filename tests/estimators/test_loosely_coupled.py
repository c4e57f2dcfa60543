"""loosely-coupled: its gate.  The consistency of its errors with its covariance: tests/reproduce/test_consistency.py."""

import numpy as np
import pytest
from changed_scenario import changed

import insenv


def test_outliers_are_gated():
    wild, largest = {"outages_s": (), "outlier_probability": 0.05, "outlier_size_m": 50.0, "wander_sigma_m": 0.0}, {}
    for gate in (0.0, 5.0):
        scenario = changed("car-city-drive", gnss={"grade": "rtk", **wild},
            estimator={"loosely-coupled": {"innovation_gate": gate}})  # fmt: skip
        (result,) = insenv.run(scenario, "loosely-coupled", seed=2, duration_s=150.0).results
        largest[gate] = max(np.abs(result.errors[name][result.time > 60.0]).max() for name in ("north_m", "east_m", "down_m"))
        assert (result.outputs["nis_refused_count"][-1].sum() > 0) == (gate > 0)
    assert largest[5.0] < 0.3 < 1.0 < largest[0.0]


@pytest.mark.parametrize("id", ["loosely-coupled", "smoother"])
def test_a_bias_many_times_as_large_as_stated_contradicts_the_filter(id):
    scenario = changed("car-city-drive", imu={"accel_bias_ug": [0.0, 0.0, 8000.0]})
    (right,) = insenv.run(scenario, id, seed=2, duration_s=40.0).results
    stated = {id: {"accel_bias_sigma_ug": 1000.0}}
    (wrong,) = insenv.run(scenario, id, seed=2, duration_s=40.0, settings=stated).results
    assert "estimate-surprising" not in right.health.contradicted
    assert "estimate-surprising" in wrong.health.contradicted and wrong.health.verdict != "consistent"
    (note,) = (note for note in wrong.notes if note.code == "estimate-surprising")
    assert "the estimate of accel_bias is" in note and "accel_bias_sigma" in note
