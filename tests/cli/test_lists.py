"""`insenv list`: a screen of names, and each kind with its titles."""

import re

import pytest
from command_line import call, strict

from insenv.base import shipped
from insenv.cli.lists import What
from insenv.sensors import GNSS_GRADES, IMU_GRADES


def test_the_names_fit_a_screen():
    status, out, err = call("list")
    lines = out.splitlines()
    assert (status, err) == (0, "") and len(lines) < 24 and max(map(len, lines)) <= 80
    assert {"ship-swaying", "q-method", "car", "gnss", "tactical", "rtk", "insenv/Tuning-v0"} <= set(re.split(r"[\s,]+", out))
    assert tuple(name for name in IMU_GRADES if not name.startswith("paper-")) == shipped.IMU_GRADES
    assert tuple(GNSS_GRADES) == shipped.GNSS_GRADES


def test_a_wrong_grade_file_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    figures = "gyro_arw_deg_sqrt_h = 0.1\n"
    (tmp_path / "mine.toml").write_text('title = "Mine"\n' + figures)
    (tmp_path / "wrong.toml").write_text('title = "Wrong"\naccel_vrw_ug_sqrt_hzz = 50.0\n' + figures)
    (tmp_path / "other.toml").write_text('title = "A scenario"\n')
    status, out, err = call("list", "grades")
    assert status == 0 and "mine.toml" in out and "wrong.toml" not in out
    assert len(err.splitlines()) == 1 and "wrong.toml: accel_vrw_ug_sqrt_hzz: unknown key" in err


@pytest.mark.parametrize("what", list(What))
def test_each_kind_with_its_titles(what):
    status, out, err = call("list", what.value)
    listed = strict(call("list", what.value, "--json")[1])
    assert (status, err) == (0, "") and max(map(len, out.splitlines())) <= 80
    whole = strict(call("list", "--json")[1])
    for key, rows in listed.items():
        assert rows and whole[key] == rows
        for row in rows:
            assert next(str(row[name]) for name in ("name", "id", "kind") if name in row) in out
