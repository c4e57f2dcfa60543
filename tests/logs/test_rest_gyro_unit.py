"""A wrong unit of the gyros is named: by the turns of the course, and by the rate at rest."""

import pytest
from places import ROOT

from insenv.logs import load

PLAIN = ROOT / "examples" / "logs"


def notes(folder, *changes):
    """What is said of the gyros of the example log with a changed description."""
    text = (PLAIN / "plain.toml").read_text().replace("plain-", f"{PLAIN.as_posix()}/plain-")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / "log.toml"
    path.write_text(text)
    return [note for note in load(path).notes if "imu: the gyros" in note]


def test_the_right_unit_has_no_note(tmp_path):
    assert notes(tmp_path) == []
    assert notes(tmp_path, ('axes = "RFU"', 'axes = "FRD"')) == []  # turns that are not proportional show nothing


@pytest.mark.parametrize(("unit", "ratio"), [("rad/s", "57"), ("rad/h", "0.0158")])
def test_turns_that_are_not_those_of_the_course(tmp_path, unit, ratio):
    turns = notes(tmp_path, ('"deg/s"', f'"{unit}"'))[0]
    assert f"turn {ratio} times as far as the course" in turns and "check gyro_unit" in turns


def test_a_rate_at_rest_that_the_data_sheet_does_not_allow(tmp_path):
    slow = ('velocity = ["vn", "ve", "vd"]                # leave it out if the receiver gives none', "")
    without = (slow, ('velocity_sigma = ["std_vn", "std_ve", "std_vd"]', ""))
    assert notes(tmp_path, *without) == []
    (note,) = notes(tmp_path, *without, ('"deg/s"', '"rad/s"'))
    assert "deg/h at rest" in note and "15 deg/h" in note and "check gyro_unit" in note
    assert notes(tmp_path, *without, ('"deg/s"', '"rad/s"'), ('grade = "tactical"', "")) == []  # nothing is known of the unit
