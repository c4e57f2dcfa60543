"""The estimators by id: those that insenv ships, those of installed packages, those registered by a script."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from typing import ParamSpec, TypeVar

from insenv.base.errors import InputError
from insenv.base.plugins import Plugins
from insenv.base.resources import scenario_names
from insenv.base.shipped import ESTIMATORS
from insenv.base.toml import shown
from insenv.estimators.contract import Estimator


def _id(thing: Estimator) -> str:
    if not isinstance(thing, Estimator):
        raise InputError(f"{shown(thing)}: an estimator is an object of class insenv.Estimator")
    return thing.id


_PLUGINS: Plugins[Estimator] = Plugins("estimator", "insenv.estimators", _id, ESTIMATORS, ("a scenario", scenario_names))
names, registered, register = _PLUGINS.names, _PLUGINS.all, _PLUGINS.register
"""The estimators by id, as `Plugins` gives them."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
EstimatorsLike = str | Estimator | Iterable[str | Estimator]
"""One estimator or several, by id or as objects."""


def knowing_objects(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Make of a function one whose scenario or log may name, by their ids, the estimators that a call passes as objects."""

    @wraps(function)
    def call(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        lists = [each if isinstance(each, (list, tuple)) else [each] for each in (*args, *kwargs.values())]
        with _PLUGINS.passed(one for each in lists for one in each if isinstance(one, Estimator)):
            return function(*args, **kwargs)

    return call


def get(id_or_estimator: str | Estimator) -> Estimator:
    """The estimator of that id, or the object itself.  Raises `InputError` with the nearest id."""
    if isinstance(id_or_estimator, Estimator):
        return id_or_estimator
    if not isinstance(id_or_estimator, str):
        raise InputError(f"estimator = {shown(id_or_estimator)}: allowed is an id or an insenv.Estimator")
    return _PLUGINS.get(id_or_estimator)


def get_all(some: EstimatorsLike) -> list[Estimator]:
    """The estimators that `some` names: one, or several; by id or as objects.  Raises `InputError` for an unknown one."""
    if isinstance(some, (str, Estimator)):
        some = (some,)
    try:
        estimators = [get(one) for one in some]
    except TypeError:
        raise InputError(f"estimators = {shown(some)}: allowed is an id, an insenv.Estimator, or several of them") from None
    chosen = {estimator.id: estimator for estimator in estimators}
    for estimator in estimators:
        if chosen[estimator.id] is not estimator:
            raise InputError(f"two estimators have the id {estimator.id!r}: results are kept by id, so ids must differ")
    if not chosen:
        raise InputError("no estimator: name one or several, by id (`insenv list` shows them) or as insenv.Estimator")
    return list(chosen.values())
