"""Fixtures of the tests of campaigns."""

import pytest


@pytest.fixture(autouse=True)
def interpreted(monkeypatch):
    """These campaigns are short: compiling would take longer than running them."""
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
