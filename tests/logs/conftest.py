"""Fixtures of the tests of logs."""

from __future__ import annotations

from pathlib import Path

import pytest
from text_logs import Folder


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """A folder for the files of a log."""
    return Folder(tmp_path)
