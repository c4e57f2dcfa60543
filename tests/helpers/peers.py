"""What tests run beside insenv: programs and packages of others.  A missing one is a skip, and a failure in `make test-all`."""

import importlib
import importlib.util
import os
import shutil
import subprocess
from types import ModuleType

import pytest

ALL = os.environ.get("INSENV_TEST_ALL", "0") not in ("", "0")
"""Whether every peer must be there."""


def lacking(what: str) -> None:
    """Skip the test, or fail it where every peer must be there.  what: is missing, and how it is installed."""
    if ALL:
        pytest.fail(f"make test-all installs every peer: {what}", pytrace=False)
    pytest.skip(what)


def program(*names: str, how: str) -> str:
    """Path of the first of these programs that is installed.  how: names the package that brings it."""
    found = next(filter(None, map(shutil.which, names)), None)
    if found is None:
        lacking(f"{' or '.join(names)} is not installed ({how})")
    return str(found)


def package(name: str, how: str = "pip install -e '.[test]'") -> ModuleType:
    if importlib.util.find_spec(name.partition(".")[0]) is None:
        lacking(f"{name} is not installed ({how})")
    return importlib.import_module(name)


def ran(*command, **options) -> str:
    """What a command prints; fails with all that it says unless it succeeds."""
    done = subprocess.run([*map(str, command)], **{"capture_output": True, "text": True, "timeout": 600, **options})
    assert done.returncode == 0, f"{command} ended with {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout
