"""`insenv examples` and `insenv new`: files that run as they are written, and overwrite nothing."""

import pytest
from command_line import call, refused, strict
from places import ROOT

from insenv.base.toml import read_toml


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
