"""Error states and aids of a fusion filter from the declarations of instruments (`insenv.sensors.instrument`).

An aid evaluates the measurement equation of its instrument at the estimate, at the time of the measurement, with the errors
that the filter estimates; those that it does not estimate are 0 there, and noise that lasts where the instrument says so.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, select, wrap_angle
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, Spread, beyond_linear, gate_row, noise_variance, repeated
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.error_model import TILT, VELOCITY
from insenv.estimators.parts.kalman import correlated_again
from insenv.sensors.instrument import Estimated, Instrument, Term, assumed, errors_of

STARTS = 100.0
"""m/s: a larger standard deviation of the velocity is that of a filter that starts from this measurement."""


class EstimatedMotion:
    """A navigation state less its error `age` seconds ago, as instruments see it (`insenv.sensors.instrument.Motion`)."""

    def __init__(self, seen: Navigation, age: Any, p: Any) -> None:
        self._seen, self._age, self._p = seen, age, p

    @property
    def specific_force_b(self) -> Any:
        return self._seen.specific_force_b

    @property
    def height(self) -> Any:
        offset_w, _ = self._seen.point(ca.SX.zeros(3), self._age)
        return self._seen.estimated_height - offset_w[2]

    @property
    def climbed(self) -> Any:
        return self._seen.climbed

    @property
    def velocity_down(self) -> Any:
        """m/s."""
        _, velocity_w = self._seen.point(ca.SX.zeros(3), self._age)
        return velocity_w[2]

    @property
    def speed_squared(self) -> Any:
        return ca.sumsqr(self._seen.velocity_w)

    @property
    def displacement_n(self) -> Any:
        p = self._p
        return -self._seen.offset_n(p.start_latitude, p.start_longitude, p.start_height)

    def to_body(self, vector_n: Any) -> Any:
        return self._seen.axes(self._age).T @ (self._seen.C_nw.T @ vector_n)

    def to_navigation(self, vector_b: Any) -> Any:
        return self._seen.C_nw @ (self._seen.axes(self._age) @ vector_b)

    def body_velocity(self, arm_b: Any, flow_n: Any = None) -> Any:
        velocity_b = self._seen.body_velocity(arm_b, self._age)
        return velocity_b if flow_n is None else velocity_b - self.to_body(flow_n)


class PresentMotion:
    """The estimated state of a filter at a sample, as what instruments say of noise that lasts and of their use sees it."""

    def __init__(self, x: Any) -> None:
        self._x = x

    @property
    def speed_squared(self) -> Any:
        return ca.sumsqr(self._x.velocity_w)

    def to_navigation(self, vector_b: Any) -> Any:
        return strapdown.C_nw(self._x.q_ew) @ (attitude.to_dcm(self._x.q_wb) @ vector_b)


@cache
def states_of(instrument: Instrument) -> tuple[ErrorState, ...]:
    """The error states of a filter with the instrument."""
    return error_states(instrument.terms, instrument.stated_errors, instrument.stated)


def error_states(terms: Iterable[Term], stated: Table, further: tuple[Row, ...] = ()) -> tuple[ErrorState, ...]:
    """The error states of a filter with an instrument of these errors and stated rows; further: those that are no error's."""
    return tuple(
        _state(term, state, elements, stated, further)
        for term in terms
        for state, (_, elements) in zip(term.states, term.parts, strict=False)
    )


def _state(term: Term, state: Estimated, elements: tuple[int, ...], stated: Table, further: tuple[Row, ...]) -> ErrorState:
    of_term = [row for row in term.stated if row is not term.time]
    sigma = assumed(stated[state.sigma or of_term[term.states.index(state)].name], state.assumed)
    time = (stated[state.time],) if state.time else () if term.time is None else (term.time,)
    start = (stated[state.start],) if state.start else ()
    size = len(state.elements or elements)
    return ErrorState(
        Row(state.name, f"Estimated {state.meaning}", term.unit, (size,), term.frame),
        sigma=sigma.name,
        rows=Table((*start, sigma, *time, *(further if state.start_sigma is not None else ()))),
        time=time[0].name if time else "",
        started=(lambda p: getattr(p, state.start)) if state.start else None,
        started_sigma=state.start_sigma,
    )


