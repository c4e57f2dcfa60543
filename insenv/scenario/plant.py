"""The plant, a vehicle's truth and its sensors as one model; and `Plant`, a scenario that is ready to run.

One advance is one inertial sample.  The outputs after it are the measurements, and the truth at the end of the sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from insenv.base.errors import InputError, naming
from insenv.base.remarks import Remark
from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.tables import Row, Table, Vector
from insenv.estimators import Estimator, Knowledge, get
from insenv.estimators.settings import Settings, choices_in, settings_of
from insenv.scenario.description import Scenario
from insenv.scenario.inputs import Commanded, commanded_rows
from insenv.sensors import GNSS, IMU, Sensor
from insenv.vehicles import Vehicle, truth_instant, truth_part

CLOCK = Part(
    parameters=Table(
        (SEED, Row("sample_interval", "Time from one inertial sample to the next", "s", start=0.005, lower=1e-4, upper=1.0))
    ),
    state=Table((STEP, Row("time", "Time since the start", "s"))),
    steps={"sample": Step(lambda p, x, u: {"step": x.step + 1, "time": (x.step + 1) * p.sample_interval})},
)

TRUTH = ("q_nb", "velocity_n", "latitude", "longitude", "height", "true_delta_angle", "true_delta_velocity")


def plant_model(vehicle: Vehicle, sensors: Sequence[Sensor] = (IMU, GNSS)) -> Model:
    """The plant of a vehicle with `sensors`; a sensor can use the rows of those before it.

    Outputs: `time`, the truth (`TRUTH`), and the outputs of each sensor (`Sensor.outputs`, `Sensor.truth`, `Sensor.derived`).
    """
    if not isinstance(vehicle, Vehicle):
        raise InputError(f"vehicle = {vehicle!r}: allowed is an insenv.Vehicle")
    with naming(f"vehicle {vehicle.id!r}"):
        instant = truth_instant(vehicle)
        parts = [truth_part(vehicle), CLOCK]
    state = sum((part.state for part in parts), Table())
    names: tuple[str, ...] = ("time", *TRUTH)
    for sensor in sensors:
        with naming(f"sensor {sensor.id!r}"):
            part = sensor.part(instant)
            if not isinstance(part, Part):
                raise InputError(f"part gave {part!r}: allowed is an insenv.core.compose.Part")
            parts.append(part)
            state += part.state
            names += tuple(state[name].name for name in (*sensor.outputs, *sensor.truth))
    derived = [(sensor.derived, sensor.derive) for sensor in sensors]
    outputs = sum((table for table, _ in derived), Table(tuple(state[name] for name in names)))

    def output(p: Any, x: Any) -> dict[str, Any]:
        shown = {name: getattr(x, name) for name in names}
        for _, derive in derived:
            shown |= derive(p, x) if derive is not None else {}
        return shown

    return merge(f"plant-{vehicle.id}", f"{vehicle.title}, with its sensors", parts, outputs, output)


@dataclass(frozen=True, eq=False)
class Plant:
    """A scenario ready to run.

    model, parameters: for `insenv.core.runner.make_runner`.  sample_interval, duration_s: s.  samples: number of
    inertial samples.  knowledge: initial knowledge of the estimators.  commands: of the scenario, see `inputs`.
    """

    scenario: Scenario
    model: Model
    parameters: dict[str, Any]
    sample_interval: float
    samples: int
    duration_s: float
    seed: int
    knowledge: Knowledge
    commands: Commanded = ()

    @property
    def in_place(self) -> bool:
        """Whether the vehicle stays in place, within metres."""
        return self.scenario.vehicle.in_place

    @property
    def sensors(self) -> frozenset[str]:
        """Ids of the sensors other than the inertial unit."""
        return frozenset(self.scenario.sensors)

    def inputs(self, begin: int, count: int) -> Vector | None:
        """Inputs (count, inputs.size) of the samples from `begin` on; None if the scenario has no commands."""
        return commanded_rows(self.model, self.commands, begin, count)

    @cached_property
    def tunings(self) -> dict[str, dict[str, Any]]:
        """Parameter rows (SI) that the scenario sets, by estimator id."""
        return self.scenario.tunings

    def adapted(self, estimator: str | Estimator, settings: Settings | None = None, *, offline: bool = True) -> Estimator:
        """The estimator that runs on this plant (`Estimator.adapted`), with the names that the scenario or `settings` give.

        offline: as in `parameters_of`.  Raises `InputError` if there is none.
        """
        chosen = get(estimator)
        choices = {**self.scenario.choices_of(chosen), **choices_in(chosen, settings_of(chosen, settings))}
        return chosen.adapted(self.knowledge, self.scenario.drive(offline), choices)

    def parameters_of(
        self, estimator: Estimator, rows: Mapping[str, Any] | None = None, *, offline: bool = True
    ) -> dict[str, Any]:
        """Parameters (SI, by row name) of an estimator for this plant; `rows` replace those of the scenario.

        offline: whether the whole run is available, for a smoother's backward pass.  Raises `InputError` if the
        estimator cannot run on this scenario.
        """
        parameters = estimator.parameters(self.knowledge, self.tunings, rows)
        estimator.check(self.scenario.drive(offline), parameters)
        return parameters

    def notes_of(self, estimator: Estimator, rows: Mapping[str, Any] | None = None) -> tuple[Remark, ...]:
        """What must be said, before it runs, of an estimator that may be stopped at any time; `rows`: see `parameters_of`."""
        table = estimator.model.parameters
        parameters = table.unpack(table.pack(self.parameters_of(estimator, rows, offline=False)))
        tuned = estimator.understated(self.knowledge, self.tunings, rows)
        return (*estimator.without_effect(self.tunings), *tuned, *estimator.notes(parameters, self.duration_s))
