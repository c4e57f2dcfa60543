"""Benchmarks: names, and a floor beside each figure.  Both are measured times on shared machines: no test compares them.

The figures of drift are measured in tests/project/test_benchmarks.py.
"""

import pytest

from insenv.bench import figures, machine, machine_line
from insenv.errors import InputError

SHORT = {
    "speed.REPETITIONS": 1, "speed.SAMPLES": 20, "speed.STARTS": 1, "numeric.REPETITIONS": 1, "peers.SAMPLES": 20,
    "composed.REPETITIONS": 1, "composed.DURATION_S": 2.0, "composed.SAMPLES": 10, "envs.REPETITIONS": 1, "envs.LONG": 60.0,
    "peers.feedback_filter": lambda *_, **__: None,
}  # fmt: skip
SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("interpreter.propagate15", "us"),
        ("import.insenv", "s"),
        ("numeric.one", "us"),
        ("numeric.many", "ns"),
        ("native.propagate15", "us"),
        ("batch.propagate15", "ns"),
        *(pytest.param(name, unit, marks=SLOW) for name, unit in (
            ("step.fusion-15", "us"), ("step.fusion-21", "us"), ("batch.fusion-21", "ns"), ("vector.small", "us"),
            ("vector.reset.ship", "us"), ("vector.reset.tuning", "us"), ("vector.reset.manoeuvre", "us"),
        )),
    ],
)  # fmt: skip
def test_every_documented_figure_is_measured(name, unit, monkeypatch):
    for place, value in SHORT.items():
        if place != "peers.feedback_filter" or "fusion" in name:
            monkeypatch.setattr(f"insenv.bench.{place}", value)
    found = {figure.name: figure for figure in figures(name)}
    assert found[name].unit == unit and found[name].n > 0
    assert found[name].floor > 0 and found[name].value > 0
    assert "propagate15" in name or list(found) == [name]


def test_an_unknown_figure_is_named():
    with pytest.raises(InputError, match=r"no figure starts with .nativ\.."):
        next(iter(figures("nativ.")))


def test_the_machine_is_described():
    assert {"processor", "cores", "system", "python", "compilers"} <= set(machine())
    found = {"processor": "AMD EPYC", "cores": 2, "system": "Linux x86_64", "python": "3.11.7", "compilers": "cc"}
    assert machine_line(found) == "AMD EPYC, 2 cores, Linux x86_64, Python 3.11.7, compilers: cc"
