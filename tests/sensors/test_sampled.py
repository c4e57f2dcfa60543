"""Instruments that measure at their own times: arrivals, declared rows, sections with their grades."""

import numpy as np
import pytest
from sensor_plant import INSTRUMENTS, plant, simulate

from insenv.core.codegen import native_source
from insenv.sensors.registry import registered


@pytest.mark.parametrize("id", INSTRUMENTS)
def test_operations_are_exact(id: str) -> None:
    native_source(plant(id))  # which refuses others


@pytest.mark.parametrize("id", INSTRUMENTS)
def test_times(id: str) -> None:
    """The first measurement comes one interval after the start, each arrives after the latency, outages remove epochs."""
    rows = {f"{id}_interval": 0.1, f"{id}_latency": 0.03, f"{id}_outage_start": [0.35] + [0.0] * 15}
    rows[f"{id}_outage_end"] = [0.55] + [0.0] * 15
    y = simulate(100, rows, {"height": np.arange(1.0, 101.0)}, of=id)
    arrived = np.flatnonzero(y[f"{id}_new"]) + 1
    assert arrived.tolist() == [13, 23, 33, 63, 73, 83, 93]
    np.testing.assert_allclose(y[f"{id}_age"][arrived - 1], 0.03, atol=1e-12)
    if id == "barometer":
        np.testing.assert_array_equal(y["barometer_height"][arrived - 1], arrived - 3.0)
        np.testing.assert_array_equal(y["barometer_height_true"][arrived - 1], arrived - 3.0)
    without = simulate(100, {f"{id}_interval": 0.1}, of=id)
    assert (np.flatnonzero(without[f"{id}_new"]) + 1).tolist() == [10 * k for k in range(1, 11)]
    assert not without[f"{id}_age"].any()


@pytest.mark.parametrize("id", INSTRUMENTS)
def test_every_figure_of_a_grade_is_a_key_and_has_a_source(id: str) -> None:
    section = registered()[id]
    assert "perfect" in section.grades and not section.grades["perfect"].figures
    for grade in section.grades.values():
        assert all(name in section.model_fields and grade.source(name) for name in grade.figures)
        section(grade=grade.name).rows(100.0)
