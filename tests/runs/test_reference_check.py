"""References on another clock, with other body axes or a turned heading, of a simulated drive."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_log import simulated_log

from insenv import attitude, replay
from insenv.evaluation.errors import Track
from insenv.runs.reference_check import reference_force, turning


@pytest.fixture(scope="module")
def log():
    return simulated_log("car-city-drive", duration_s=130.0)


def codes(log, reference):
    changed = replace(log, reference=reference)
    return {note.code: note for note in replay(changed, "loosely-coupled", start="reference").notes}


def test_another_clock_and_other_body_axes(log):
    """Late by 2.5 s, and turned by 180 deg about forward; the true reference is not named."""
    true, turned = log.reference, replace(log.reference, roll=log.reference.roll + np.pi)
    found = codes(log, replace(turned, time=true.time + 2.5))
    assert "turns +2.50 s after the gyros" in found["reference-clock"] and "= -2.50 corrects it" in found["reference-clock"]
    assert "is turned by 180 deg about" in found["reference-axes"]
    np.testing.assert_allclose(np.abs(turning(replace(log, reference=turned)).axis), [1, 0, 0], atol=0.01)
    assert not {"reference-clock", "reference-axes", "reference-force"} & set(codes(log, true))


def test_a_turned_heading_leaves_the_acceleration_across(log):
    angles = [log.reference.roll, log.reference.pitch, log.reference.heading]
    true, turned = (
        Track(log.reference.time, attitude.numeric.from_euler(*angles[:2], angles[2] - by)) for by in (0.0, np.pi / 2)
    )
    (note,) = reference_force(log, turned, {"a filter": true})
    assert (
        "and that of a filter 0.11" in note and "turned by +89 deg the reference would leave 0.11" in note
    )  # fixes of 0.1 m/s
    assert reference_force(log, true, {"a filter": turned}) == () == reference_force(log, true, {"a filter": true})
