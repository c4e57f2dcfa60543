"""The data folders are found in a wheel and in a checkout, and nowhere else."""

import pytest

from insenv.errors import InsenvError
from insenv.files.resources import _folder, scenario_folder


def test_a_wheel_comes_before_a_checkout_and_a_folder_of_another_package_is_not_used(tmp_path):
    assert any(scenario_folder().glob("*.toml"))
    package = tmp_path / "insenv"
    for folder in (package, tmp_path / "fmu"):
        folder.mkdir()
    with pytest.raises(InsenvError, match="lacks its folder 'fmu'"):
        _folder("fmu", package)
    (tmp_path / "pyproject.toml").touch()
    assert _folder("fmu", package) == tmp_path / "fmu"
    (package / "_data" / "fmu").mkdir(parents=True)
    assert _folder("fmu", package) == package / "_data" / "fmu"
