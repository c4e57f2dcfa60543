"""Benchmarks: names, and a floor beside each figure.  Both are measured times on shared machines: no test compares them."""

import pytest

from insenv.bench import figures

SHORT = {
    "speed.REPETITIONS": 1, "speed.SAMPLES": 20, "speed.STARTS": 1, "speed.NUMERIC_REPETITIONS": 1, "peers.SAMPLES": 20,
    "estimators.REPETITIONS": 1, "estimators.DURATION_S": 2.0, "envs.REPETITIONS": 1,
    "envs.LONG": 60.0, "peers.feedback_filter": lambda *_, **__: None, "fmu.REPETITIONS": 1, "fmu.DURATION_S": 0.5,
    "mavlink.STREAMED_S": 0.5,
}  # fmt: skip
QUICK = ("interpreter.propagate15", "import.insenv", "numeric.one", "numeric.many")
LONG = (
    "fmu.c-host", "fmu.fmpy", "fmu.export", "fmu.loop", "fmu.ssp", "fmu.pythonfmu", "native.propagate15", "batch.propagate15",
    "mavlink.unit", "step.fusion-15", "batch.fusion-21", "vector.small", "vector.reset.manoeuvre",
)  # fmt: skip


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_every_documented_figure_is_measured(name, monkeypatch):
    for place, value in SHORT.items():
        if place != "peers.feedback_filter" or "fusion" in name:
            monkeypatch.setattr(f"insenv.bench.{place}", value)
    found = {figure.name: figure for figure in figures(name)}
    assert found[name].n > 0
    assert found[name].floor > 0 and (found[name].value > 0 or name == "fmu.pythonfmu")  # a package that need not be there
    assert "propagate15" in name or list(found) == [name]
