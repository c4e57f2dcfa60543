"""Fusion filters made for a test run some seconds: compiling them would take longer."""

import pytest


@pytest.fixture(autouse=True)
def interpreted(request, monkeypatch):
    if request.node.get_closest_marker("slow") is None:
        monkeypatch.setenv("INSENV_BACKEND", "interpreter")
