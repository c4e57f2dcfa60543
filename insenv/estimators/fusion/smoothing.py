"""The smoother of a composition: the filter with a record, and the way back (`insenv.estimators.parts.adjoint`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.model import Model, Values
from insenv.core.tables import Table
from insenv.estimators.fusion import arc, unknown_start
from insenv.estimators.fusion.aid import AWAITED, Aid
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.navigation import navigation_corrected
from insenv.estimators.fusion.ways import Way
from insenv.estimators.parts import adjoint, rows, strapdown
from insenv.estimators.parts.kalman import Update


@lru_cache(maxsize=16)
def smoothing_of(filter: Composition, id: str, way: Way | None = None) -> adjoint.Smoothing:
    """Both passes of the smoother `id` of a filter; the same object for the same filter.

    way: the alignment that the filter starts by; None: it starts from the stated attitude.
    """
    if way is not None:
        return _aligned_first(smoothing_of(filter, id), filter, way)
    interval = Table(tuple(replace(row, name=_last(row.name)) for row in filter.interval))
    shear = _shear(filter)
    groups = tuple(
        adjoint.Group(
            filter.state[aid.due_row],
            adjoint.scalar_rows(aid.id, aid.size, filter.n, f"Components of {aid.title}", shear),
            partial(_support, filter, aid),
        )
        for aid in filter.aids
    )
    estimates = tuple(state.name for state in filter.states)
    return adjoint.Smoothing(
        forward=_forward(filter, id, interval, groups, shear),
        backward=_backward(filter, id, interval, groups, shear),
        due="covariance_due",
        groups=groups,
        interval=interval,
        nominal=_nominal(filter),
        n=filter.n,
        seeking=AWAITED.name if filter.awaiting else "",
        corrected=lambda x, error: navigation_corrected(x, arc.along(error, x.covariance), filter.states, filter.places),
        estimates=estimates,
        reported=Table(tuple(dict.fromkeys(row for aid in filter.aids for row in aid.reported))),
    )


def _last(name: str) -> str:
    return f"last_{name}"


def _shear(filter: Composition) -> adjoint.Shear | None:
    """Between which errors a correction shears (`insenv.estimators.fusion.kept_sum`); None: it does not."""
    if not filter.summing:
        return None
    p, x, u = _symbols(filter)
    rows = [place for aid in filter.summing for place in range(*filter.places[aid.added].indices(filter.n))]
    done = Update((), ca.SX.sym("correction", filter.n), x.covariance)
    used = {k for change in filter.fed_back(filter.aids[0], p, x, u, done)[1] for k in change.sparsity().get_triplet()[1]}
    return adjoint.Shear(tuple(rows), tuple(sorted(used)))


def _symbols(filter: Composition) -> tuple[Values, ...]:
    tables = (filter.parameters, filter.state, filter.inputs)
    return tuple(table.symbols(ca.SX.sym(name, table.size)) for name, table in zip("pxu", tables, strict=True))


def _forward(
    filter: Composition, id: str, interval: Table, groups: tuple[adjoint.Group, ...], shear: adjoint.Shear | None
) -> Model:
    """The filter, which also records; an interval ends at a sample that is to be smoothed."""
    recorded = sum((group.rows for group in groups), interval)
    shown = [filter.state["covariance_due"], *(group.flag for group in groups), *recorded, *_nominal(filter)]
    more = Table(tuple(row for row in shown if row.name not in filter.outputs))

    def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
        changed = filter.sample(p, x, u)
        return {**changed, "covariance_due": select(ca.logic_or(changed["covariance_due"], u.smoothed), 1.0, 0.0)}

    def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
        return {**filter.covariance(p, x, u), **{_last(row.name): getattr(x, row.name) for row in filter.interval}}

    def used(aid: Aid) -> Callable[[Any, Any, Any], dict[str, Any]]:
        def step(p: Any, x: Any, u: Any) -> dict[str, Any]:
            done, reported = filter.update(aid, p, x, u)
            changed, changes = filter.fed_back(aid, p, x, u, done)
            sheared = None if shear is None else ca.vertcat(*changes)[:, shear.columns]
            return {**changed, **reported, **adjoint.recorded(aid.id, done, sheared)}

        return step

    changed = {"sample": sample, "covariance": covariance, **{aid.id: used(aid) for aid in filter.aids}}
    model = filter.model
    return replace(
        model,
        id=id,
        title=f"{filter.id} smoothed over the whole run: {filter.title}",
        state=model.state + recorded,
        inputs=model.inputs + rows.SMOOTHED_INPUT,
        outputs=model.outputs + more,
        steps={name: replace(step, function=changed.get(name, step.function)) for name, step in model.steps.items()},
        output=lambda p, x: {**filter.output(p, x), **{row.name: getattr(x, row.name) for row in more}},
    )


def _aligned_first(smoothing: adjoint.Smoothing, filter: Composition, way: Way) -> adjoint.Smoothing:
    """The smoother of a filter that finds its attitude first; smoothing: that of the filter without it."""
    model, seeking = unknown_start.aligned_first(smoothing.forward, filter, way), unknown_start.SEEKING
    shown = rows.chosen(model.state, seeking)
    forward = replace(
        model,
        title=f"{model.title}, smoothed from there on",
        outputs=model.outputs + shown,
        output=lambda p, x: {**smoothing.forward.output(p, x), seeking: getattr(x, seeking)},
    )
    return replace(
        smoothing,
        forward=forward,
        nominal=smoothing.nominal + shown,
        seeking=seeking,
        corrected=lambda x, error: navigation_corrected(
            x, arc.along(error, x.covariance, arc.WITH_PLACE), filter.states, filter.places
        ),
    )


def _nominal(filter: Composition) -> Table:
    seeking = (AWAITED.name,) if filter.awaiting else ()
    estimates = (*(state.name for state in filter.states), "covariance")
    return rows.chosen(filter.state, *strapdown.NAVIGATION_STATE.names, *estimates, *seeking)


def _support(filter: Composition, aid: Aid) -> tuple[int, ...]:
    """The states that the aid's components can depend on: those of an update, which takes long to write out."""
    p, x, u = _symbols(filter)
    used = {k for scalar in filter.update(aid, p, x, u)[0].scalars for k in scalar.H.sparsity().get_triplet()[1]}
    return tuple(sorted(used))


def _backward(
    filter: Composition, id: str, interval: Table, groups: tuple[adjoint.Group, ...], shear: adjoint.Shear | None
) -> Model:
    def transition(p: Any, u: Any) -> Any:
        return filter.transition(p, Values(**{row.name: getattr(u, _last(row.name)) for row in filter.interval}))

    times = tuple(dict.fromkeys(state.time for state in filter.states if state.time))
    return adjoint.backward_model(
        f"{id}-backward", filter.n, rows.chosen(filter.parameters, *times), groups, interval, transition, shear
    )
