"""The sources of error of a scenario: those of its sensors, gravity and the start; and how each is switched off."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insenv.core.tables import Table, Vector
from insenv.scenario.build import start_errors
from insenv.scenario.description import KnowledgeSection, Scenario
from insenv.scenario.plant import Plant
from insenv.sensors import IMU, Sensor
from insenv.sensors.contract import ErrorSource

GRAVITY = ErrorSource("gravity disturbance", ("gravity_disturbance_n",))
_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Source:
    """A source of error of a scenario.

    name: in tables.  rows, off: parameter rows of the plant, and their value without the error.  start: keys of [knowledge]
    with the values that switch off an error of the start; places: its elements of `start_errors`.
    """

    name: str
    rows: tuple[str, ...] = ()
    off: float = 0.0
    start: Mapping[str, Any] = field(default_factory=dict)
    places: tuple[int, ...] = ()


START = (
    Source("start tilt", start={"roll_error_deg": 0.0, "pitch_error_deg": 0.0}, places=(0, 1)),
    Source("start heading", start={"heading_error_deg": 0.0}, places=(2,)),
    Source("start position", start={"position_error_m": _ZERO}, places=(3, 4, 5)),
    Source("start velocity", start={"velocity_error_mps": _ZERO}, places=(6, 7, 8)),
)
"""The initial errors, reported minus true."""


def sensors_of(scenario: Scenario) -> tuple[Sensor, ...]:
    """The sensors of a scenario's plant, the inertial unit first."""
    return (IMU, *(section.sensor for section in scenario.sensors.values()))


def sources_of(plant: Plant, seeds: Sequence[int]) -> tuple[Source, ...]:
    """The sources of error that a plant has in the runs of `seeds`: those whose value is not that without the error."""
    table, vector = plant.model.parameters, plant.model.parameters.pack(plant.parameters)
    named = [source for sensor in sensors_of(plant.scenario) for source in sensor.errors or ()]
    switchable = [Source(source.name, source.rows, source.off) for source in (*named, GRAVITY) if _is_on(source, table, vector)]
    errors = start_errors(plant.scenario.knowledge, np.array(seeds))
    return (*switchable, *(source for source in START if np.any(errors[:, list(source.places)])))


def _is_on(source: ErrorSource, table: Table, vector: Vector) -> bool:
    # a range that is not stated is a conversion of its largest value, which rounds
    rows = [name for name in source.rows if name in table]
    return any(not np.allclose(vector[table.slice(name)], source.off, rtol=1e-6, atol=0.0) for name in rows)


def unknown_errors(scenario: Scenario) -> tuple[str, ...]:
    """Ids of the sensors whose sources of error are not known."""
    return tuple(sensor.id for sensor in sensors_of(scenario) if sensor.errors is None)


def start_without(scenario: Scenario, sources: Iterable[Source]) -> Scenario:
    """The scenario without the initial errors of `sources`; their stated sigmas stay."""
    keys = {key: value for source in sources for key, value in source.start.items()}
    knowledge: KnowledgeSection = scenario.knowledge.model_copy(update=keys)
    changed = scenario.model_copy(update={"knowledge": knowledge})
    changed._name = scenario.name
    return changed
