"""The loop: a plant and an estimator of its measurements as one model, so that samples stay in the processor's cache.

One advance is one inertial sample: the plant's steps, then the estimator's.  The results are bit-identical to those
of running the plant first and then the estimator on the plant's outputs.

Only lost samples (`imu_valid` 0) are treated differently from `insenv.runs.simulated`, which interpolates over a
gap.  The loop cannot look ahead: it repeats the last sample that arrived, or, before the first one, gives the sample
of a level body at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv.base.errors import InputError
from insenv.core.elementary import select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.geodesy import STANDARD_GRAVITY

PREFIX = "estimator_"
_HELD = ("delta_angle", "delta_velocity")


@lru_cache(maxsize=64)
def loop_model(plant: Model, estimator: Model, prefix: str = PREFIX) -> Model:
    """The model of `plant` followed by `estimator`; the same object for the same pair.

    Parameters, state and outputs: the plant's rows, then the estimator's with `prefix` before their names; inputs:
    the plant's.  An input of the estimator is the plant's output of the same name; `dt` is the plant's parameter
    `sample_interval`; an input that the plant does not have keeps its start value.  Where the plant can lose samples,
    the state rows `estimator_given_delta_angle` and `estimator_given_delta_velocity` hold the sample that the
    estimator gets.

    Raises `InputError` if the estimator is random (its random streams would change the plant's), or if rows do not fit.
    """
    if estimator.is_random:
        raise InputError(f"estimator {estimator.id!r} takes random numbers: it cannot run in the plant's loop")
    wiring = _Wiring(plant, estimator, prefix)
    wired = wiring.wired_rows()
    return Model(
        id=f"{plant.id}-{estimator.id}",
        title=f"{plant.title}; {estimator.title}",
        parameters=plant.parameters + _prefixed(estimator.parameters, prefix),
        state=plant.state + wired + _prefixed(estimator.state, prefix),
        inputs=plant.inputs,
        outputs=plant.outputs + _prefixed(estimator.outputs, prefix),
        steps={**plant.steps, **wiring.steps()},
        output=wiring.output,
        start=wiring.start,
        start_uniforms=plant.start_uniforms,
    )


def _prefixed(table: Table, prefix: str) -> Table:
    return Table(tuple(replace(row, name=prefix + row.name) for row in table))


def unprefixed(values: Values, table: Table, prefix: str = PREFIX) -> Values:
    """The rows of a table among those of the loop, under their own names."""
    return SimpleNamespace(**{row.name: getattr(values, prefix + row.name) for row in table})


class _Wiring:
    """The row of the plant for each input of the estimator, and the functions of the whole model."""

    def __init__(self, plant: Model, estimator: Model, prefix: str) -> None:
        self.plant, self.estimator, self.prefix = plant, estimator, prefix
        self.holds = "imu_valid" in plant.state and all(name in estimator.inputs for name in _HELD)
        # by name of the estimator's input: the plant's state row
        self.rows = {row.name: row.name for row in estimator.inputs if row.name in plant.outputs and row.name != "dt"}
        for name in self.rows:
            if name not in plant.state or plant.state[name].shape != estimator.inputs[name].shape:
                raise InputError(f"{estimator.id!r} takes {name!r}: model {plant.id!r} has no state row of that name and shape")
        if "dt" in estimator.inputs and "sample_interval" not in plant.parameters:
            raise InputError(f"estimator {estimator.id!r} takes 'dt': model {plant.id!r} has no parameter 'sample_interval'")
        if self.holds:
            self.rows |= {name: self._held_row(name) for name in _HELD}

    def _held_row(self, name: str) -> str:
        return f"{self.prefix}given_{name}"

    def wired_rows(self) -> Table:
        """State rows of the sample that the estimator gets, where samples can be lost."""
        rows = []
        for name in _HELD if self.holds else ():
            row = self.plant.state[name]
            rows.append(Row(self._held_row(name), f"The latest {name} that arrived", row.unit, row.shape, row.frame))
        return Table(tuple(rows))

    def steps(self) -> dict[str, Step]:
        """The estimator's steps as steps of the whole; those whose condition can never hold are left out."""
        steps = {f"{self.prefix}hold": Step(self._hold)} if self.holds else {}
        for name, step in self.estimator.steps.items():
            when = step.when
            if when is not None and when in self.estimator.state:
                when = self.prefix + when
            elif when in self.rows:
                when = self.rows[when]
            elif when is not None:
                constant = self.estimator.inputs[when].start
                if not constant:
                    continue
                when = None
            steps[self.prefix + name] = Step(self._step(step), when)
        return steps

    def _step(self, step: Step) -> Callable[..., dict[str, Any]]:
        def function(p: Values, x: Values, u: Values) -> dict[str, Any]:
            return self._named(step.function(*self._rows_of(p, x), self._inputs(p, x)))

        return function

    def _hold(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        return {self._held_row(name): select(x.imu_valid, getattr(x, name), getattr(x, self._held_row(name))) for name in _HELD}

    def output(self, p: Values, x: Values) -> dict[str, Any]:
        """Outputs of both."""
        return {**self.plant.output(p, x), **self._named(self.estimator.output(*self._rows_of(p, x)))}

    def start(self, p: Values, r: Any = None) -> dict[str, Any]:
        """State rows of both at the start."""
        rows: dict[str, Any] = {}
        if self.plant.start is not None:
            rows |= self.plant.start(p, r) if self.plant.start_uniforms else self.plant.start(p)
        if self.holds:
            rows[self._held_row("delta_velocity")] = ca.vertcat(0, 0, -STANDARD_GRAVITY * p.sample_interval)
        if self.estimator.start is not None:
            rows |= self._named(self.estimator.start(unprefixed(p, self.estimator.parameters, self.prefix)))
        return rows

    def _named(self, rows: Mapping[str, Any]) -> dict[str, Any]:
        return {self.prefix + name: value for name, value in rows.items()}

    def _rows_of(self, p: Values, x: Values) -> tuple[Values, Values]:
        """Parameters and state of the estimator, under its own names."""
        return unprefixed(p, self.estimator.parameters, self.prefix), unprefixed(x, self.estimator.state, self.prefix)

    def _inputs(self, p: Values, x: Values) -> Values:
        """The estimator's inputs."""
        constants = self.estimator.inputs.symbols(ca.SX(ca.DM(self.estimator.inputs.start_vector())))
        values = {**vars(constants), **{name: getattr(x, row) for name, row in self.rows.items()}}
        if "dt" in values:
            values["dt"] = p.sample_interval
        return SimpleNamespace(**values)
