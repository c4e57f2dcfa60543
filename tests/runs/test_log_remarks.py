"""What a log without fixes says of its latitude, which gyros at rest contradict, and of a rest that it does not state."""

from dataclasses import replace

import pytest
from changed_scenario import changed
from standing_car import started

import insenv
from insenv.logs import load


def said(log, estimator="q-method"):
    report = insenv.replay(log, estimator)
    return [note for note in (*report.notes, *report.results[0].notes) if "latitude" in note]


def read(log, folder):  # as a file, of which reading finds the time at rest
    return load(next(file for file in insenv.write(log, folder, ["log"]) if file.suffix == ".toml"))


@pytest.fixture(scope="module")
def parked(tmp_path_factory):
    return read(insenv.record(changed("car-parked", rate_hz=60.0), duration_s=60.0), tmp_path_factory.mktemp("log"))


def test_gyros_at_rest_show_the_latitude(parked):
    assert said(parked) == said(started(parked, latitude_deg=39.9)) == []
    (note,) = said(started(parked, latitude_deg=-40.0))
    assert "contradict the latitude, 40 deg S" in note and note.endswith("38 deg N")
    assert len(said(started(parked, latitude_deg=55.0))) == 1


def test_an_alignment_by_a_log_without_fixes_names_the_latitude():
    log = insenv.record("ship-log-alignment", duration_s=60.0)
    (note, *_) = insenv.replay(started(log, latitude_deg=-54.2), "velocity-integration").results[0].notes
    assert note.startswith("nothing in the log shows whether the vehicle is at latitude 54.2 deg S")
    assert note.code == "latitude-unseen"


def replayed(log, in_place, kind="car"):
    description = log.description.model_copy(update={"in_place": in_place, "vehicle_kind": kind})
    return insenv.replay(replace(log, description=description), "fusion", start="stated").results[0]


def lost(result):
    return [note for note in result.notes if "zero velocity is all that" in note]


@pytest.mark.slow
def test_rest_that_is_not_told_and_no_longer_found_is_noted(tmp_path):
    scenario = changed("car-parked", rate_hz=60.0, imu={"grade": "industrial"})
    parked = read(insenv.record(scenario, seed=10001, duration_s=120.0), tmp_path)
    found = replayed(parked, None)
    assert abs(found.errors["vn_mps"][-1]) > 1.0
    (note,) = lost(found)
    assert note.endswith("If it is parked, say so: in_place = true, and vehicle_kind = 'car' or 'aircraft'")
    for kind in ("car", ""):
        told = replayed(parked, True, kind=kind)
        assert not lost(told) and abs(told.errors["vn_mps"][-1]) < 0.5
    assert not lost(replayed(parked, False))
