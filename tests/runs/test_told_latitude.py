"""A log without fixes whose told latitude is wrong says so; one whose latitude is right says nothing."""

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


@pytest.mark.slow
def test_a_filter_by_a_doppler_log_finds_the_hemisphere():
    """With the wrong one the heading is 3 deg off, 50 of the stated sigmas, and each innovation passes its gate."""
    log = insenv.record("ship-log-alignment")
    right = insenv.replay(log, "fusion").results[0]
    assert not [note for note in right.notes if "does not fit" in note]
    wrong, smoothed = insenv.replay(told(log, -54.2), ["fusion", "fusion-smoother"]).results
    assert abs(wrong.errors["heading_deg"][-1]) > 2.0 > 30 * wrong.sigma["heading_deg"][-1]
    (note,) = [note for note in wrong.notes if "does not fit" in note]
    assert note.startswith("the latitude, 54.2 deg S, does not fit the log: ") and note.endswith("its sign is wrong")
    assert note in smoothed.notes
    # of a latitude that is wrong otherwise neither hemisphere fits
    assert not [note for note in insenv.replay(told(log, 57.2), "fusion").results[0].notes if "sign" in note]
    aligned = insenv.replay(told(log, -54.2), "velocity-integration").results[0]
    assert aligned.notes[0].startswith("nothing in the log shows whether the vehicle is at latitude 54.2 deg S")
