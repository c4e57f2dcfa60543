"""Compose one model from parts that share their tables.

A part is a piece of a plant (vehicle, inertial sensor, GNSS receiver).  In the merged model the rows of all parts form
one set of tables, and every function sees all of them by name.  Steps of the same name become one step: each part's
function runs on the state left by the parts before it, so that the inertial sensor measures the motion that the vehicle
has just made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from insenv.base.errors import InputError
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Table, check_mapping

EMPTY = Table()


@dataclass(frozen=True)
class Part:
    """A piece of a model, with the fields of `Model`; its functions see the rows of all merged parts."""

    parameters: Table = EMPTY
    state: Table = EMPTY
    inputs: Table = EMPTY
    steps: Mapping[str, Step] = field(default_factory=dict)
    start: Callable[..., Mapping[str, Any]] | None = None
    start_uniforms: int = 0


def as_part(model: Model) -> Part:
    """A whole model as a part, to be merged with others; its outputs are dropped."""
    m = model
    return Part(m.parameters, m.state, m.inputs, m.steps, m.start, m.start_uniforms)


def merge(
    id: str,
    title: str,
    parts: Sequence[Part],
    outputs: Table,
    output: Callable[[Values, Values], Mapping[str, Any]],
) -> Model:
    """The model made of `parts` in that order; a step takes the place of its first mention.

    Raises `InputError` if steps of one name have different conditions.
    """
    names = list(dict.fromkeys(name for part in parts for name in part.steps))
    return Model(
        id=id,
        title=title,
        parameters=sum((part.parameters for part in parts), Table()),
        state=sum((part.state for part in parts), Table()),
        inputs=sum((part.inputs for part in parts), Table()),
        outputs=outputs,
        steps={name: _joined(name, parts) for name in names},
        output=output,
        start=_in_sequence([(part.start, part.start_uniforms) for part in parts if part.start is not None]),
        start_uniforms=sum(part.start_uniforms for part in parts),
    )


def _joined(name: str, parts: Sequence[Part]) -> Step:
    """The steps called `name` of all parts as one step."""
    steps = [part.steps[name] for part in parts if name in part.steps]
    conditions = {step.when for step in steps}
    if len(conditions) > 1:
        raise InputError(f"step {name!r} has different conditions: {sorted(map(str, conditions))}: allowed is one")

    def function(p: Values, x: Values, u: Values, r: Any = None) -> dict[str, Any]:
        state, first = SimpleNamespace(**vars(x)), 0
        changed: dict[str, Any] = {}
        for step in steps:
            uniforms = (r[first : first + step.uniforms],) if step.uniforms else ()
            first += step.uniforms
            new = check_mapping(step.function(p, state, u, *uniforms))
            vars(state).update(new)
            changed.update(new)
        return changed

    return Step(function, steps[0].when, sum(step.uniforms for step in steps))


def _in_sequence(starts: Sequence[tuple[Callable[..., Mapping[str, Any]], int]]) -> Callable[..., dict[str, Any]]:
    def start(p: Values, r: Any = None) -> dict[str, Any]:
        first = 0
        state: dict[str, Any] = {}
        for function, count in starts:
            uniforms = (r[first : first + count],) if count else ()
            first += count
            state.update(check_mapping(function(p, *uniforms)))
        return state

    return start
