"""A filter that starts without an attitude: an alignment finds it, and the filter starts from it.

A linearised filter with a heading sigma of 180 deg settles on a wrong one: the first change of velocity, and at once a velocity
in body axes, seem to show a heading near the one it assumes.  `insenv.estimators.velocity_integration` needs no start attitude
and states its accuracy; so does `insenv.estimators.every_heading`, for gyros that lose a heading soon
(`insenv.estimators.fusion.ways`).  So until level and heading are known to `LINEAR_TILT` and `HEADING_BOUND`,

- no aid measures;
- each velocity that the alignment measures, of GNSS or of a Doppler log, starts the filter anew: its level, with the
  covariance, is that of the alignment once that is known to `LINEAR_TILT` or better than before, its heading where that is
  better than what is known; its velocity is unknown, and the measurement is its first.  So is its position if that is
  a fix; by a log it is that of the alignment.  A `Way` that starts the filter before the measurement gives a velocity too, and
  biases.

The rows of the alignment have its names behind `PREFIX`; after the start its steps do not run.
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
from insenv.estimators.fusion.ways import BY_LOG, Way, available
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.applicability import LINEAR_HEADING, LINEAR_TILT
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY, bias_sigma
from insenv.estimators.parts.finding import Finding, Reached
from insenv.estimators.parts.kalman import innovation_variance
from insenv.estimators.velocity_integration import wahba

PREFIX = "alignment_"
HEADING_BOUND = radians(7.0)
"""rad of heading: of an aircraft with centimetre fixes that starts with 10 deg the NEES was 16 of 9, with 7 deg it was 10."""
UNKNOWN_PLACE = 1e4
"""m: standard deviation before the first fix."""
LARGEST_PLACE = 1e3
"""m: errors of place and heading count to first order; of a place known to 3 km one run in eight ended 5 sigma off."""
SHARED = (
    "angle_random_walk", "velocity_random_walk", "start_gyro_bias", "start_accel_bias", "start_gyro_bias_error",
    "start_roll", "start_pitch", "tilt_sigma", "antenna_lever_arm", "dvl_lever_arm_b", "dvl_noise", "start_latitude",
    "start_longitude", "start_height",
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


def way_of(filter: Composition, known: Knowledge, drive: Drive) -> Way | None:
    """The alignment to start a filter by; None: it starts from the stated attitude, or no aid of it allows one."""
    ids = {aid.id for aid in filter.aids}
    if not _uncertain(known) or ids & {"heading", "magnetometer"}:
        return None
    return available(ids, drive.fix_velocity, known)


def _uncertain(start: Any) -> Any:
    """Whether a start attitude is too uncertain for a linearised filter.

    start: has the fields or rows `heading_sigma` and `tilt_sigma`, numbers or symbols.
    """
    return ca.logic_or(start.heading_sigma > LINEAR_HEADING, start.tilt_sigma > LINEAR_TILT)


def prepared(way: Way, known: Knowledge) -> dict[str, Any]:
    """Parameter rows of the alignment."""
    return {PREFIX + name: value for name, value in way.prepare(known).items() if name not in SHARED}


@remark(
    "place-uncertain",
    f"the place at the start is uncertain by {{sigma:.3g}} km: above {LARGEST_PLACE / 1000:.3g} km a start with a Doppler "
    "log alone states sigmas of position and heading that are several times too small; state the place more accurately, or "
    "add GNSS",
)
def far_place(way: Way, parameters: Mapping[str, Any]) -> dict[str, Any] | None:
    """A place that is not known well enough for a start by a log, after which nothing shows it."""
    sigma = float(np.max(parameters["position_sigma"][:2]))
    if way is not BY_LOG or sigma <= LARGEST_PLACE:
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


def findings(way: Way, parameters: Mapping[str, Any]) -> tuple[Finding | Reached, ...]:
    """What is said of a run that has not found its heading at its end, and when the filter has its start.

    Nothing where the stated attitude suffices.
    """
    if not _uncertain(Values(**parameters)):
        return ()
    return (
        Finding("attitude_sigma", _HEADING_UNKNOWN.filled(shows=way.shows), scale=(np.inf, np.inf, HEADING_BOUND)),
        Reached("attitude_sigma", _HEADING_REACHED.filled(means=way.means), (LINEAR_TILT, LINEAR_TILT, HEADING_BOUND)),
    )


@lru_cache(maxsize=16)
def model_of(filter: Composition, way: Way) -> Model:
    """The model of `filter` with the alignment before its aids; made once for each filter."""
    return aligned_first(filter.model, filter, way)


def aligned_first(model: Model, filter: Composition, way: Way) -> Model:
    """The same for a model with the steps of `filter`: its own, or that of the forward pass of its smoother."""
    return _Seeking(filter, way).model(model)


def _prefixed(table: Table) -> Table:
    return Table(tuple(replace(row, name=PREFIX + row.name) for row in table))


@dataclass(frozen=True)
class _Seeking:
    """A filter with the alignment that it starts by."""

    filter: Composition
    way: Way

    @property
    def aid(self) -> Aid:
        """The one whose measurement starts the filter."""
        return next(aid for aid in self.filter.aids if aid.id == self.way.aid)

    @property
    def omitted(self) -> Omitted:
        """What first order omits while the attitude is sought."""
        return Omitted(self.aid, SEEKING, f"{PREFIX}time", _GAINED)

    def turned(self, p: Any, x: Any, u: Any) -> tuple[tuple[slice, Any], ...]:
        """What turns with the attitude, as (error in which it shows, vector in b): arm and change since the fix, or log."""
        if self.way is BY_LOG:
            return ((VELOCITY, u.dvl_velocity_b),)
        gained = u.delta_velocity / u.dt * u.gnss_age
        arm, turning = p.antenna_lever_arm, ca.cross(u.delta_angle / u.dt, p.antenna_lever_arm)
        return (POSITION, arm + gained * (u.gnss_age / 2)), (VELOCITY, turning + gained)

    def model(self, model: Model) -> Model:
        aids = {aid.id: aid.due_row for aid in self.filter.aids}
        unshared = Table(tuple(row for row in self.way.model.parameters if row.name not in SHARED))
        return replace(
            model,
            title=f"{model.title}; attitude at the start by {self.way.model.id}",
            parameters=model.parameters + _prefixed(unshared),
            state=model.state + _prefixed(STATE + self.way.model.state),
            steps={
                **{name: _masked(step, aids.values()) for name, step in model.steps.items() if name not in aids},
                "sample": _masked(self.omitted.sampling(model.steps["sample"]), aids.values()),
                "covariance": self.omitted.propagating(model.steps["covariance"]),
                **self.alignment_steps(),
                **{aid: model.steps[aid] for aid in aids},
                self.aid.id: self.omitted.measuring(model.steps[self.aid.id], self.turned),
            },
            start=self.start,
        )

    def alignment_steps(self) -> dict[str, Step]:
        """Those of the alignment, and the one that starts the filter."""
        steps = {PREFIX + name: self.aligning(name, step) for name, step in self.way.model.steps.items()}
        begin = {f"{PREFIX}start": Step(self.unless_outlying, when=_VELOCITY)}
        if not self.way.starts_before:
            return steps | begin
        first = list(steps).index(PREFIX + wahba.MEASURED)
        return dict(list(steps.items())[:first]) | begin | dict(list(steps.items())[first:])

    @property
    def after_start(self) -> dict[str, Any]:
        """Rows after the step that starts the filter: nothing is due any more, unless the alignment takes the velocity then."""
        return {} if self.way.starts_before else {_VELOCITY: 0.0, f"{PREFIX}covariance_due": 0.0}

    def parameters(self, p: Any) -> Values:
        """The parameters as the alignment names them."""
        return Values(
            **{name: getattr(p, name if name in SHARED else PREFIX + name) for name in self.way.model.parameters.names}
        )

    def state(self, x: Any) -> Values:
        """The state as the alignment names it."""
        return Values(**{name: getattr(x, PREFIX + name) for name in self.way.model.state.names})

    def start(self, p: Any) -> dict[str, Any]:
        begin = self.way.model.start
        assert begin is not None
        aligning = {PREFIX + name: value for name, value in begin(self.parameters(p)).items()}
        return {**self.filter.start(p), **aligning, SEEKING: select(_uncertain(p), 1.0, 0.0)}

    def aligning(self, name: str, step: Step) -> Step:
        """A step of the alignment."""

        def function(p: Any, x: Any, u: Any) -> dict[str, Any]:
            changed = {PREFIX + row: value for row, value in step.function(self.parameters(p), self.state(x), u).items()}
            if name == "sample":
                return changed | {_VELOCITY: getattr(u, self.way.arrives)}
            return changed | ({_VELOCITY: 0.0} if name == wahba.MEASURED and self.way.starts_before else {})

        when = {"sample": SEEKING, wahba.MEASURED: _VELOCITY}.get(name, f"{PREFIX}{step.when}")
        return Step(function, when=when)

    def started(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """Start the filter anew, from the answer of the alignment where that is better than what is known."""
        of_way, state, n = self.parameters(p), self.state(x), self.filter.n
        aligned = self.way.model.output(of_way, state)
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
        prior = ca.diag(symmetric.full(self.filter.start(p)["covariance"], n))
        covariance, velocity_w, found = self.way.handed(of_way, state, x, P, prior, taken, back)
        gone: dict[str, Any] = {}
        if self.way is not BY_LOG:
            covariance[POSITION, POSITION] = UNKNOWN_PLACE**2 * ca.SX.eye(3)
            wrong[VELOCITY] = x.velocity_w - velocity_w
        else:
            # what the velocity in body axes shows of the attitude depends on the velocity
            wrong[VELOCITY] = x.velocity_w - attitude.rotate(q_wb, u.dvl_velocity_b)
            wrong[POSITION], gone = self.placed(p, of_way, x, state, u, q_wb, covariance)
        return {
            **corrected(x, wrong, self.filter.states, self.filter.places),
            **found,
            "covariance": symmetric.triangle(covariance),
            **_uncounted(self.aid, p, x, u),
            self.aid.due_row: 1.0,
            **gone,
            **self.after_start,
            _GAINED: ca.SX.zeros(3),
            SEEKING: select(unknown, 1.0, 0.0),
        }

    def unless_outlying(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """`started`, unless the place of a fix is far from where the filter has it: an outlier must not be its first."""
        begun = self.started(p, x, u)
        if self.way is BY_LOG:
            return begun
        aid = self.aid
        outlying = ca.logic_and(self.outlying(p, x, u), getattr(x, aid.row("refusals")) < aid.max_rejections)
        left = {name: getattr(x, name) for name in begun} | {aid.due_row: 0.0, **self.after_start}
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
