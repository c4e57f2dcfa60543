"""Runs of simulated scenarios."""

from functools import partial

import numpy as np
import pytest
from changed_scenario import changed

from insenv import campaign, run
from insenv.scenario import load
from insenv.scenario.inputs import chunks


def test_progress_is_reported_to_the_end(monkeypatch):
    """In pieces, here of 100 samples."""
    monkeypatch.setattr("insenv.runs.simulated.chunks", partial(chunks, chunk=100))
    calls = []
    run("static-ecef", ["analytic"], duration_s=1.0, progress=lambda done, total: calls.append((done, total)))
    assert calls[:2] == [(100, 200), (200, 200)] and calls[-1] == (200, 200)


def test_lost_samples_are_bridged_and_counted():
    report = run(changed("ship-swaying", imu={"drop_probability": 0.01}), duration_s=30.0)
    assert any("bridged" in note for note in report.notes)
    assert 36 < int(report.notes[0].split()[0]) < 84
    assert np.abs(report.results[0].errors["roll_deg"][-1]) < 0.1


@pytest.mark.parametrize(("imu", "perfect"), [(None, True), ({"gyro_bias_deg_h": 0.1}, False)])
def test_a_perfect_unit_for_want_of_a_section_is_said(imu, perfect):
    values = load("ship-swaying").model_dump(exclude_unset=True)
    assert run(values, duration_s=1.0).notes == ()
    del values["imu"]
    if imu is not None:
        values["imu"] = {"lever_arm_m": [1.0, 0.0, 0.0], **imu}
    said = ["the inertial unit is perfect, because [imu] is missing or states no errors"] if perfect else []
    assert run(values, "q-method", duration_s=1.0).as_json()["notes"] == said
    notes = campaign(values, "q-method", runs=2, duration_s=1.0).as_json()["notes"]
    assert [note for note in notes if "perfect" in note] == said
