"""A filter that starts without an attitude: velocity integration finds it, and the filter starts from it.

A linearised filter with a heading sigma of 180 deg settles on a wrong one: the first change of velocity, and at once a velocity
in body axes, seem to show a heading near the one it assumes.  `insenv.estimators.velocity_integration` needs no start attitude
and states its accuracy.  So until level and heading are known to `LINEAR_TILT` and `HEADING_BOUND`,

- no aid measures;
- each velocity that the alignment measures, of GNSS or of a Doppler log, starts the filter anew: its level, with the
  covariance, is that of the alignment once that is known to `LINEAR_TILT` or better than before, its heading where that is
  better than what is known; its velocity is unknown, and the measurement is its first.  So is its position if that is
  a fix; by a log it is that of the alignment.

The rows of the alignment have the names of `velocity-integration` behind `PREFIX`; after the start its steps do not run.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import degrees, radians
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.base.remarks import declared, remark
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Drive
from insenv.estimators.fusion.aid import Aid
from insenv.estimators.fusion.composition import Composition
from insenv.estimators.fusion.measurement import spread_of
from insenv.estimators.fusion.navigation import Navigation, corrected, linear
from insenv.estimators.fusion.omitted import Omitted
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.applicability import LINEAR_HEADING, LINEAR_TILT
from insenv.estimators.parts.error_model import ACCEL, GYRO, POSITION, TILT, VELOCITY, bias_sigma
from insenv.estimators.parts.finding import Finding, Reached
from insenv.estimators.parts.kalman import innovation_variance
from insenv.estimators.velocity_integration import estimator as alignment
from insenv.estimators.velocity_integration import source, wahba
from insenv.estimators.velocity_integration.wahba import VelocityIntegration, q_ni

PREFIX = "alignment_"
HEADING_BOUND = radians(7.0)
"""rad of heading: of an aircraft with centimetre fixes that starts with 10 deg the NEES was 16 of 9, with 7 deg it was 10."""
UNKNOWN_PLACE = 1e4
"""m: standard deviation before the first fix."""
UNKNOWN_VELOCITY = {alignment.BY_FIXES: 1e2, alignment.BY_LOG: 1e4}
"""m/s: the same before the first velocity.  One in body axes shows the heading if the unknown is not far above the speed."""
LARGEST_PLACE = 1e3
"""m: errors of place and heading count to first order; of a place known to 3 km one run in eight ended 5 sigma off."""
SHARED = (
    "angle_random_walk", "velocity_random_walk", "start_gyro_bias", "start_gyro_bias_error", "antenna_lever_arm",
    "dvl_lever_arm_b", "dvl_noise", "start_latitude", "start_longitude", "start_height",
)  # fmt: skip
"""Parameters that filter and alignment have in common."""

STATE = Table((
    Row("seeking", "1 until the attitude is known well enough to start from"),
    Row("velocity_due", "1 at a measured velocity"),
    Row("gone", "Way over the ground that a log has shown", "m"),
    Row("gained", "Integral of the specific force since the filter was started anew", "m/s", (3,), "w"),
))  # fmt: skip
"""Rows beside those of the alignment, behind `PREFIX` too."""
SEEKING, _VELOCITY, _GONE, _GAINED = (PREFIX + row.name for row in STATE)
_AID = {alignment.BY_FIXES: "gnss", alignment.BY_LOG: "dvl"}
"""The aid whose measurement starts the filter."""
_SHOWN = {
    alignment.BY_FIXES: "turns, changes of speed and waves show it",
    alignment.BY_LOG: "the rotation of the Earth shows it, in minutes, to gyros with a bias far below its horizontal part",
}


def way_of(filter: Composition, known: Knowledge, drive: Drive) -> VelocityIntegration | None:
    """The alignment to start a filter by; None: it starts from the stated attitude, or no aid of it allows one."""
    ids = {aid.id for aid in filter.aids}
    if not _uncertain(known) or ids & {"heading", "magnetometer"}:
        return None
    return alignment.available(ids, drive.fix_velocity, known)


def _uncertain(start: Any) -> Any:
    """Whether a start attitude is too uncertain for a linearised filter.

    start: has the fields or rows `heading_sigma` and `tilt_sigma`, numbers or symbols.
    """
    return ca.logic_or(start.heading_sigma > LINEAR_HEADING, start.tilt_sigma > LINEAR_TILT)


def prepared(way: VelocityIntegration, known: Knowledge) -> dict[str, Any]:
    """Parameter rows of the alignment."""
    return {PREFIX + name: value for name, value in alignment.prepare(way, known).items() if name not in SHARED}


@remark(
    "place-uncertain",
    f"the place at the start is uncertain by {{sigma:.3g}} km: above {LARGEST_PLACE / 1000:.3g} km a start with a Doppler "
    "log alone states sigmas of position and heading that are several times too small; state the place more accurately, or "
    "add GNSS",
)
def far_place(way: VelocityIntegration, parameters: Mapping[str, Any]) -> dict[str, Any] | None:
    """A place that is not known well enough for a start by a log, after which nothing shows it."""
    sigma = float(np.max(parameters["position_sigma"][:2]))
    if way is alignment.BY_FIXES or sigma <= LARGEST_PLACE:
        return None
    return {"sigma": sigma / 1000}


_HEADING_UNKNOWN = declared(
    "heading-not-found",
    f"the heading is not found to {degrees(HEADING_BOUND):.2g} deg (1 sigma): until it is, each measured velocity starts the "
    "filter anew, and no other aid is used; {shows}",
)
_HEADING_REACHED = declared(
    "start-found",
    "heading found after {time} s, to {sigma} deg (1 sigma), {means}; from then on the filter runs with all its aids",
)


def findings(way: VelocityIntegration, parameters: Mapping[str, Any]) -> tuple[Finding | Reached, ...]:
    """What is said of a run that has not found its heading at its end, and when the filter has its start.

    Nothing where the stated attitude suffices.
    """
    if not _uncertain(Values(**parameters)):
        return ()
    return (
        Finding("attitude_sigma", _HEADING_UNKNOWN.filled(shows=_SHOWN[way]), scale=(np.inf, np.inf, HEADING_BOUND)),
        Reached("attitude_sigma", _HEADING_REACHED.filled(means=way.source.means), (LINEAR_TILT, LINEAR_TILT, HEADING_BOUND)),
    )


@lru_cache(maxsize=16)
def model_of(filter: Composition, way: VelocityIntegration) -> Model:
    """The model of `filter` with the alignment before its aids; made once for each filter."""
    return aligned_first(filter.model, filter, way)


def aligned_first(model: Model, filter: Composition, way: VelocityIntegration) -> Model:
    """The same for a model with the steps of `filter`: its own, or that of the forward pass of its smoother."""
    return _Seeking(filter, way).model(model)


def _prefixed(table: Table) -> Table:
    return Table(tuple(replace(row, name=PREFIX + row.name) for row in table))


@dataclass(frozen=True)
class _Seeking:
    """A filter with the alignment that it starts by."""

    filter: Composition
    way: VelocityIntegration

    @property
    def aid(self) -> Aid:
        """The one whose measurement starts the filter."""
        return next(aid for aid in self.filter.aids if aid.id == _AID[self.way])

    @property
    def omitted(self) -> Omitted:
        """What first order omits while the attitude is sought."""
        return Omitted(self.aid, SEEKING, f"{PREFIX}time", _GAINED)

    def turned(self, p: Any, x: Any, u: Any) -> tuple[tuple[slice, Any], ...]:
        """What turns with the attitude, as (error in which it shows, vector in b): arm and change since the fix, or log."""
        if self.way is alignment.BY_LOG:
            return ((VELOCITY, u.dvl_velocity_b),)
        gained = u.delta_velocity / u.dt * u.gnss_age
        arm, turning = p.antenna_lever_arm, ca.cross(u.delta_angle / u.dt, p.antenna_lever_arm)
        return (POSITION, arm + gained * (u.gnss_age / 2)), (VELOCITY, turning + gained)

    def model(self, model: Model) -> Model:
        aids = {aid.id: aid.due_row for aid in self.filter.aids}
        unshared = Table(tuple(row for row in self.way.parameters if row.name not in SHARED))
        return replace(
            model,
            title=f"{model.title}; attitude at the start by {self.way.model.id}",
            parameters=model.parameters + _prefixed(unshared),
            state=model.state + _prefixed(STATE + self.way.model.state),
            steps={
                **{name: _masked(step, aids.values()) for name, step in model.steps.items() if name not in aids},
                "sample": _masked(self.omitted.sampling(model.steps["sample"]), aids.values()),
                "covariance": self.omitted.propagating(model.steps["covariance"]),
                **{PREFIX + name: self.aligning(name, step) for name, step in self.way.model.steps.items()},
                f"{PREFIX}start": Step(self.unless_outlying, when=_VELOCITY),
                **{aid: model.steps[aid] for aid in aids},
                self.aid.id: self.omitted.measuring(model.steps[self.aid.id], self.turned),
            },
            start=self.start,
        )

    def parameters(self, p: Any) -> Values:
        """The parameters as the alignment names them."""
        return Values(**{name: getattr(p, name if name in SHARED else PREFIX + name) for name in self.way.parameters.names})

    def state(self, x: Any) -> Values:
        """The state as the alignment names it."""
        return Values(**{name: getattr(x, PREFIX + name) for name in self.way.model.state.names})

    def start(self, p: Any) -> dict[str, Any]:
        aligning = {PREFIX + name: value for name, value in self.way.start(self.parameters(p)).items()}
        return {**self.filter.start(p), **aligning, SEEKING: select(_uncertain(p), 1.0, 0.0)}

    def aligning(self, name: str, step: Step) -> Step:
        """A step of the alignment."""

        def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
            changed = {PREFIX + row: value for row, value in step.function(self.parameters(p), self.state(x), u).items()}
            return changed | ({_VELOCITY: getattr(u, self.way.source.arrives)} if name == "sample" else {})

        when = {"sample": SEEKING, wahba.MEASURED: _VELOCITY}.get(name, f"{PREFIX}{step.when}")
        return Step(function, when=when)

    def started(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """Start the filter anew, from the answer of the alignment where that is better than what is known."""
        of_way, state, n = self.parameters(p), self.state(x), self.filter.n
        aligned = self.way.output(of_way, state)
        sigma, P = aligned["attitude_sigma"], symmetric.full(x.covariance, n)
        known = ca.diag(P)[TILT]
        # the level that is known turns with gyro biases whose direction an unknown heading hides
        levelled = ca.logic_and(sigma[0] < LINEAR_TILT, sigma[1] < LINEAR_TILT)
        levelled = ca.logic_or(levelled, ca.sumsqr(sigma[:2]) < ca.sum1(known[:2]))
        headed = ca.logic_and(sigma[2] < wahba.UNKNOWN, sigma[2] ** 2 < known[2])
        taken = ca.vertcat(*[select(better, 1.0, 0.0) for better in (levelled, levelled, headed)])
        left = ca.sqrt(taken * sigma**2 + (1 - taken) * known)
        unknown = ca.logic_or(left[2] > HEADING_BOUND, ca.logic_or(left[0] > LINEAR_TILT, left[1] > LINEAR_TILT))

        q_wb = attitude.multiply(attitude.conjugate(strapdown.wander_quaternion(x.q_ew)), aligned["q_nb"])
        apart = attitude.error_rotation_vector(q_wb, x.q_wb)
        back = attitude.from_rotation_vector((taken - 1) * apart)
        q_wb = attitude.multiply(back, q_wb)
        wrong = ca.SX.zeros(n)
        wrong[TILT] = attitude.error_rotation_vector(q_wb, x.q_wb)
        covariance = _covariance(P, x, of_way, state, taken, back)
        covariance[VELOCITY, VELOCITY] = UNKNOWN_VELOCITY[self.way] ** 2 * ca.SX.eye(3)
        gone: dict[str, Any] = {}
        if self.way is alignment.BY_FIXES:
            covariance[POSITION, POSITION] = UNKNOWN_PLACE**2 * ca.SX.eye(3)
        else:
            # what the velocity in body axes shows of the attitude depends on the velocity
            wrong[VELOCITY] = x.velocity_w - attitude.rotate(q_wb, u.dvl_velocity_b)
            wrong[POSITION], gone = self.placed(p, of_way, x, state, u, q_wb, covariance)
        return {
            **corrected(x, wrong, self.filter.states, self.filter.places),
            "covariance": symmetric.triangle(covariance),
            **_uncounted(self.aid, p, x, u),
            self.aid.due_row: 1.0,
            **gone,
            _VELOCITY: 0.0,
            _GAINED: ca.SX.zeros(3),
            SEEKING: select(unknown, 1.0, 0.0),
            f"{PREFIX}covariance_due": 0.0,
        }

    def unless_outlying(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """`started`, unless the place of a fix is far from where the filter has it: an outlier must not be its first."""
        begun = self.started(p, x, u)
        if self.way is alignment.BY_LOG:
            return begun
        aid = self.aid
        outlying = ca.logic_and(self.outlying(p, x, u), getattr(x, aid.row("refusals")) < aid.max_rejections)
        left = {name: getattr(x, name) for name in begun} | {_VELOCITY: 0.0, aid.due_row: 0.0, f"{PREFIX}covariance_due": 0.0}
        counted = {aid.row(name): getattr(x, aid.row(name)) for name in ("refusals", "refused_count", "count")}
        left, begun = left | {name: value + 1 for name, value in counted.items()}, counted | begun
        return {name: select(outlying, ca.SX(left[name]), ca.SX(begun[name])) for name in begun}

    def outlying(self, p: Any, x: Any, u: Any) -> Any:
        """Whether a component of a fix's place is beyond the gate."""
        aid, filter = self.aid, self.filter
        place = aid.parts[0]

        def residual(error: Any) -> Any:
            return aid.residual(p, Navigation(x, u, filter.states, filter.places, error), u)[place]

        innovation, by_error = linear(residual, filter.n)
        variance = aid.variance(p, x, u, spread_of(x, filter.states, filter.places))[place]
        beyond = ca.SX(0)
        for i in range(innovation.shape[0]):
            allowed = getattr(p, aid.gate) ** 2 * innovation_variance(x.covariance, by_error[i, :], variance[i])
            beyond = ca.logic_or(beyond, innovation[i] ** 2 > allowed)
        return ca.logic_and(beyond, getattr(p, aid.gate) > 0)

    def placed(self, p: Any, of_way: Values, x: Any, state: Values, u: Any, q_wb: Any, P: Any) -> tuple[Any, dict[str, Any]]:
        """Error of the position (3, m, w) by a log, and the row of the way; P: its part of the covariance is written.

        The log has shown a way in body axes, which turns with the attitude.  The alignment levels at the true place, not at the
        one that is taken for it: its error is that of psi and of the rotation that a wrong position is.
        """
        C_wn = strapdown.C_nw(x.q_ew).T
        latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
        error_n = geodesy.position_error(latitude, longitude, x.height, state.latitude, state.longitude, state.height)
        way_w = attitude.rotate(attitude.multiply(q_wb, attitude.conjugate(state.q_ib)), state.way)
        since = minimum(getattr(x, self.aid.row("since")), state.time)  # of the first measurement: since the start
        step = ca.norm_2(u.dvl_velocity_b) * since
        gone = getattr(x, _GONE) + step
        # a drift of the gyros bends the way, by half of its angle in the mean
        mounting = maximum(of_way.dvl_misalignment_sigma**2, minimum((bias_sigma(of_way) * state.time / 2) ** 2, 1.0))
        level = of_way.dvl_scale_factor_sigma**2 + mounting + minimum(ca.trace(P[TILT, TILT]) ** 2, 1.0)
        # of the velocity between two measurements half is not known
        variance = p.position_sigma**2 + gone**2 * ca.vertcat(level, level, mounting) + (step / 2) ** 2
        by_tilt = skew(way_w)
        P[POSITION, :] = by_tilt @ P[TILT, :]
        P[:, POSITION] = P[POSITION, :].T
        P[POSITION, POSITION] = by_tilt @ P[TILT, TILT] @ by_tilt.T + C_wn @ ca.diag(variance) @ C_wn.T
        turned = ca.horzcat(*[geodesy.transport_rate_w(axis, x.q_ew, x.height) for axis in ca.horzsplit(ca.SX.eye(3))])
        psi = P[TILT, :] - turned @ P[POSITION, :]
        P[TILT, :], P[:, TILT] = psi, psi.T
        P[TILT, TILT] = psi[:, TILT] - psi[:, POSITION] @ turned.T
        return C_wn @ error_n - way_w, {_GONE: gone}


