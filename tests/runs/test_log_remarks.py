"""What a log without fixes says of its latitude: gyros at rest contradict a wrong one."""

from dataclasses import replace

import pytest

import insenv
from insenv.logs import load


def told(log, latitude_deg):
    initial = log.description.initial.model_copy(update={"latitude_deg": latitude_deg})
    return replace(log, description=log.description.model_copy(update={"initial": initial}))


def said(log, estimator="q-method"):
    report = insenv.replay(log, estimator)
    return [note for note in (*report.notes, *report.results[0].notes) if "latitude" in note]


@pytest.fixture(scope="module")
def parked(tmp_path_factory):
    """As a file, of which reading finds the time at rest."""
    files = insenv.write(insenv.record("car-parked", duration_s=60.0), tmp_path_factory.mktemp("log"), ["log"])
    return load(next(file for file in files if file.suffix == ".toml"))


def test_gyros_at_rest_show_the_latitude(parked):
    assert said(parked) == said(told(parked, 39.9)) == []
    (note,) = said(told(parked, -40.0))
    assert "contradict the latitude, 40 deg S" in note and note.endswith("38 deg N")
    assert len(said(told(parked, 55.0))) == 1


def test_an_alignment_by_a_log_without_fixes_names_the_latitude():
    log = insenv.record("ship-log-alignment", duration_s=60.0)
    (note, *_) = insenv.replay(told(log, -54.2), "velocity-integration").results[0].notes
    assert note.startswith("nothing in the log shows whether the vehicle is at latitude 54.2 deg S")
    assert note.code == "latitude-unseen"
