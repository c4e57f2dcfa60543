"""The wheel, made from the sdist and installed into an empty folder, holds what the commands need."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from places import ROOT


def run(*command, **options):
    """Run `python -m command...`; return its standard output, or fail with all it said."""
    done = subprocess.run([sys.executable, "-m", *map(str, command)], capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dist")
    run("build", "--no-isolation", "--outdir", folder, ROOT)  # the sdist, and the wheel from it; no network
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """Environment of a process that sees the installed wheel and not this checkout."""
    target = tmp_path_factory.mktemp("target")
    run("pip", "install", "--quiet", "--no-deps", "--no-index", "--target", target, wheel)
    environment = {**os.environ, "PYTHONPATH": str(target), "INSENV_BACKEND": "interpreter"}
    place = subprocess.run(
        [sys.executable, "-c", "import insenv; print(insenv.__file__)"],
        cwd=target.parent, env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(place.stdout.strip()).is_relative_to(target)
    return environment


def package_files(folder, prefix):
    """Names in the wheel of the files that stand under `folder` of the checkout and are not compiled."""
    files = (p for p in (ROOT / folder).rglob("*") if p.is_file())
    kinds = {".py", ".c", ".h", ".toml", ".xml", ".csv", ".gz", ".md", ".js", ".css", ".html"}
    kept = (p.relative_to(ROOT / folder) for p in files if p.suffix in kinds)
    return {f"{prefix}/{path.as_posix()}" for path in kept}


def test_contents(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = package_files("insenv", "insenv") | {"insenv/py.typed"}
    wanted |= package_files("scenarios", "insenv/_data/scenarios") | package_files("fmu", "insenv/_data/fmu")
    wanted |= package_files("web", "insenv/_data/web")
    wanted |= package_files("examples", "insenv/_data/examples")
    assert wanted <= names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"insenv"}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


def test_the_page_of_the_index_is_the_readme(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = archive.read(name).decode("utf-8")
    assert "Description-Content-Type: text/markdown" in metadata
    title = (ROOT / "README.md").read_text("utf-8").splitlines()[0]
    assert title in metadata.splitlines()


def test_list(installed, tmp_path):
    assert "ship-swaying" in run("insenv", "list", cwd=tmp_path, env=installed)


def test_run(installed, tmp_path):
    run("insenv", "run", "ship-swaying", "--duration", 20, "--out", "out", cwd=tmp_path, env=installed)
    assert any((tmp_path / "out").glob("*.npz"))


def test_the_examples_come_out_of_the_wheel_and_run(installed, tmp_path):
    run("insenv", "examples", cwd=tmp_path, env=installed)
    copied = {path.relative_to(tmp_path / "examples") for path in (tmp_path / "examples").rglob("*") if path.is_file()}
    there = {p.relative_to(ROOT / "examples") for p in (ROOT / "examples").rglob("*") if p.is_file() and p.suffix != ".pyc"}
    assert copied == there
    replay = ("insenv", "replay", "examples/logs/plain.toml", "-e", "loosely-coupled")
    assert "health: consistent" in run(*replay, cwd=tmp_path, env=installed)


def test_new_files_of_the_wheel_run(installed, tmp_path):
    run("insenv", "new", "log", "mine.toml", cwd=tmp_path, env=installed)
    assert "heading" in run("insenv", "replay", "mine.toml", "-e", "loosely-coupled", cwd=tmp_path, env=installed)
