"""The figures of FMUs are measured beside their floors; no test asserts a time."""

import math
from importlib.util import find_spec

import pytest

from insenv.bench import fmu

SLOW = (fmu.loop, fmu.ssp, fmu.pythonfmu)
ALL = [fmu.c_host, fmu.fmpy, fmu.export_time, *(pytest.param(measure, marks=pytest.mark.slow) for measure in SLOW)]


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """The measurements are kept for the process: those of these short runs are dropped."""
    monkeypatch.setattr(fmu, "REPETITIONS", 1)
    monkeypatch.setattr(fmu, "DURATION_S", 0.5)
    yield
    fmu._columns.cache_clear()
    fmu._pythonfmu.cache_clear()


@pytest.mark.parametrize("measure", ALL)
def test_a_figure_has_a_floor(measure):
    found = measure()
    assert found.floor > 0
    assert found.value > 0 or (find_spec("pythonfmu") is None and math.isnan(found.value))