def _estimated(instrument: Instrument, seen: Navigation) -> dict[str, Any]:
    """The errors that a filter estimates, by the names of the terms."""
    values: dict[str, Any] = {}
    for term in instrument.terms:
        columns = term.shape[1] if len(term.shape) == 2 else 1
        for state, (_, elements) in zip(term.states, term.parts, strict=False):
            if not seen.estimates(state.name):
                continue
            value = values.setdefault(term.name, ca.SX(*(term.shape + (1, 1))[:2]))
            for number, element in enumerate(state.elements or elements):
                value[element // columns, element % columns] = seen.value(state.name)[number]
    return values


@cache
def aid_of(instrument: Instrument) -> Aid:
    """The aid of a filter that compares the measurements of the instrument with its estimate."""
    id, row = instrument.id, instrument.compared
    stated = instrument.stated_errors

    def residual(p: Any, seen: Navigation, u: Any) -> Any:
        motion = EstimatedMotion(seen, getattr(u, instrument.age), p)
        values = _estimated(instrument, seen)
        if instrument.lag is not None:
            values[instrument.lag.name] = instrument.lag.estimate(motion, p)
        off = instrument.measure(motion, errors_of(instrument, values), p)[row.name] - getattr(u, row.name)
        return wrap_angle(off) if instrument.angle else off

    def variance(p: Any, x: Any, u: Any, spread: Spread) -> Any:
        sigma = getattr(u, instrument.sigma) if instrument.sigma else getattr(p, instrument.noise.stated[0].name)
        noise = noise_variance(sigma, instrument.least_sigma.get(row.name, 0.0))
        if instrument.turned:
            noise = noise + beyond_linear(spread, ca.sumsqr(x.velocity_w))
        if instrument.turned and row.size == 3:
            noise = maximum(noise, _product(x, getattr(x, f"{id}_count")))
        if instrument.lasting is not None and not instrument.sigma:  # a reported standard deviation contains it
            noise = noise + instrument.lasting(PresentMotion(x), p)[0]
        return repeated(noise, row.size)

    def correlated(p: Any, x: Any, since: Any) -> Any:
        assert instrument.lasting is not None
        lasting, time = instrument.lasting(PresentMotion(x), p)
        return repeated(correlated_again(lasting, since, time), row.size)

    def present(p: Any, x: Any, u: Any) -> Any:
        assert instrument.usable is not None
        return repeated(select(instrument.usable(PresentMotion(x), p), 1.0, 0.0), row.size)

    return Aid(
        id=id,
        title=instrument.called,
        size=row.size,
        what=instrument.what,
        causes=instrument.causes,
        holds=instrument.holds,
        unit=row.unit,
        residual=residual,
        variance=variance,
        due=lambda p, x, u: getattr(u, instrument.new),
        sensors=(id,),
        inputs=instrument.measurement,
        parameters=Table((*(stated[name] for name in instrument.aid_parameters), gate_row(id))),
        present=None if instrument.usable is None else present,
        age=instrument.age,
        gate=f"{id}_gate",
        correlated=None if instrument.lasting is None else correlated,
        iterated=instrument.shows_heading,
        added=_added(instrument) if instrument.shows_heading else "",
    )


def _added(instrument: Instrument) -> str:
    """Name of the state of the constant error that adds to the measured vector; empty: none."""
    row = instrument.compared
    adding = (t for t in instrument.terms if t.kind == "constant" and (t.shape, t.frame) == (row.shape, row.frame))
    return next((state.name for term in adding for state in term.states), "")


def _product(x: Any, count: Any) -> Any:
    """Mean square (m^2/s^2) of psi x xi, which linearisation leaves out of a velocity in body axes.

    xi is the error of velocity (w) beside that of the axes.  It is large after a time without velocities; a filter that starts
    from this measurement, or has not used the instrument before, has none.
    """
    P = symmetric.full(x.covariance, TILT.stop)
    by_axes = ca.horzcat(ca.SX.eye(3), -skew(x.velocity_w))
    errors = [*range(VELOCITY.start, VELOCITY.stop), *range(TILT.start, TILT.stop)]
    shared = by_axes @ P[errors, errors]  # of xi with velocity and psi
    square = ca.trace(shared @ by_axes.T)
    product = square * ca.trace(P[TILT, TILT]) + 2 * ca.sumsqr(shared[:, 3:])
    return select(ca.logic_and(count > 0, square < STARTS**2), product, 0.0)
