"""Where the files lie that travel with insenv: the scenarios, and the C sources and templates of an FMU.

In an installed wheel they are inside the package (``insenv/_data``); in a source checkout, and so in an
editable install, they are the repository's own top-level folders.
"""

from __future__ import annotations

from pathlib import Path

from insenv.errors import InsenvError

_PACKAGE = Path(__file__).resolve().parents[1]


def scenario_folder() -> Path:
    """Folder of the scenarios that insenv ships (``*.toml``).  Raises `InsenvError` if it is missing."""
    return _folder("scenarios", _PACKAGE)


def fmu_folder() -> Path:
    """Folder of the C sources and templates packed into an FMU.  Raises `InsenvError` if it is missing."""
    return _folder("fmu", _PACKAGE)


def _folder(name: str, package: Path) -> Path:
    candidates = [package / "_data" / name]
    if (package.parent / "pyproject.toml").is_file():  # else this is site-packages: the folder is a stranger's
        candidates.append(package.parent / name)
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    looked = " and ".join(str(candidate) for candidate in candidates)
    raise InsenvError(f"this installation of insenv lacks its folder {name!r}: looked for {looked}; reinstall it")
