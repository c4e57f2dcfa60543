"""The figures of docs/benchmarks.md are those of the code; its times name figures that `insenv bench` measures."""

import re

import benchmarks
import peers
import pytest
from places import ROOT

from insenv.bench import figures
from insenv.bench.estimators import scenario_of
from insenv.bench.figures import _measurements
from insenv.estimators import registered
from insenv.scenario import build, load

LAST_DIGIT = 1.01 * 10.0 ** (1 - benchmarks.DIGITS)


@pytest.fixture(scope="module")
def measured():
    return {name: figure for name in benchmarks.DRIFTS for figure in figures(f"truth.drift.{name}")}


@pytest.mark.slow
def test_the_drifts_are_those_of_the_code(measured, monkeypatch):
    for name, figure in measured.items():
        assert (figure.name, figure.unit) == (f"truth.drift.{name}", "mm")
        assert figure.floor > 0 and figure.value > 0 and figure.n > 0
    monkeypatch.setattr("insenv.bench.truth.drift", measured.__getitem__)
    stored = pytest.approx(benchmarks.stored()["drift"], rel=LAST_DIGIT)
    assert benchmarks.drifts() == stored, "python tools/benchmarks.py accuracy"


@pytest.mark.slow
def test_the_drifts_of_the_peer(measured):
    peers.package("pyins", "pip install '.[bench]'")
    for name in benchmarks.DRIFTS:
        assert measured[name].peer[1] == pytest.approx(benchmarks.stored()["peer"][name], rel=0.05)


@pytest.mark.slow
def test_the_errors_on_the_recorded_log_are_those_of_the_code():
    peers.package("onavdata")
    expected, found = benchmarks.stored()["log"], benchmarks.log_rows()
    assert list(found) == list(expected) == list(benchmarks.LOGS)
    for name, rms in expected.items():
        assert found[name] == pytest.approx(rms, rel=LAST_DIGIT), f"{name}: python tools/benchmarks.py accuracy"


def test_times_and_groups_of_the_page_are_of_figures_that_are_measured():
    known, names = list(_measurements()), [row["name"] for row in benchmarks.stored()["speed"]["figures"]]
    assert names and set(names) <= set(known) and len(set(names)) == len(names)
    page = (ROOT / "docs" / "benchmarks.md").read_text()
    table = page[page.index("| `NAME` |") : page.index("\n\n## ")]
    named = {name for row in table.splitlines()[2:] for name in re.findall(r"`([^`]+)`", row.split("|")[1])}
    assert all(any(name.startswith(group + ".") for name in known) for group in named)
    assert [name for name in known if not any(name.startswith(group + ".") for group in named)] == []


def test_each_estimator_can_run_on_the_scenario_that_it_is_measured_on():
    for estimator in (each for each in registered().values() if not each.smooths):
        plant = build(load(scenario_of(estimator)))
        assert plant.parameters_of(plant.adapted(estimator)), estimator.id
