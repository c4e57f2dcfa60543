"""Tests of FMUs compare short runs with the interpreter: an FMU has its own binary."""

import pytest


@pytest.fixture(autouse=True)
def interpreted(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
