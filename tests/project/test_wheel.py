"""The wheel, made from the sdist and installed into an empty folder, holds what the commands need."""

import os
import sys
import zipfile
from pathlib import Path

import pytest
from peers import ran
from places import ROOT

pytestmark = pytest.mark.slow


def run(*command, **options):
    return ran(sys.executable, "-m", *command, **options)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    run("build", "--no-isolation", "--outdir", folder, ROOT)  # the sdist, and the wheel from it; no network
    (path,) = folder.glob("*.whl")
    return path


def package_files(folder, prefix):
    files = (p for p in (ROOT / folder).rglob("*") if p.is_file())
    kinds = {".py", ".c", ".h", ".toml", ".xml", ".csv", ".gz", ".md", ".js", ".css", ".html"}
    return {f"{prefix}/{path.relative_to(ROOT / folder).as_posix()}" for path in files if path.suffix in kinds}


def test_contents(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    folders = ("scenarios", "fmu", "web", "examples", "recordings")
    wanted = {*package_files("insenv", "insenv"), "insenv/py.typed"}
    assert wanted.union(*(package_files(f, f"insenv/_data/{f}") for f in folders)) <= names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"insenv"}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


def test_the_installed_wheel_runs_and_its_examples_come_out(wheel, tmp_path):
    target, work = tmp_path / "target", tmp_path / "work"
    work.mkdir()
    run("pip", "install", "--quiet", "--no-deps", "--no-index", "--target", target, wheel)
    given = {"cwd": work, "env": {**os.environ, "PYTHONPATH": str(target), "INSENV_BACKEND": "interpreter"}}
    assert Path(ran(sys.executable, "-c", "import insenv; print(insenv.__file__)", **given).strip()).is_relative_to(target)
    assert "ship-swaying" in run("insenv", "list", **given)
    run("insenv", "run", "ship-swaying", "--duration", 20, "--out", "out", **given)
    assert any((work / "out").glob("*.npz"))
    run("insenv", "examples", **given)
    copied = {path.relative_to(work / "examples") for path in (work / "examples").rglob("*") if path.is_file()}
    there = {p.relative_to(ROOT / "examples") for p in (ROOT / "examples").rglob("*") if p.is_file() and p.suffix != ".pyc"}
    assert copied == there
    replay = ("insenv", "replay", "examples/logs/plain.toml", "-e", "loosely-coupled")
    assert "health: consistent" in run(*replay, **given)
