"""The runs of this folder are short: none compiles a model."""

import pytest


@pytest.fixture(autouse=True)
def interpreter(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
