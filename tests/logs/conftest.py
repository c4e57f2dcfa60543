"""Fixtures of the tests of logs."""

from pathlib import Path

import pytest
from interpreted import interpreted  # noqa: F401
from text_logs import Folder


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """A folder for the files of a log."""
    return Folder(tmp_path)
