"""References on another clock, or with other body axes, of a simulated drive."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed
from made_up_reports import of_health
from simulated_log import simulated_log

from insenv import replay
from insenv.runs.reference_check import turning


@pytest.fixture(scope="module")
def log():
    return simulated_log(changed("car-city-drive", rate_hz=60.0, gnss={"wander_sigma_m": 0.0}), duration_s=130.0)


def replayed(log, reference):
    return replay(replace(log, reference=reference), "loosely-coupled", start="reference")


def codes(log, reference):
    return {note.code: note for note in replayed(log, reference).notes}


def test_another_clock_and_other_body_axes(log):
    """Late by 2.5 s, and turned by 180 deg about forward; the true reference is not named."""
    true, turned = log.reference, replace(log.reference, roll=log.reference.roll + np.pi)
    found = codes(log, replace(turned, time=true.time + 2.5))
    assert "turns +2.50 s after the gyros" in found["reference-clock"] and "= -2.50 corrects it" in found["reference-clock"]
    assert "is turned by 180 deg about" in found["reference-axes"]
    np.testing.assert_allclose(np.abs(turning(replace(log, reference=turned)).axis), [1, 0, 0], atol=0.01)
    assert not {"reference-clock", "reference-axes"} & set(codes(log, true))
    (late,) = replayed(log, replace(true, time=true.time + 2.5)).results
    assert "reference-contradicts" not in late.doubts


def test_a_reference_apart_from_the_estimate_contradicts_it(log):
    """30 m higher in the second half, which the fixes do not show; the true one agrees."""
    true, later = log.reference, log.imu_time > 65.0
    (far,), (true,) = (replayed(log, replace(true, height=true.height + up * later)).results for up in (30.0, 0.0))
    assert (far.health.verdict, far.doubts) == ("contradicted", ("reference-contradicts",)) and far.health.wrong
    assert any("down differs by more than 3 stated sigmas for" in note for note in far.notes)
    assert (true.health.verdict, true.doubts) == ("consistent", ())


@pytest.mark.parametrize(("records", "settled", "said"), [(2, True, False), (3, True, True), (3, False, False)])
def test_more_than_a_twentieth_of_the_time_contradicts(records, settled, said):
    """Of 51 records from 75 s on; those before do not count. Three times the hypotenuse of both sigmas is allowed."""
    made = of_health()
    beyond = (np.arange(200) < 149) | (np.arange(200) >= 200 - records)
    errors = {**made.errors, "vd_mps": np.where(beyond, -3.1, 2.9) * made.sigma["vd_mps"]}
    found = replace(made, errors=errors, settled=settled).against_reference()
    assert (found.health.verdict == "contradicted", found.doubts) == (said, ("reference-contradicts",) * said)
    assert not said or "vd differs by more than 3 stated sigmas for 6 %" in found.notes[-1]
    both = {"vd_mps": float(0.3 * made.sigma["vd_mps"].max())}
    assert replace(made, errors=errors, reference_sigma=both).against_reference().doubts == ()
    far = replace(made, errors={"vd_mps": 3.1 * made.sigma["vd_mps"]})
    assert [bool(each.too_sure()) for each in (far, replace(far, reference_sigma=both))] == [True, False]


def test_a_stated_error_of_the_reference_counts(log):
    """3 deg of pitch off in the second half: more than the filter states, not more than both do."""
    off = replace(log.reference, pitch=log.reference.pitch + np.radians(3.0) * (log.imu_time > 65.0))
    stated = replace(off, attitude_sigma=np.radians([0.1, 2.0, 0.0]))
    (bare,), (counted,) = (replayed(log, each).results for each in (off, stated))
    assert bare.beyond("pitch_deg") > 0.4 and counted.beyond("pitch_deg") == 0.0 and bare.stated() == counted.stated()
    said, left = ({note.code for note in each.notes} for each in (bare, counted))
    assert said - left == {"reference-contradicts"}
    assert counted.reference_sigma == pytest.approx({"roll_deg": 0.1, "pitch_deg": 2.0, "heading_deg": 0.0})
