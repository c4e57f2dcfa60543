"""What contradicts an estimate: fixes, as found in innovations; the direction of travel, which shows a turned unit."""

import numpy as np
import pytest

from insenv import attitude
from insenv.evaluation.contradiction import contradiction_notes, contradictions, jumps, sideways_notes

TIME = np.arange(0.0, 100.0, 0.2)


def innovations(seed: int = 1) -> dict[str, np.ndarray]:
    """Independent innovations of a consistent filter: 1 m, 0.1 m/s."""
    ratio = np.random.default_rng(seed).normal(size=(len(TIME), 6))
    return {"test_ratio": ratio, "innovation": ratio * [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]}


def test_a_consistent_filter_is_contradicted_by_none_of_500_fixes_of_200_seeds() -> None:
    assert [seed for seed in range(200) if contradiction_notes(TIME, innovations(seed))] == []
    assert contradiction_notes(TIME, {"q_nb": np.zeros((len(TIME), 4))}) == ()  # an estimator without test ratios
    outputs = innovations()
    outputs["test_ratio"][::10] *= 20.0  # outliers
    assert contradiction_notes(TIME, outputs) == ()


def test_a_lasting_difference_of_four_sigma_is_found() -> None:
    outputs = innovations()
    late = (TIME > 40) & (TIME < 50)
    outputs["test_ratio"][late, 2] += 4.0
    outputs["innovation"][late, 2] += 4.0
    (found,) = contradictions(TIME, outputs)
    assert found.component == "down" and found.ratio > 3.5 and 3.0 < found.innovation < 6.5  # the largest median
    assert 39.5 < found.begin < 42 and 48 < found.end < 50.5
    (note,) = contradiction_notes(TIME, outputs)
    assert "down is off by" in note and "stated sigmas are too small" in note


def jumping(size: float = 0.7) -> dict[str, np.ndarray]:
    """Of a receiver whose noise is 0.02 m/s though it states 0.25: the velocity jumps at 30 s."""
    outputs = innovations()
    outputs["innovation"] *= 0.2
    outputs["innovation"][TIME > 30, 5] += size
    outputs["test_ratio"] = outputs["innovation"] / 0.25
    return outputs


def test_a_jump_of_the_velocity_that_the_unit_does_not_measure() -> None:
    (found,) = jumps(TIME, jumping())
    assert found.component == "vd" and found.size == pytest.approx(0.7, abs=0.05)
    assert found.before == pytest.approx(30.0, abs=0.01) and found.after == pytest.approx(30.2, abs=0.01)
    said = f"the receiver's vd changes by {-found.size:+.2g} m/s more"  # the innovation is estimate minus fix
    assert any(said in note and "receiver jumps" in note for note in contradiction_notes(TIME, jumping()))


def test_what_is_no_jump() -> None:
    """Slow errors, gaps, what is within the stated sigma of the estimate, and a velocity that the receiver does not measure."""
    slow = jumping(0.0)
    slow["innovation"][:, 5] += np.sin(TIME / 5.0)
    assert jumps(TIME, slow) == []
    after_gap = TIME + np.where(TIME > 30, 60.0, 0.0)
    assert jumps(after_gap, jumping()) == []
    sigma = np.full((len(TIME), 3), 0.15)
    assert len(jumps(TIME, jumping() | {"velocity_sigma": sigma})) == 1
    assert jumps(TIME, jumping() | {"velocity_sigma": sigma + [0.0, 0.0, 0.05]}) == []
    outputs = jumping()
    outputs["test_ratio"][:, 5] = outputs["innovation"][:, 5] / 100.0  # speed and course say nothing of the vertical velocity
    assert jumps(TIME, outputs) == []


def test_a_jump_of_an_estimate_that_is_wrong_already_is_its_own() -> None:
    """A heading told 60 deg off: the receiver was accused of jumps of metres per second."""
    outputs = jumping()
    outputs["test_ratio"][(TIME > 10) & (TIME < 28), 0] = 9.0
    (note,) = contradiction_notes(TIME, outputs)
    assert note.startswith("the fixes contradict the estimate from")


MINUTE = np.arange(0.0, 60.0, 0.5)


def driven(turned_deg, speed=10.0, course_deg=0.0):
    """Outputs along a course (n,) at a speed, with a unit turned by an angle."""
    course = np.radians(np.broadcast_to(course_deg, MINUTE.shape))
    heading = course + np.radians(turned_deg)
    return {
        "q_nb": np.array([attitude.numeric.from_euler(0.0, 0.0, each) for each in heading]),
        "velocity_n": speed * np.stack([np.cos(course), np.sin(course), 0.0 * course], axis=-1),
        "attitude_sigma": np.full((len(MINUTE), 3), 0.01),
    }


@pytest.mark.parametrize("turned_deg", [-90.0, 45.0, 180.0])
def test_a_unit_turned_about_the_vertical_is_named(turned_deg):
    (note,) = sideways_notes(MINUTE, driven(turned_deg, course_deg=3.0 * MINUTE))
    assert f"{turned_deg:+.0f} deg" in note.replace("-180", "+180") and "axes" in note


def test_a_vehicle_on_wheels_is_named_from_ten_degrees_on():
    assert [len(sideways_notes(MINUTE, driven(angle), wheels=True)) for angle in (9.0, -11.0)] == [0, 1]
    unsure = {"attitude_sigma": np.full((len(MINUTE), 3), np.radians(5.0))}
    assert [len(sideways_notes(MINUTE, driven(angle) | unsure, wheels=True)) for angle in (14.0, 16.0)] == [0, 1]


def test_what_may_be_right_is_not_named():
    assert sideways_notes(MINUTE, driven(20.0)) == ()  # the drift angle of a ship or an aircraft
    assert sideways_notes(MINUTE, driven(90.0, speed=1.0)) == ()
    assert sideways_notes(MINUTE, driven(np.linspace(0.0, 300.0, len(MINUTE)))) == ()  # a multirotor flies in any direction
    assert sideways_notes(MINUTE, driven(90.0) | {"attitude_sigma": np.full((len(MINUTE), 3), 1.0)}) == ()
    assert sideways_notes(MINUTE, {"q_nb": driven(90.0)["q_nb"]}) == ()  # an alignment
