"""The estimators by id: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

from insenv.errors import InputError
from insenv.estimators.contract import Estimator
from insenv.plugins import Plugins

MODULES = (
    "analytic",
    "ecef_kf",
    "q_method",
    "inertial_fir",
    "gyrocompass",
    "qakf",
    "wander_sins",
    "loosely_coupled",
    "aqe",
    "lssvm",
    "smoother",
)
"""The modules of this package that define an `ESTIMATOR` (or several, `ESTIMATORS`), in the order of listings."""


def _shipped() -> Iterator[Estimator]:
    for name in MODULES:
        module = import_module(f"insenv.estimators.{name}")
        yield from getattr(module, "ESTIMATORS", None) or [module.ESTIMATOR]


def _id(thing: Estimator) -> str:
    if not isinstance(thing, Estimator):
        raise InputError(f"{thing!r}: an estimator is an object of class insenv.Estimator")
    return thing.id


_PLUGINS: Plugins[Estimator] = Plugins("estimator", "insenv.estimators", _id, _shipped)


def get(id_or_estimator: str | Estimator) -> Estimator:
    """The estimator of that id, or the object given.  Raises `InputError` with the nearest id."""
    if isinstance(id_or_estimator, Estimator):
        return id_or_estimator
    return _PLUGINS.get(id_or_estimator)


def registered() -> dict[str, Estimator]:
    """All estimators by id."""
    return _PLUGINS.all()


def register(estimator: Estimator) -> Estimator:
    """Make an estimator known by its id.  Raises `InputError` if another one has it."""
    return _PLUGINS.register(estimator)
