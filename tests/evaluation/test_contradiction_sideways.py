"""A unit turned about the vertical: no fix shows it, the direction of travel does."""

import shutil

import numpy as np
import pytest
from places import ROOT

import insenv
from insenv import attitude
from insenv.evaluation.contradiction import sideways_notes

TIME = np.arange(0.0, 60.0, 0.5)


def driven(turned_deg, speed=10.0, course_deg=0.0):
    """Outputs along a course (n,) at a speed, with a unit turned by an angle."""
    course = np.radians(np.broadcast_to(course_deg, TIME.shape))
    heading = course + np.radians(turned_deg)
    return {
        "q_nb": np.array([attitude.numeric.from_euler(0.0, 0.0, each) for each in heading]),
        "velocity_n": speed * np.stack([np.cos(course), np.sin(course), 0.0 * course], axis=-1),
        "attitude_sigma": np.full((len(TIME), 3), 0.01),
    }


@pytest.mark.parametrize("turned_deg", [-90.0, 45.0, 180.0])
def test_a_unit_turned_about_the_vertical_is_named(turned_deg):
    (note,) = sideways_notes(TIME, driven(turned_deg, course_deg=3.0 * TIME))
    assert f"{turned_deg:+.0f} deg" in note.replace("-180", "+180") and "axes" in note


def test_what_may_be_right_is_not_named():
    assert sideways_notes(TIME, driven(20.0)) == ()  # the drift angle of a ship or an aircraft
    assert sideways_notes(TIME, driven(90.0, speed=1.0)) == ()
    assert sideways_notes(TIME, driven(np.linspace(0.0, 300.0, len(TIME)))) == ()  # a multirotor flies in any direction
    assert sideways_notes(TIME, driven(90.0) | {"attitude_sigma": np.full((len(TIME), 3), 1.0)}) == ()
    assert sideways_notes(TIME, {"q_nb": driven(90.0)["q_nb"]}) == ()  # an alignment


def test_a_replay_names_wrong_axes_and_errors_beyond_its_sigmas(tmp_path):
    for name in ("plain.toml", "plain-imu.csv", "plain-gnss.csv", "plain-reference.csv"):
        shutil.copy(ROOT / "examples" / "logs" / name, tmp_path)
    path = tmp_path / "plain.toml"
    right = insenv.replay(path, "loosely-coupled").results[0].notes
    path.write_text(path.read_text("utf-8").replace('axes = "RFU"', 'axes = "FLU"'), encoding="utf-8")
    wrong = insenv.replay(path, "loosely-coupled").results[0].notes
    for part in ("the heading is +90 deg from the direction of travel", "the errors are larger than this estimator states"):
        assert any(part in note for note in wrong) and not any(part in note for note in right)
