from pathlib import Path

import pytest
from interpreted import interpreted  # noqa: F401
from text_logs import Folder


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)
