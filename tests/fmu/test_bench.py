"""The figures of FMUs are measured beside their floors; no test asserts a time."""

import math
from importlib.util import find_spec

import pytest

from insenv.bench import fmu


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(fmu, "REPETITIONS", 1)
    monkeypatch.setattr(fmu, "DURATION_S", 5.0)
    for cached in (fmu._columns, fmu._pythonfmu):
        cached.cache_clear()
    yield
    for cached in (fmu._columns, fmu._pythonfmu):
        cached.cache_clear()


@pytest.mark.parametrize("measure", [fmu.c_host, fmu.loop, fmu.fmpy, fmu.pythonfmu, fmu.ssp, fmu.export_time])
def test_a_figure_has_a_floor(measure):
    found = measure()
    assert found.name.startswith("fmu.")
    assert found.floor > 0
    if found.name == "fmu.pythonfmu" and find_spec("pythonfmu") is None:
        assert math.isnan(found.value)
        assert "pip install" in found.note
    else:
        assert found.value > 0
    if found.name == "fmu.fmpy" and find_spec("pythonfmu") is not None:
        assert found.peer[0].startswith("PythonFMU")


def test_the_size_of_one_platform(monkeypatch):
    monkeypatch.setattr(fmu, "find_spec", lambda name: None)  # as without ziglang
    found = fmu.size()
    assert found.value == found.floor
    assert "one platform" in found.note
