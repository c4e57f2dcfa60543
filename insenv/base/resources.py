"""Folders of the data files of insenv: scenarios, descriptions of public logs, C sources and templates of an FMU, the front
end of pages.

In an installed wheel they are inside the package (``insenv/_data``); in a source checkout, and therefore in an editable
install, they are top-level folders of the repository.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from insenv.base.errors import InsenvError

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

_PACKAGE = Path(__file__).resolve().parents[1]


def scenario_folder() -> Path:
    """Folder of the scenarios of insenv (``*.toml``). Raises `InsenvError` if it is missing."""
    return _folder("scenarios", _PACKAGE)


def scenario_names() -> list[str]:
    """Names of the scenarios that insenv contains."""
    return sorted(path.stem for path in scenario_folder().glob("*.toml"))


def scenario_titles() -> dict[str, str]:
    """The title of each scenario of insenv by its name; nothing else of it is checked."""
    folder = sorted(scenario_folder().glob("*.toml"))
    return {path.stem: str(toml_values(path.read_text(encoding="utf-8")).get("title", "")) for path in folder}


def toml_values(text: str) -> dict[str, Any]:
    """The values of a text in TOML.  Raises `ValueError`."""
    return tomllib.loads(text)


def fmu_folder() -> Path:
    """Folder of the C sources and templates of an FMU. Raises `InsenvError` if it is missing."""
    return _folder("fmu", _PACKAGE)


def web_folder() -> Path:
    """Folder of the front end of pages: scripts, style, template. Raises `InsenvError` if it is missing."""
    return _folder("web", _PACKAGE)


def examples_folder() -> Path:
    """Folder of the examples. Raises `InsenvError` if it is missing."""
    return _folder("examples", _PACKAGE)


def recordings_folder() -> Path:
    """Folder of the descriptions of public logs (``*.toml``). Raises `InsenvError` if it is missing."""
    return _folder("recordings", _PACKAGE)


def _folder(name: str, package: Path) -> Path:
    candidates = [package / "_data" / name]
    if (package.parent / "pyproject.toml").is_file():  # in site-packages, the folder belongs to another package
        candidates.append(package.parent / name)
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    looked = " and ".join(str(candidate) for candidate in candidates)
    raise InsenvError(f"this installation of insenv lacks its folder {name!r}: searched {looked}; reinstall it")
