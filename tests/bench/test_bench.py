"""Benchmarks: names, and a floor beside each figure; no test asserts a time."""

import pytest

from insenv.bench import figures, machine
from insenv.errors import InputError

NAMES = {
    "native.propagate15": "us",
    "interpreter.propagate15": "us",
    "batch.propagate15": "ns",
    "truth.drift.ship": "mm",
    "truth.drift.car": "mm",
    "truth.drift.aircraft": "mm",
    "import.insenv": "s",
}


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_documented_figure_is_measured(name, monkeypatch):
    monkeypatch.setattr("insenv.bench.speed.REPETITIONS", 1)
    monkeypatch.setattr("insenv.bench.speed.SAMPLES", 20)
    found = {figure.name: figure for figure in figures(name)}
    assert found[name].unit == NAMES[name]
    assert 0 < found[name].floor < found[name].value
    assert found[name].n > 0


@pytest.mark.parametrize("name", ["vector.small", "vector.reset.ship", "vector.reset.tuning", "vector.reset.manoeuvre"])
def test_figures_of_small_batches_and_of_starts(name, monkeypatch):
    monkeypatch.setattr("insenv.bench.envs.REPETITIONS", 1)
    monkeypatch.setattr("insenv.bench.envs.LONG", 60.0)
    found = {figure.name: figure for figure in figures(name)}
    assert list(found) == [name] and found[name].unit == "us"
    assert 0 < found[name].floor < found[name].value


def test_an_unknown_figure_is_named():
    with pytest.raises(InputError, match=r"no figure starts with .nativ\.."):
        next(iter(figures("nativ.")))


def test_the_machine_is_described():
    assert {"processor", "cores", "system", "python", "compilers"} <= set(machine())
