"""What a car, an aircraft and a multirotor have in common: they follow commands, in gusts, with the vibration of an engine.

Trackers follow the commands of a script; what each kind adds is how its heading moves and how angles and velocity follow from
all of these.  The state has the rows of the heading, the engine, the gusts, the script and the trackers, in this order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from insenv.core.model import Values
from insenv.core.tables import Table
from insenv.vehicles.gusts import Gusts
from insenv.vehicles.phasors import Phasors
from insenv.vehicles.script import Script, Tracker, along_all, derivative_all
from insenv.vehicles.truth import PLACES, SineCosine, Vehicle

Hold = Callable[[Values, Values, Values, Any], dict[str, Any]]


def scripted(
    id: str,
    title: str,
    *,
    parameters: Table,
    script: Script,
    trackers: Sequence[Tracker],
    gusts: Gusts,
    engine: Phasors,
    heading: Table,
    start: Callable[[Values], dict[str, Any]],
    turned: Callable[[Values, Any], dict[str, Any]],
    turning: Callable[[Values], dict[str, Any]],
    angles: Callable[[Values, Values], list[Any]],
    velocity_n: Callable[[Values, Values, Sequence[SineCosine]], Any],
    hold: Hold,
) -> Vehicle:
    """A vehicle that follows a script.

    parameters: beside those of script, gusts and engine.  heading: its rows of the state.  start: ``p -> rows``, of the heading
    and of trackers; those that a command has too are that command without a script.  turned: ``(x, t) -> rows`` of the heading
    t seconds later; turning: ``x -> rows``, their time derivatives.  The others are those of `Vehicle`.
    """
    moving = (*trackers, *gusts.trackers)

    def begun(p: Values, r: Any) -> dict[str, Any]:
        rows = start(p)
        commanded = {row.name: rows[row.name] for row in script.commands if row.name in rows}
        return rows | engine.start(p) | gusts.start(p, r) | script.start(p, commanded)

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        places = engine.along(x)
        for rows, place in zip(places, PLACES, strict=True):
            t = place * p.sample_interval
            rows |= along_all(moving, x, t) | turned(x, t)
        return places

    return Vehicle(
        id=id,
        title=title,
        parameters=parameters + engine.parameters + gusts.parameters + script.parameters,
        state=sum((tracker.state for tracker in trackers), heading + engine.state + gusts.state + script.state),
        along=along,
        derivative=lambda p, x: {**engine.derivative(p, x), **derivative_all(moving, x), **turning(x)},
        angles=angles,
        velocity_n=velocity_n,
        start=begun,
        start_uniforms=gusts.uniforms,
        hold=hold,
        hold_uniforms=gusts.uniforms,
        inputs=script.inputs,
        steps=script.steps,
    )
