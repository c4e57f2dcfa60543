"""Files of grades: what is written comes back, beside a scenario too, and what is wrong is named."""

import pickle

import numpy as np
import pytest

import insenv
from insenv.base.errors import InputError
from insenv.sensors import IMU_GRADES
from insenv.sensors.grade_file import grade_of, toml_text

SCENARIO = (
    'title = "t"\nduration_s = 5.0\n[start]\nlatitude_deg = 45.0\nlongitude_deg = 0.0\n[vehicle]\nkind = "car"\n'
    '[imu]\ngrade = "unit.toml"\n'
)


def test_a_grade_file_holds_a_grade(tmp_path):
    for grade in IMU_GRADES.values():
        (tmp_path / "unit.toml").write_text(toml_text(grade), encoding="utf-8")
        found = grade_of(str(tmp_path / "unit.toml"))
        assert (found.name, found.title, found.sources) == ("unit", grade.title, grade.sources)
        for row, value in grade.parameters().items():
            assert np.allclose(found.parameters()[row], value, rtol=1e-5), row


def test_a_grade_file_beside_a_scenario(tmp_path):
    grade = IMU_GRADES["tactical"]
    (tmp_path / "unit.toml").write_text(toml_text(grade), encoding="utf-8")
    (tmp_path / "s.toml").write_text(SCENARIO, encoding="utf-8")
    scenario = insenv.load(tmp_path / "s.toml")
    rows = scenario.imu.rows(200.0)
    assert rows["angle_random_walk"] == pytest.approx(grade.parameters()["angle_random_walk"])
    (tmp_path / "unit.toml").unlink()  # from here on the scenario holds the figures
    assert pickle.loads(pickle.dumps(scenario)).imu.rows(200.0)["accel_range"] == rows["accel_range"]
    own = scenario.model_dump(mode="json")
    own["imu"]["accel_vrw_ug_sqrt_hz"] = 20.0  # another way to state the noise replaces the one of the file
    assert insenv.load(own).imu.rows(200.0)["velocity_random_walk"] == pytest.approx(20 * 9.80665e-6)


@pytest.mark.parametrize(("text", "message"), [
    (None, "s.toml: imu.grade: .*unit.toml: file not found"),
    ('title = "x"\nfoo = 1\nbar = 2', "unit.toml: foo: unknown key(.|\n)*unit.toml: bar: unknown key"),
    ('title = "x"\naccel_white_ug = 1.0\naccel_vrw_ug_sqrt_hz = 1.0', "describe the same noise"),
])  # fmt: skip
def test_a_wrong_grade_file_is_refused(text, message, tmp_path):
    if text is not None:
        (tmp_path / "unit.toml").write_text(text, encoding="utf-8")
    (tmp_path / "s.toml").write_text(SCENARIO, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        insenv.load(tmp_path / "s.toml")
