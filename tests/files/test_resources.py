"""The data folders are found in a wheel and in a checkout, and nowhere else."""

import pytest

from insenv.errors import InsenvError
from insenv.files.resources import _folder, scenario_folder


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "insenv"
    folder.mkdir()
    return folder


def test_this_installation_has_scenarios():
    assert any(scenario_folder().glob("*.toml"))


def test_wheel_comes_before_checkout(package):
    (package.parent / "pyproject.toml").touch()
    for folder in (package / "_data" / "fmu", package.parent / "fmu"):
        folder.mkdir(parents=True)
    assert _folder("fmu", package) == package / "_data" / "fmu"


def test_checkout(package):
    (package.parent / "pyproject.toml").touch()
    (package.parent / "fmu").mkdir()
    assert _folder("fmu", package) == package.parent / "fmu"


def test_a_folder_of_another_package_is_not_used(package):
    (package.parent / "fmu").mkdir()
    with pytest.raises(InsenvError, match="lacks its folder 'fmu'"):
        _folder("fmu", package)
