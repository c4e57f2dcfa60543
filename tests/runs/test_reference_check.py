"""References on another clock, or with other body axes, of a simulated drive."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed
from simulated_log import simulated_log

from insenv import replay
from insenv.runs.reference_check import turning


@pytest.fixture(scope="module")
def log():
    return simulated_log(changed("car-city-drive", rate_hz=60.0), duration_s=130.0)


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
    assert not {"reference-clock", "reference-axes"} & set(codes(log, true))
