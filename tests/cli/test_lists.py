"""`insenv list`, `insenv examples` and `insenv new`: names, titles, files that run as written and overwrite nothing."""

import re
from typing import get_args

import pytest
from command_line import call, refused, strict
from places import ROOT

from insenv.base import shipped
from insenv.base.toml import read_toml
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


def test_each_kind_with_its_titles():
    whole = strict(call("list", "--json")[1])
    for what in get_args(What):
        status, out, err = call("list", what)
        assert (status, err) == (0, "") and max(map(len, out.splitlines())) <= 80
        for key, rows in strict(call("list", what, "--json")[1]).items():
            assert rows and whole[key] == rows
            for row in rows:
                assert next(str(row[name]) for name in ("name", "id", "kind") if name in row) in out


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(folder):
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_examples_copies_all_of_them(folder):
    status, out, err = call("examples")
    assert (status, err) == (0, "") and "insenv replay examples/logs/plain.toml -e loosely-coupled" in out
    original = {name: text for name, text in contents(ROOT / "examples").items() if "__pycache__" not in name}
    assert contents(folder / "examples") == original
    found = strict(call("examples", "other/place", "--json")[1])
    assert contents(folder / "other" / "place") == original and len(found["files"]) == len(original)


def test_every_command_that_is_advised_runs(folder):
    for arguments in (("examples",), ("new", "scenario", "boat.toml"), ("new", "log", "drive.toml")):
        advised = [line.split() for line in call(*arguments)[1].splitlines() if line.startswith("  insenv ")]
        assert advised
        for command in advised:
            shorter = ("--duration", "10") if command[1] == "run" else ()
            status, out, err = call(*command[1:], *shorter)
            assert (status, err) == (0, "") and "heading [deg]" in out


def test_examples_that_are_there_already_are_no_conflict_and_changed_ones_are_not_overwritten(folder):
    assert call("examples")[0] == 0
    before = contents(folder)
    (folder / "examples" / "env_loop.py").unlink()
    status, out, err = call("examples")
    assert (status, err) == (0, "") and f"{len(before)} files in examples, 1 of them new; to try" in out
    assert contents(folder) == before
    (folder / "examples" / "env_loop.py").write_bytes(b"# mine")
    (folder / "examples" / "logs" / "plain.toml").unlink()
    refused(call("examples"), "env_loop.py' exists with another content", "no file is overwritten")
    del before["examples/logs/plain.toml"]
    assert contents(folder) == before | {"examples/env_loop.py": b"# mine"}


def test_a_new_scenario_that_is_there_already_is_no_conflict():
    assert "written: boat.toml; to try it" in call("new", "scenario", "boat.toml")[1]
    assert "nothing written: boat.toml exists already; to try it" in call("new", "scenario", "boat.toml")[1]
    assert read_toml("boat.toml")["estimators"] == ["q-method"]


def test_a_new_log_has_its_samples_beside_it(folder):
    (folder / "deep").mkdir()
    found = strict(call("new", "log", "deep/drive.toml", "--json")[1])
    names = {"drive.toml", "drive-imu.csv", "drive-gnss.csv", "drive-reference.csv"}
    assert set(contents(folder / "deep")) == names == {path.split("/")[-1] for path in found["files"]}
    assert read_toml("deep/drive.toml")["imu"]["file"] == "drive-imu.csv"
    assert "insenv replay deep/drive.toml" in (folder / "deep" / "drive.toml").read_text("utf-8")


@pytest.mark.parametrize(("kind", "there"), [("scenario", "mine.toml"), ("log", "mine-gnss.csv")])
def test_new_overwrites_nothing(folder, kind, there):
    (folder / there).write_text("mine")
    refused(call("new", kind, "mine.toml"), f"'{there}' exists", "no file is overwritten")
    assert contents(folder) == {there: b"mine"}
