"""A fusion filter from its error states and its aids: the tables and the steps of one model.

The mechanization is that of `insenv.estimators.parts.strapdown` and runs at every sample, with the estimated errors taken
out of the increments.  The covariance is propagated once `covariance_interval` has passed or a measurement comes.  The
errors of position, velocity and attitude are those of `insenv.estimators.parts.error_model`; each state that corrects an
increment enters them through the derivative of that correction, summed up in w over the interval, so no motion is lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.core import symmetric
from insenv.core.elementary import select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators.fusion import arc, awaited, azimuth, history, kept_sum
from insenv.estimators.fusion.aid import AWAITED, Aid, repeated
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.measurement import attitude_shown, far, headed, heading_shown, update, wide
from insenv.estimators.fusion.navigation import corrected, corrected_increments, linear
from insenv.estimators.parts import rows, strapdown
from insenv.estimators.parts.error_model import (
    GYRO,
    POSITION,
    TILT,
    VELOCITY,
    Interval,
    bias_of_tilt,
    by_unknown_drift,
    covariance_after,
    navigation_transition,
    variances,
)
from insenv.estimators.parts.kalman import Update, decay, driven_variance, elementary, propagate

NAVIGATION = 9
"""Number of errors of position, velocity and attitude, which come first."""
PRODUCTS = 2.0
"""Factor on what an unknown drift omits: the product of the heading error and the level's own drift counts with it (a car that
stands and drives off, seeds from 451000: NEES of 9 states 9 to 11.5 with 1, 8.5 to 10.6 with 2)."""
FILTER_ROWS = Table((
    Row("covariance_interval", "Longest interval between covariance propagations", "s", start=0.05, lower=0, upper=1),
))  # fmt: skip
SINCE_PROPAGATION = Table((
    Row("since_propagation", "Time since the covariance was propagated", "s"),
    Row("since_propagation_velocity_w", "Integral of the specific force over that time", "m/s", (3,), "w"),
    Row("since_propagation_angle", "Rotation over that time", "rad", (3,), "b"),
    Row("since_propagation_change_w", "Change of velocity over that time", "m/s", (3,), "w"),
    Row("omega_ie_w", "Earth rate at the last sample", "rad/s", (3,), "w"),
    Row("omega_ew_w", "Transport rate at the last sample", "rad/s", (3,), "w"),
    Row("covariance_due", "1 when the covariance is to be propagated"),
))  # fmt: skip
ESTIMATES = rows.chosen(rows.AIDED_OUTPUTS, "position_sigma", "velocity_sigma", "attitude_sigma")


@dataclass(frozen=True, eq=False)
class Composition:
    """A filter of `states` and `aids`.

    id, title: of its model.  states: gyro_bias and accel_bias first, which every filter has.  aids: in the order in which they
    are used at a sample.  covariance_held: a flag row among its parameters: where it is 1, feedback leaves
    the covariance as it is, which is the conventional filter of small angles; None: the covariance turns with the platform.
    gyros_lose_heading: whether their biases turn the attitude by so much, before they are known, that products of errors count.
    Raises `InputError` for a state or an aid that is given twice.
    """

    id: str
    title: str
    states: tuple[ErrorState, ...]
    aids: tuple[Aid, ...]
    covariance_held: Row | None = None
    gyros_lose_heading: bool = False

    def __post_init__(self) -> None:
        for kind, names in (("state", [s.name for s in self.states]), ("aid", [a.id for a in self.aids])):
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise InputError(f"fusion {self.id!r}: {kind} {twice[0]!r} is given twice")

    # --- layout -------------------------------------------------------------------------------------

    @cached_property
    def places(self) -> dict[str, slice]:
        """The slice of each error state in the error (n), by name."""
        places, begin = {}, NAVIGATION
        for state in self.states:
            places[state.name] = slice(begin, begin + state.size)
            begin += state.size
        return places

    @cached_property
    def n(self) -> int:
        """Number of errors."""
        return NAVIGATION + sum(state.size for state in self.states)

    @cached_property
    def entering(self) -> dict[str, tuple[bool, bool]]:
        """By name of the states that correct increments: whether they change the angle, and the velocity."""
        enters = {}
        for state in self.states:
            if state.increments is not None:
                u = Values(delta_angle=ca.SX.sym("a", 3), delta_velocity=ca.SX.sym("v", 3), dt=ca.SX.sym("t"))
                parts = self._columns(state, u, ca.SX.sym("x", state.size))
                enters[state.name] = (parts[0].nnz() > 0, parts[1].nnz() > 0)
        return enters

    @staticmethod
    def _columns(state: ErrorState, u: Any, value: Any) -> tuple[Any, Any]:
        """Derivatives (3 x k each) of the corrected increments, angle and velocity, with respect to the state's error."""
        assert state.increments is not None

        def both(error: Any) -> Any:
            return ca.vertcat(*state.increments(value + error, u.delta_angle, u.delta_velocity, u.dt))  # type: ignore[misc]

        _, by_error = linear(both, state.size)
        return by_error[:3, :], by_error[3:, :]

    @cached_property
    def _sums(self) -> dict[tuple[str, str], Row]:
        """State rows: the sums of those derivatives in w since the covariance was propagated, by state and what it changes.

        Derivatives that are the same, as those of both biases, have one sum.
        """
        u = Values(**{name: ca.SX.sym(name, 3) for name in ("delta_angle", "delta_velocity")}, dt=ca.SX.sym("dt"))
        values = {state.name: ca.SX.sym(state.name, state.size) for state in self.states}
        sums: dict[tuple[str, str], Row] = {}
        begun: list[tuple[Any, Row]] = []
        for state in self.states:
            columns = self._entered(state, values, u)
            for what, _, _ in self._parts(state):
                meaning = f"Effect of {state.name} on the {what} over that time"
                row_of_state = Row(f"since_propagation_{what}_{state.name}", meaning, "SI", (3, state.size), "w")
                sums[state.name, what] = next((row for other, row in begun if _same(other, columns[what])), row_of_state)
                begun.append((columns[what], row_of_state))
        return sums

    @property
    def _sum_rows(self) -> Table:
        return Table(tuple(dict.fromkeys(self._sums.values())))

    @cached_property
    def turning(self) -> ErrorState | None:
        """The state with a rate of w, if there is one (`insenv.estimators.fusion.azimuth`)."""
        return next((state for state in self.states if state.rate_w is not None), None)

    def rate_w(self, x: Any) -> Any:
        """What the rotation of the Earth is more than that of the estimated position (3, rad/s, w); None: nothing."""
        state = self.turning
        return None if state is None or state.rate_w is None else state.rate_w(getattr(x, state.name))

    @property
    def causes(self) -> dict[str, str]:
        """By id of an aid, what to look at where its measurements do not fit (`Estimator.causes`)."""
        return {aid.id: aid.causes for aid in self.aids if aid.causes}

    @cached_property
    def parameters(self) -> Table:
        """The start and its standard deviations, the unit, then the rows of states and aids."""
        parameters = rows.START + rows.START_SIGMAS + rows.START_BIASES
        walks = {"angle_random_walk": 1e-5, "velocity_random_walk": 1e-3}
        parameters += rows.chosen(rows.SENSORS, *walks, **walks) + rows.MOTION_ERRORS + FILTER_ROWS
        further = Table(() if self.covariance_held is None else (self.covariance_held,))
        return _united(parameters, *(state.rows for state in self.states), *(aid.parameters for aid in self.aids), further)

    @cached_property
    def state(self) -> Table:
        """Navigation, errors, covariance, the interval since it was propagated, and the rows of the aids."""
        table = strapdown.STATE + Table(tuple(state.value for state in self.states))
        table += Table((
            Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(self.n),)),
        ))  # fmt: skip
        return _united(table + SINCE_PROPAGATION, self._sum_rows, history.STATE, *(aid.state_rows for aid in self.aids))

    @cached_property
    def inputs(self) -> Table:
        """The inertial sample, and the rows of the aids."""
        return _united(rows.SAMPLE_INPUTS, *(aid.inputs for aid in self.aids))

    @cached_property
    def outputs(self) -> Table:
        """Navigation, the estimated errors with their standard deviations, and what the aids report."""
        sigmas = tuple(
            Row(f"{s.name}_estimate_sigma", f"Standard deviation of {s.name}", s.value.unit, s.value.shape, s.value.frame)
            for s in self.states
        )
        table = rows.NAVIGATION + Table(tuple(state.value for state in self.states)) + ESTIMATES + Table(sigmas)
        return _united(table, *(aid.output_rows for aid in self.aids))

    @cached_property
    def awaiting(self) -> bool:
        """Whether measurements may wait for one that shows the heading (`insenv.estimators.fusion.awaited`)."""
        return any(aid.iterated for aid in self.aids)

    # --- equations ----------------------------------------------------------------------------------

    def start(self, p: Any) -> dict[str, Any]:
        """The stated start; frame w is NED there, so the covariance needs no rotation."""
        of_states = (repeated(state.start_sigma(p), state.size) for state in self.states)
        heading_sigma = p.heading_sigma if self.turning is None else 0.0
        sigma = ca.vertcat(p.position_sigma, p.velocity_sigma, p.tilt_sigma, p.tilt_sigma, heading_sigma, *of_states)
        P = ca.diag(sigma * sigma)
        if self.turning is not None:
            P[VELOCITY, VELOCITY] = P[VELOCITY, VELOCITY] + azimuth.turned_variance(p, p.start_velocity_n) * ca.diag([1, 1, 0])
        for place in (self.places[state.name] for state in self.states if state.less_position):
            P[place, place] = P[place, place] + P[POSITION, POSITION]
            P[place, POSITION] = P[POSITION, place] = -P[POSITION, POSITION]
        shared = bias_of_tilt(p) @ P[TILT, TILT]
        P[GYRO, TILT], P[TILT, GYRO] = shared, shared.T
        P[GYRO, GYRO] = P[GYRO, GYRO] + shared @ bias_of_tilt(p).T
        return {
            **strapdown.start_state(p),
            **{state.name: state.started(p) for state in self.states if state.started is not None},
            "covariance": symmetric.triangle(P),
            **({AWAITED.name: far(Values(covariance=symmetric.triangle(P)))} if self.awaiting else {}),
        }

    def sample(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """One inertial sample: mechanization with the estimated errors taken out of the increments."""
        values = {state.name: getattr(x, state.name) for state in self.states}
        delta_angle, delta_velocity = corrected_increments(self.states, values, u)
        rate_w = self.rate_w(x)
        if rate_w is not None:
            delta_angle = delta_angle - attitude.rotate_inverse(x.q_wb, rate_w * u.dt)
        moved = strapdown.move(x, delta_angle, delta_velocity, u.dt)
        since_propagation, change = x.since_propagation + u.dt, moved.rows["velocity_w"] - x.velocity_w
        stepped = {
            **moved.rows,
            "since_propagation": since_propagation,
            "since_propagation_velocity_w": x.since_propagation_velocity_w + moved.delta_velocity_w,
            "since_propagation_angle": x.since_propagation_angle + delta_angle,
            "since_propagation_change_w": x.since_propagation_change_w + change,
            "omega_ie_w": moved.omega_ie_w if rate_w is None else moved.omega_ie_w + rate_w,
            "omega_ew_w": moved.omega_ew_w,
            **history.followed(x, x.velocity_w, moved.rows["velocity_w"], u.dt),
        }
        for state in self.states:
            columns = self._entered(state, values, u)
            for what, _, _ in self._parts(state):
                name = self._sums[state.name, what].name
                stepped[name] = getattr(x, name) + ca.densify(moved.C_wb @ columns[what])
        event = ca.SX(since_propagation + u.dt / 2 > p.covariance_interval)
        if self.awaiting:
            stepped |= awaited.step(self.aids, x, u.dt)
        for aid in self.aids:
            due = aid.due(p, x, u)
            if aid.iterated:
                stepped[aid.wide_row], stepped[aid.far_row] = due * wide(x, self.n), due * far(x)
            elif self.awaiting:
                due = due * (1 - stepped[AWAITED.name])
            stepped |= {aid.due_row: due, aid.row("since"): getattr(x, aid.row("since")) + u.dt}
            if aid.on_sample is not None:
                stepped |= aid.on_sample(p, x, u, delta_angle, delta_velocity, change)
            event = ca.logic_or(event, due if not aid.triggers else ca.logic_or(due, stepped[aid.triggers]))
        return {**stepped, "covariance_due": select(event, 1.0, 0.0)}

    def _entered(self, state: ErrorState, values: dict[str, Any], u: Any) -> dict[str, Any]:
        """Derivatives (3 x k each) of the increments that enter the mechanization with respect to the error of a state."""
        if state.increments is None:
            return {}

        def both(error: Any) -> Any:
            changed = {**values, state.name: values[state.name] + error}
            return ca.vertcat(*corrected_increments(self.states, changed, u))

        _, by_error = linear(both, state.size)
        return {"angle": by_error[:3, :], "velocity": by_error[3:, :]}

    @cached_property
    def interval(self) -> Table:
        """State rows that `transition` takes: what the samples summed up since the covariance was propagated."""
        names = ("since_propagation", "since_propagation_velocity_w", "omega_ie_w", "omega_ew_w")
        return rows.chosen(SINCE_PROPAGATION, *names) + self._sum_rows

    def transition(self, p: Any, x: Any) -> Any:
        """A (n x n), integral of the error dynamics over an interval; x: the rows `interval`."""
        A = ca.SX(self.n, self.n)
        interval = Interval(x.since_propagation, x.since_propagation_velocity_w, x.omega_ie_w, x.omega_ew_w)
        A[:NAVIGATION, :NAVIGATION] = navigation_transition(interval, geodesy.NOMINAL_GRAVITY)
        for state in self.states:
            place = self.places[state.name]
            for what, part, sign in self._parts(state):
                A[part, place] = sign * getattr(x, self._sums[state.name, what].name)
            if state.time:
                A[place, place] = ca.diag(
                    self._decay(p, state, x.since_propagation) - 1
                )  # may be longer than a correlation time
            elif state.process is not None:
                A[place, place] = elementary(state.process.transition(p, x.since_propagation))
            if state.rate_w is not None:
                A[TILT, place] = -linear(state.rate_w, state.size)[1] * x.since_propagation
        return A

    def _parts(self, state: ErrorState) -> list[tuple[str, slice, int]]:
        """What a state changes, the errors in which that shows, and the sign with which."""
        used = zip(self.entering.get(state.name, (False, False)), _ENTERS, strict=True)
        return [enters for is_used, enters in used if is_used]

    @staticmethod
    def _decay(p: Any, state: ErrorState, duration: Any) -> Any:
        """The factors (k) by which a Gauss-Markov error decays."""
        return repeated(decay(duration, getattr(p, state.time)), state.size)

    def covariance(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """Propagate the covariance and the estimated errors over the samples since the last time."""
        by_rotation, by_thrust = variances(p, x.since_propagation_angle, x.since_propagation_change_w)
        noise = [
            ca.SX.zeros(3),
            ca.repmat(p.velocity_random_walk**2 * x.since_propagation + by_thrust, 3, 1),
            ca.repmat(p.angle_random_walk**2 * x.since_propagation + by_rotation, 3, 1),
        ]
        if self.gyros_lose_heading:
            down_b = attitude.to_dcm(x.q_wb)[2, :].T
            turned = by_unknown_drift(x.covariance, down_b, TILT, self.places["gyro_bias"])
            noise[2] += PRODUCTS * turned * x.since_propagation
        errors: dict[str, Any] = {}
        for state in self.states:
            if state.time:
                decay = self._decay(p, state, x.since_propagation)
                noise.append(driven_variance(repeated(getattr(p, state.sigma), state.size), decay))
                errors[state.name] = decay * getattr(x, state.name)
            elif state.process is not None:
                noise.append(state.process.noise(p, x.since_propagation))
                errors[state.name] = state.process.transition(p, x.since_propagation) @ getattr(x, state.name)
            else:
                noise.append(ca.SX.zeros(state.size))
        return {
            **errors,
            "covariance": propagate(x.covariance, self.transition(p, x), ca.vertcat(*noise)),
            "since_propagation": 0,
            **{row.name: ca.SX.zeros(*(row.shape + (1,))[:2]) for row in self.state if row.name in _EMPTIED},
            **{row.name: ca.SX.zeros(*row.shape) for row in self._sum_rows},
        }

    def used(self, aid: Aid) -> Callable[[Any, Any, Any], dict[str, Any]]:
        """The step of an aid: one measurement, with feedback."""

        def step(p: Any, x: Any, u: Any) -> dict[str, Any]:
            done, reported = self.update(aid, p, x, u)
            return {**self.fed_back(aid, p, x, u, done)[0], **reported}

        return step

    @cached_property
    def summing(self) -> tuple[Aid, ...]:
        """The aids of which a correction keeps the sum (`insenv.estimators.fusion.kept_sum`)."""
        return tuple(aid for aid in self.aids if aid.added in self.places)

    def fed_back(self, used: Aid, p: Any, x: Any, u: Any, done: Update) -> tuple[dict[str, Any], list[Any]]:
        """State rows after an update by an aid, and for each of the aids `summing` the change (m x n) of what it shows."""
        share = 1.0 if self.covariance_held is None else 1.0 - getattr(p, self.covariance_held.name)
        correction = arc.along(done.correction, x.covariance, share=share)
        changed = corrected(x, correction, self.states, self.places)
        stored, changes = covariance_after(done, self.n, share), []
        for aid in self.summing:
            psi = getattr(x, aid.misalignment_row) if aid is used and aid.iterated else None
            value, change = kept_sum.kept(aid, self.states, self.places, p, x, u, correction, changed, psi)
            changed, stored = {**changed, aid.added: value}, kept_sum.covariance_kept(stored, self.places[aid.added], change)
            changes.append(change)
        return {**changed, "covariance": stored}, changes

    def shown(self, aid: Aid) -> Callable[[Any, Any, Any], dict[str, Any]]:
        """The step before that of an aid that is iterated: the attitude that it shows."""
        return lambda p, x, u: {aid.misalignment_row: attitude_shown(aid, self.states, self.places, self.n, p, x, u)}

    def headed(self, aid: Aid) -> Callable[[Any, Any, Any], dict[str, Any]]:
        """The step before both: the heading turned to where it fits best."""

        def step(p: Any, x: Any, u: Any) -> dict[str, Any]:
            angle = heading_shown(aid, self.states, self.places, self.n, p, x, u)
            return headed(x, angle, self.n, self.states, self.places)

        return step

    def update(self, aid: Aid, p: Any, x: Any, u: Any) -> tuple[Update, dict[str, Any]]:
        """One measurement of an aid, and its state rows."""
        return update(aid, self.states, self.places, self.n, p, x, u)

    def output(self, p: Any, x: Any) -> dict[str, Any]:
        """Navigation in n, and standard deviations; psi stands for the misalignment (they differ by position error / R)."""
        P = symmetric.full(x.covariance, self.n)
        shown, P_shown = self._shown(x, P)
        C_nw = strapdown.C_nw(shown.q_ew)

        widened = math.prod(aid.widened(p, x) for aid in self.aids if aid.widened is not None)

        def sigma(part: slice, more: Any = 0.0, common: Any = 0.0) -> Any:
            return widened * ca.sqrt(ca.diag(C_nw @ (P_shown[part, part] + more) @ C_nw.T) + common)

        common = p.fix_common_sigma**2 if "fix_common_sigma" in self.parameters else 0.0

        values = {
            **strapdown.navigation_outputs(shown),
            "position_sigma": sigma(POSITION, common=common),
            "velocity_sigma": sigma(VELOCITY, arc.moment(x.covariance)),
            "attitude_sigma": sigma(TILT) if self.turning is None else azimuth.stated(sigma(TILT)),
        }
        for state in self.states:
            place = self.places[state.name]
            values[state.name] = getattr(x, state.name)
            values[f"{state.name}_estimate_sigma"] = ca.sqrt(ca.diag(P[place, place]))
        for aid in self.aids:
            values |= aid.shown(x)
        return values

    def consistency_error(self, x: Values, outputs: Values, truth: Values) -> tuple[Any, Any]:
        """Errors of position, velocity and psi in the sense of the covariance (`arc`), and it (9x9)."""
        shown, P = self._shown(x, symmetric.full(x.covariance, self.n))
        offset, velocity, turn, _ = strapdown.navigation_error_w(shown, truth)
        error = ca.vertcat(offset, velocity, -turn)
        if self.turning is None:
            error = arc.back(error, x.covariance)
        return error, P[:NAVIGATION, :NAVIGATION]

    def _shown(self, x: Any, P: Any) -> tuple[Any, Any]:
        """The navigation state and the covariance of its errors, with the azimuth that the filter has found."""
        return (x, P) if self.turning is None else azimuth.folded(x, P, self.places)

    @cached_property
    def model(self) -> Model:
        """The filter as a model."""
        between = {name: step for aid in self.aids for name, step in aid.steps.items()}
        return Model(
            id=self.id,
            title=self.title,
            parameters=self.parameters,
            state=self.state,
            inputs=self.inputs,
            outputs=self.outputs,
            steps={
                "sample": Step(self.sample),
                "past": history.STEP,
                **between,
                "covariance": Step(self.covariance, when="covariance_due"),
                **{f"{aid.id}_heading": Step(self.headed(aid), when=aid.far_row) for aid in self.aids if aid.iterated},
                **{f"{aid.id}_attitude": Step(self.shown(aid), when=aid.wide_row) for aid in self.aids if aid.iterated},
                **{aid.id: Step(self.used(aid), when=aid.due_row) for aid in self.aids},
            },
            output=self.output,
            start=self.start,
        )


_ENTERS = (("angle", TILT, 1), ("velocity", VELOCITY, -1))
_DEPTH = 9
"""Levels of an expression that are compared."""
_EMPTIED = ("since_propagation_angle", "since_propagation_change_w", "since_propagation_velocity_w")


def _same(one: Any, other: Any) -> bool:
    """Whether two matrices are the same expression."""
    return one.shape == other.shape and ca.is_equal(one, other, _DEPTH)


def _united(*tables: Table) -> Table:
    """The rows of all tables in order; a row that comes again must be the same one."""
    by_name: dict[str, Row] = {}
    for row in (row for table in tables for row in table):
        if by_name.setdefault(row.name, row) != row:
            raise InputError(
                f"two different rows are named {row.name!r}: an error state or aid must name its rows after itself"
            )
    return Table(tuple(by_name.values()))
