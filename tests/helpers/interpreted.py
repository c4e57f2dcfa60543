"""Short runs without compiled models; a folder of tests imports the fixture in its conftest.py."""

import os
from collections.abc import Iterator
from unittest import mock

import pytest


@pytest.fixture(autouse=True, scope="module")
def interpreted() -> Iterator[None]:
    """All models of a module of tests are interpreted: to compile one takes longer than 20,000 samples."""
    with mock.patch.dict(os.environ, INSENV_BACKEND="interpreter"):
        yield
