"""Optional packages: whether they are installed, and the commands that install them, as messages advise them.

insenv is on no package index, so ``pip install 'insenv[plot]'`` fails: an extra installs from a checkout only.
"""

from __future__ import annotations

import importlib.util
import re
import shlex
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from insenv.base.errors import InputError

_AFTER_NAME = re.compile(r"[^\w.-]")


def install_extra(extra: str, root: Path | None = None) -> str:
    """Command that installs the packages of an extra of insenv.

    From a checkout ``pip install -e '.[plot]'``, with the folder's path unless it is the working directory; from a wheel the
    packages themselves, ``pip install 'matplotlib>=3.8'``.  root: folder that holds the package; where insenv is if None.
    """
    root = Path(__file__).parents[1] if root is None else root
    if _is_checkout(root):
        folder = "." if root == Path.cwd() else str(root)
        return f"pip install -e '{folder}[{extra}]'"
    packages = [shlex.quote(text) for text, marker in _requirements() if _selects(marker, extra)]
    return f"pip install {' '.join(packages)}" if packages else f"see the extra {extra!r} of insenv"


def install_package(name: str) -> str:
    """Command that installs a package in the version that insenv requires, if any: ``pip install onavdata==0.2.5``."""
    required = (text for text, _ in _requirements() if _plain(_AFTER_NAME.split(text)[0]) == _plain(name))
    return f"pip install {shlex.quote(next(required, name))}"


def advice(package: str, extra: str) -> str:
    """Commands that install one missing package, and the extra of insenv that it belongs to."""
    root = Path(__file__).parents[1]
    whole = install_extra(extra) if _is_checkout(root) else f"pip install -e '.[{extra}]' in a checkout of insenv"
    return f"{install_package(package)} (or all of the extra {extra!r}: {whole})"


def is_installed(module: str) -> bool:
    """Whether a module can be imported."""
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # of an import hook
        return False


def need(what: str, module: str, *, package: str = "", extra: str = "") -> None:
    """Raise `InputError` if an optional package is not installed: the call asks for something that this installation lacks.

    what: needs it; module: what is imported; package: its name, if that is another; extra: the extra of insenv that brings it,
    if one does.
    """
    if not is_installed(module):
        name = package or module
        how = advice(name, extra) if extra else install_package(name)
        raise InputError(f"{what} needs {name}, which is not installed: {how}")


def _is_checkout(root: Path) -> bool:
    """Whether the folder holds insenv's own pyproject.toml; site-packages may hold one that another package left there."""
    try:
        return 'name = "insenv"' in (root / "pyproject.toml").read_text(encoding="utf-8")
    except OSError:
        return False


def _requirements() -> list[tuple[str, str]]:
    """Requirements and their markers, from the metadata of the installed insenv; none if it is not installed."""
    try:
        texts = requires("insenv") or []
    except PackageNotFoundError:
        return []
    return [(text.strip(), marker) for text, _, marker in (line.partition(";") for line in texts)]


def _selects(marker: str, extra: str) -> bool:
    return re.search(rf"""extra\s*==\s*["']{re.escape(extra)}["']""", marker) is not None


def _plain(name: str) -> str:
    """The normalized name of a package (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()
