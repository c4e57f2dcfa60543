"""Benchmarks: names, and a floor beside each figure.  Both are measured times on shared machines: no test compares them.

The figures of drift are measured in tests/project/test_benchmarks.py.
"""

import pytest

from insenv.bench import figures, machine, machine_line
from insenv.errors import InputError

NAMES = {
    "native.propagate15": "us",
    "interpreter.propagate15": "us",
    "batch.propagate15": "ns",
    "import.insenv": "s",
    "numeric.one": "us",
    "numeric.many": "ns",
}


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_documented_figure_is_measured(name, monkeypatch):
    monkeypatch.setattr("insenv.bench.speed.REPETITIONS", 1)
    monkeypatch.setattr("insenv.bench.speed.SAMPLES", 20)
    monkeypatch.setattr("insenv.bench.speed.STARTS", 1)
    monkeypatch.setattr("insenv.bench.numeric.REPETITIONS", 1)
    monkeypatch.setattr("insenv.bench.peers.SAMPLES", 20)
    found = {figure.name: figure for figure in figures(name)}
    assert found[name].unit == NAMES[name]
    assert found[name].floor > 0 and found[name].value > 0
    assert found[name].n > 0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "unit"), [("step.fusion-15", "us"), ("step.fusion-21", "us"), ("batch.fusion-21", "ns")])
def test_figures_of_composed_filters(name, unit, monkeypatch):
    monkeypatch.setattr("insenv.bench.composed.REPETITIONS", 1)
    monkeypatch.setattr("insenv.bench.composed.DURATION_S", 2.0)
    monkeypatch.setattr("insenv.bench.composed.SAMPLES", 10)
    monkeypatch.setattr("insenv.bench.peers.feedback_filter", lambda *_, **__: None)
    (found,) = figures(name)
    assert found.name == name and found.unit == unit and found.floor > 0 and found.value > 0


@pytest.mark.parametrize(
    "name",
    [
        "vector.small",
        "vector.reset.ship",
        pytest.param("vector.reset.tuning", marks=pytest.mark.slow),
        pytest.param("vector.reset.manoeuvre", marks=pytest.mark.slow),
    ],
)
def test_figures_of_small_batches_and_of_starts(name, monkeypatch):
    monkeypatch.setattr("insenv.bench.envs.REPETITIONS", 1)
    monkeypatch.setattr("insenv.bench.envs.LONG", 60.0)
    found = {figure.name: figure for figure in figures(name)}
    assert list(found) == [name] and found[name].unit == "us"
    assert found[name].floor > 0 and found[name].value > 0


def test_an_unknown_figure_is_named():
    with pytest.raises(InputError, match=r"no figure starts with .nativ\.."):
        next(iter(figures("nativ.")))


def test_the_machine_is_described():
    assert {"processor", "cores", "system", "python", "compilers"} <= set(machine())
    found = {"processor": "AMD EPYC", "cores": 2, "system": "Linux x86_64", "python": "3.11.7", "compilers": "cc"}
    assert machine_line(found) == "AMD EPYC, 2 cores, Linux x86_64, Python 3.11.7, compilers: cc"
