"""The figures of FMUs are measured beside their floors; no test asserts a time."""

import math
from importlib.util import find_spec

import pytest

from insenv.bench import fmu

SLOW = (fmu.loop, fmu.ssp, fmu.pythonfmu)
ALL = [fmu.c_host, fmu.fmpy, fmu.export_time, *(pytest.param(measure, marks=pytest.mark.slow) for measure in SLOW)]


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(fmu, "REPETITIONS", 1)
    monkeypatch.setattr(fmu, "DURATION_S", 0.5)
    for cached in (fmu._columns, fmu._pythonfmu):
        cached.cache_clear()
    yield
    for cached in (fmu._columns, fmu._pythonfmu):
        cached.cache_clear()


@pytest.mark.parametrize("measure", ALL)
def test_a_figure_has_a_floor(measure):
    found = measure()
    assert found.name.startswith("fmu.") and found.floor > 0
    there = find_spec("pythonfmu") is not None
    if found.name == "fmu.pythonfmu" and not there:
        assert math.isnan(found.value) and "pip install" in found.note
    else:
        assert found.value > 0
    assert (found.peer is not None) == (found.name == "fmu.ssp" or (found.name == "fmu.fmpy" and there))


def test_the_size_of_one_platform(monkeypatch):
    monkeypatch.setattr(fmu, "find_spec", lambda name: None)  # as without ziglang
    found = fmu.size()
    assert found.value == found.floor and "one platform" in found.note
