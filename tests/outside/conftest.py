"""The outside package, and registries that forget what a test registers."""

import importlib

import pytest
from places import ROOT

from insenv.estimators import registry as estimators
from insenv.sensors import registry as sensors
from insenv.vehicles import registry as vehicles


@pytest.fixture(autouse=True)
def only_here(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    for registry in (estimators, vehicles, sensors):
        monkeypatch.setattr(registry._PLUGINS, "_added", dict(registry._PLUGINS._added))


@pytest.fixture
def rail(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "examples" / "insenv-rail")
    return {name: importlib.import_module(f"insenv_rail.{name}") for name in ("ahrs", "trolley", "compass")}