def _masked(step: Step, due: Collection[str]) -> Step:
    """A step of the filter; no aid is due while the attitude is sought."""

    def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
        changed = dict(step.function(p, x, u))
        return changed | {name: select(getattr(x, SEEKING), 0.0, changed[name]) for name in due if name in changed}

    return replace(step, function=function)


def _uncounted(aid: Aid, p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The sums of test ratios before the measurement that the filter starts from: after it they are 0."""
    present = ca.SX.ones(aid.size) if aid.present is None else aid.present(p, x, u)
    zero = {aid.row(name): ca.SX.zeros(len(aid.parts)) for name in ("nis_used", "nis_refused", "nis_refused_count")}
    return {**zero, aid.row("nis_used_count"): -ca.vertcat(*[ca.sum1(present[part]) for part in aid.parts])}


def _covariance(P: Any, x: Any, of_way: Values, state: Values, taken: Any, back: Any) -> Any:
    """Covariance (n x n, w) after that, but for position and velocity.  P: before it.  taken (3): 1 for the components of psi
    that the alignment gives.  back (4): the turn from its attitude to the one that is taken, with which its errors turn: those
    of the level belong to biases in body axes.

    Their covariance, that with the biases too, is the one that the alignment states; its rotation vector has the other sign
    than psi.  A bias that is smaller than the one that the alignment counts, because the filter has states for the rest, has
    the share of the covariance that its variance has.
    """
    C_wi = attitude.to_dcm(back) @ strapdown.C_nw(x.q_ew).T @ attitude.to_dcm(q_ni(state, state.q_i0i))
    turn = ca.SX(3, source.N)
    turn[:, source.ANSWER] = turn[:, source.DRIFT] = C_wi
    shared = turn @ symmetric.full(state.covariance, source.N)
    stated = (shared @ turn.T + of_way.thrust_error**2 * ca.SX.eye(3)) * (taken @ taken.T)
    stated += ca.trace(stated) ** 2 * ca.diag(taken)  # products of two errors, which linearisation leaves out
    for part in (POSITION, VELOCITY):
        P[part, :] = P[:, part] = 0
    remaining = 1 - taken
    before = P[TILT, :]
    P[TILT, :] = ca.repmat(remaining, 1, P.shape[1]) * before
    by_bias = ca.SX(3, 3)
    for part, theirs, counted in ((GYRO, source.GYRO, bias_sigma(of_way)), (ACCEL, source.ACCEL, of_way.accel_bias_sigma)):
        variance = ca.diag(P[part, part])
        share = minimum(variance / maximum(counted, 1e-30) ** 2, 1.0)
        coupling = -(taken @ share.T) * shared[:, theirs]
        P[TILT, part] += coupling
        by_bias += coupling @ ca.diag(1 / maximum(variance, 1e-300)) @ before[:, part].T
    P[:, TILT] = P[TILT, :].T
    apart = by_bias * (taken @ remaining.T)  # what both share through the biases
    P[TILT, TILT] = stated + before[:, TILT] * (remaining @ remaining.T) + apart + apart.T
    return P
