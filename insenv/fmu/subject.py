"""The subject of an FMU: a model, the values of its parameters, its sample interval and its texts.

The parameters of an estimator are those that it has in a packaged scenario (`USUAL`) of its kind, so that its FMU and a
run can be compared.  The parameters of a plant are those of its scenario.  Settings replace single values.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insenv.base.errors import LISTED, InputError, nearest
from insenv.core.model import Model
from insenv.core.portable import identifier
from insenv.core.tables import Table, Vector
from insenv.estimators import Estimator, get, registry
from insenv.estimators.settings import tuning
from insenv.scenario import USUAL, Plant, Scenario, ScenarioLike, build, load, names
from insenv.scenario.loop import PREFIX, loop_model

DOCUMENTED = "documentation/index.html in the FMU"
"""Where the variables of an FMU are listed."""
_FASTEST, _SLOWEST = 1e4, 0.1
_ESTIMATOR = "estimator."  # prefix of the settings of a loop's estimator


@dataclass(frozen=True, eq=False)
class Subject:
    """An estimator or a plant to export.

    id: its id or the scenario's name; of a loop both.  kind: "estimator", "plant" or "loop", which is a plant with an
    estimator of its measurements behind it.  model: its equations.  parameters: flat, SI.  sample_interval: s.  stop_time: of
    the default experiment, s.  plant: source of the samples of the reference signals.  values_from: a sentence that says where
    the start values come from.  tunable: parameter rows that may be set between steps.  step_is_one_increment: start value of
    this parameter of the FMU of an estimator.
    """

    id: str
    kind: str
    model: Model
    parameters: Vector
    sample_interval: float
    stop_time: float
    plant: Plant
    values_from: str
    smooths: str = ""
    tunable: tuple[str, ...] = ()
    step_is_one_increment: bool = False

    @property
    def identifier(self) -> str:
        """The id as a C identifier."""
        return identifier(self.id)

    @property
    def title(self) -> str:
        """A title in one line."""
        if self.kind != "estimator":
            return f"{self.model.title}: {self.plant.scenario.title}"
        smoothed = self.smooths
        forward = f" (here the forward pass: the estimates of {smoothed}, and what the backward pass needs)" if smoothed else ""
        return self.model.title + forward


def subject(
    what: Estimator | ScenarioLike, settings: Mapping[str, object], estimator: Estimator | str | None = None
) -> Subject:
    """The estimator or the plant of a scenario that `what` names, or is; with `estimator` the plant and it, as a loop.

    Raises `InputError` for an unknown name, for wrong settings, and for an estimator that the scenario does not suit.
    """
    if isinstance(what, Estimator) or (isinstance(what, str) and what in registry.names()):
        if estimator is not None:
            raise InputError(f"estimator {what!r} behind an estimator: allowed is a scenario and an estimator")
        return _estimator(get(what), settings)
    if estimator is not None:
        return _loop(load(what), get(estimator), settings)
    if isinstance(what, str) and not what.endswith(".toml") and what not in names():
        raise InputError(f"no estimator or scenario {what!r}{nearest(what, [*registry.names(), *names()], LISTED)}")
    return _plant(load(what), settings)


def _estimator(estimator: Estimator, settings: Mapping[str, object]) -> Subject:
    name = USUAL[estimator.kind]
    scenario, left = load(name), dict(settings)
    interval = _sample_interval(left.pop("sample_interval", 1.0 / scenario.rate_hz))
    one_increment = left.pop("step_is_one_increment", False)
    if one_increment not in (0, 1) or "dt" not in estimator.model.inputs:
        reason = "allowed is true or false" if "dt" in estimator.model.inputs else f"{estimator.id!r} has no input dt"
        raise InputError(f"step_is_one_increment = {one_increment!r}: {reason}")
    plant = _plant_at(scenario, interval)
    left = {name.removeprefix(f"{estimator.id}."): value for name, value in left.items()}
    estimator = plant.adapted(estimator, {estimator.id: _choices(estimator, left)})
    known = replace(plant.knowledge, sample_interval=interval)
    parameters = estimator.model.parameters.pack(estimator.parameters(known, plant.tunings, _set(estimator, left)))
    return Subject(
        id=estimator.id,
        kind="estimator",
        model=estimator.model,
        parameters=parameters,
        sample_interval=interval,
        stop_time=plant.duration_s,
        plant=plant,
        values_from=_values_from(f"those that {estimator.id} has in the scenario {name}", settings),
        smooths=estimator.smooths,
        tunable=estimator.tunable,
        step_is_one_increment=bool(one_increment),
    )


def _choices(estimator: Estimator, settings: dict[str, Any]) -> dict[str, Any]:
    """The lists of names among the settings (`Estimator.choices`), which are taken out of them."""
    return {name: settings.pop(name) for name in estimator.lists_of_names if name in settings}


def _set(estimator: Estimator, settings: Mapping[str, object]) -> dict[str, Any]:
    """Rows, in SI units, from settings by row name or by name and data-sheet unit.  Raises `InputError`."""
    table = estimator.model.parameters
    _check_booleans(table, settings)
    rows = {name: value for name, value in settings.items() if name in table}
    for name, value in settings.items():
        if name in table:
            continue
        try:
            converted = tuning(estimator, {name: value})
        except InputError as error:
            if "unknown key" not in str(error):
                raise
            allowed = ["sample_interval", "step_is_one_increment", *table.names]
            raise InputError(f"no parameter {name!r} in {estimator.id!r}{nearest(name, allowed, DOCUMENTED)}") from None
        for row, number in converted.items():
            if row in rows:
                raise InputError(f"{row} is set twice, the second time by {name}")
            rows[row] = number
    return rows


def _check_booleans(table: Table, settings: Mapping[str, object]) -> None:
    """Raise `InputError` for true or false as the value of a row that is no flag."""
    for name, value in settings.items():
        if isinstance(value, bool) and not (name in table and table[name].flag):
            raise InputError(f"{name} = {str(value).lower()}: allowed is a number")


def _plant(scenario: Scenario, settings: Mapping[str, object]) -> Subject:
    plant = build(scenario)
    table = plant.model.parameters
    allowed = [name for name in table.names if name != "sample_interval"]
    for name in settings:
        if name not in allowed:
            reason = "; the scenario's rate_hz sets it" if name == "sample_interval" else nearest(name, allowed, DOCUMENTED)
            raise InputError(f"no parameter {name!r} of plant {scenario.name!r} can be set{reason}")
    _check_booleans(table, settings)
    return Subject(
        id=scenario.name,
        kind="plant",
        model=plant.model,
        parameters=table.pack({**plant.parameters, **settings}),
        sample_interval=plant.sample_interval,
        stop_time=plant.duration_s,
        plant=plant,
        values_from=_values_from(f"those of the scenario {scenario.name}", settings),
    )


def _loop(scenario: Scenario, estimator: Estimator, settings: Mapping[str, object]) -> Subject:
    """The plant with the estimator behind it, which starts as in `insenv.runs.simulated`."""
    of_plant = {name: value for name, value in settings.items() if not name.startswith(_ESTIMATOR)}
    alone = _plant(scenario, of_plant)
    if alone.model.parameters.unpack(alone.parameters).get("imu_drop_probability", 0.0) > 0.0:
        raise InputError(
            f"scenario {scenario.name!r} loses inertial samples: `insenv run` interpolates over the gap, which needs the next "
            "sample; an FMU does not have it"
        )
    of_estimator = {name.removeprefix(_ESTIMATOR): settings[name] for name in settings if name not in of_plant}
    estimator = alone.plant.adapted(estimator, {estimator.id: _choices(estimator, of_estimator)}, offline=False)
    rows = _set(estimator, of_estimator)
    started = alone.plant.parameters_of(estimator, rows, offline=False)
    model = loop_model(alone.model, estimator.model)
    return replace(
        alone,
        id=f"{scenario.name}-{estimator.id}",
        kind="loop",
        model=model,
        parameters=np.concatenate([alone.parameters, estimator.model.parameters.pack(started)]),
        tunable=tuple(PREFIX + name for name in estimator.tunable),
    )


def _values_from(origin: str, settings: Mapping[str, object]) -> str:
    changes = f", with {', '.join(settings)} as set at the export" if settings else ""
    return f"The start values of the parameters are {origin}{changes}."


def _plant_at(scenario: Scenario, interval: float) -> Plant:
    """The plant of the scenario, sampled at an interval (s) if its fixes and its motion allow that."""
    if interval != 1.0 / scenario.rate_hz:
        with suppress(InputError):
            return build(scenario.model_copy(update={"rate_hz": 1.0 / interval}))
    return build(scenario)


def _sample_interval(value: object) -> float:
    try:
        interval = float(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        interval = float("nan")
    if not 1 / _FASTEST <= interval <= 1 / _SLOWEST:
        raise InputError(f"sample_interval = {value!r} s: allowed is a number from {1 / _FASTEST:g} to {1 / _SLOWEST:g} s")
    return interval
