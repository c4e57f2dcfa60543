"""A plant whose sources of error are switched off by parameter values, row by row of a batch.

The estimator must not change with the switch: the standard deviations that a receiver states with its measurements follow from
the parameters of its noise, and are taken from parameters of their own, ``stated_NAME``, that keep their values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

from insenv.core.model import Model, Step, Values
from insenv.core.tables import Table, Vector
from insenv.scenario.error_sources import Source
from insenv.sensors import Sensor

PREFIX = "stated_"


@lru_cache(maxsize=16)
def switchable(plant: Model, sensors: tuple[Sensor, ...]) -> Model:
    """The plant with the parameters `stated_NAME`; the same object for the same arguments.

    A step after those of the plant writes what each measurement states of its accuracy.  With equal values of NAME and
    `stated_NAME` the numbers are those of the plant, to the bit.
    """
    added, steps = Table(), dict(plant.steps)
    for sensor in sensors:
        if sensor.stated is None:
            continue
        names = tuple(name for source in sensor.errors or () for name in source.rows)
        added += Table(tuple(replace(plant.parameters[name], name=PREFIX + name) for name in names))
        steps[f"{sensor.id}_stated"] = Step(_stating(sensor.stated.rows, names), sensor.stated.when)
    if not added.size:
        return plant
    # the steps come last: the random numbers of a step depend on its place
    return replace(plant, id=f"{plant.id}-switchable", parameters=plant.parameters + added, steps=steps)


def _stating(rows: Callable[[Values, Values], dict[str, Any]], names: tuple[str, ...]) -> Callable[..., dict[str, Any]]:
    def function(p: Values, x: Values, u: Values) -> dict[str, Any]:
        own = SimpleNamespace(**{**vars(p), **{name: getattr(p, PREFIX + name) for name in names}})
        return rows(own, x)

    return function


def packed(model: Model, rows: Mapping[str, Any]) -> Vector:
    """The parameters of a `switchable` plant with no source switched off, flat, from those of the plant by name."""
    names = (name for name in model.parameters.names if name.startswith(PREFIX))
    stated = {name: rows[name.removeprefix(PREFIX)] for name in names if name.removeprefix(PREFIX) in rows}
    return model.parameters.pack({**rows, **stated})


def switch_off(model: Model, vector: Vector, sources: Iterable[Source]) -> Vector:
    """The parameters `vector` (n,) with the errors of `sources` switched off."""
    found = vector.copy()
    for source in sources:
        for name in source.rows:
            if name in model.parameters:
                found[model.parameters.slice(name)] = source.off
    return found
