"""References on another clock, with other body axes or a turned heading, of a simulated drive."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_log import simulated_log

from insenv import attitude, replay
from insenv.evaluation.errors import Track
from insenv.runs.reference_check import ForceJudge, reference_force, turning


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
    late = found["reference-clock"]
    assert "turns +2.50 s after the gyros" in late and "time_offset_s = -2.50 corrects it" in late
    assert "is turned by 180 deg about" in found["reference-axes"]
    np.testing.assert_allclose(np.abs(turning(replace(log, reference=turned)).axis), [1, 0, 0], atol=0.01)
    assert not {"reference-clock", "reference-axes", "reference-force"} & set(codes(log, true))


def test_a_turned_heading(log):
    """It leaves what the vehicle accelerates across; the true attitude leaves the noise of the fixes."""
    true = Track(
        log.reference.time, attitude.numeric.from_euler(log.reference.roll, log.reference.pitch, log.reference.heading)
    )
    turned = replace(true, q_nb=attitude.numeric.multiply(attitude.numeric.from_euler(0.0, 0.0, np.radians(-90.0)), true.q_nb))
    left = ForceJudge.of(log).left(true.time, true.q_nb)
    assert left.as_is < 0.15 and abs(left.angle) < 0.02
    (note,) = reference_force(log, turned, {"a filter": true})
    assert "and that of a filter 0.11" in note and "turned by +89 deg the reference would leave 0.11" in note
    assert reference_force(log, true, {"a filter": turned}) == () == reference_force(log, true, {"a filter": true})
