"""A log that does not say that its vehicle stays gets a note where a filter no longer takes it to be at rest."""

from dataclasses import replace

import pytest

import insenv
from insenv.logs import load
from insenv.scenario import load as scenario_of


@pytest.fixture(scope="module")
def parked(tmp_path_factory):
    """Of an industrial unit, as a file, of which reading finds the time at rest."""
    scenario = scenario_of("car-parked")
    scenario = scenario.model_copy(update={"rate_hz": 100.0, "imu": scenario.imu.model_copy(update={"grade": "industrial"})})
    log = insenv.record(scenario, seed=10001, duration_s=120.0)
    files = insenv.write(log, tmp_path_factory.mktemp("log"), ["log"])
    return load(next(file for file in files if file.suffix == ".toml"))


def replayed(log, in_place, kind="car"):
    description = log.description.model_copy(update={"in_place": in_place, "vehicle_kind": kind})
    return insenv.replay(replace(log, description=description), "fusion", start="stated").results[0]


def lost(result):
    return [note for note in result.notes if "zero velocity is all that" in note]


def test_rest_that_is_not_told_and_no_longer_found_is_noted(parked):
    found = replayed(parked, None)
    assert abs(found.errors["vn_mps"][-1]) > 1.0
    (note,) = lost(found)
    assert note.endswith("If it is parked, say so: in_place = true, and vehicle_kind = 'car' or 'aircraft'")
    for kind in ("car", ""):
        told = replayed(parked, True, kind=kind)
        assert not lost(told) and abs(told.errors["vn_mps"][-1]) < 0.5
    assert not lost(replayed(parked, False))
