"""The alignments by which a filter finds its start: by the velocity of GNSS (`BY_FIXES`, `BY_TURNS`), or by a Doppler log.

A `Way` is an alignment as `insenv.estimators.fusion.unknown_start` takes it: its model, which instrument starts the filter,
what it hands over, and what is said of it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select
from insenv.core.model import Model, Values
from insenv.estimators import every_heading
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.error_model import ACCEL, GYRO, POSITION, TILT, VELOCITY, bias_sigma
from insenv.estimators.velocity_integration import estimator as integration
from insenv.estimators.velocity_integration import source
from insenv.estimators.velocity_integration.wahba import VelocityIntegration, q_ni

BIASES = slice(GYRO.start, ACCEL.stop)
UNKNOWN_VELOCITY, UNKNOWN_BY_LOG = 1e2, 1e4
"""m/s: standard deviation before the first velocity.  One in body axes shows the heading if that is not far above the speed."""
Handed = Callable[[Any, Values, Any, Any, Any, Any, Any], tuple[Any, Any, dict[str, Any]]]
"""``(p, state, x, P, prior, taken, back)`` to the filter's covariance (n x n, w) but for the position, velocity (3, w), rows.

p, state: of the alignment; x, P: state and covariance (n x n) of the filter before; prior: its variances (n) at the start.
taken (3): 1 for the components of psi that the alignment gives.  back (4): the turn from its attitude to the one that is
taken, with which its errors turn.
"""


@dataclass(frozen=True, eq=False)
class Way:
    """An alignment that starts a filter.

    aid: whose measurement starts the filter; arrives: the input row that is 1 with it.  starts_before: whether the filter
    starts from the alignment as it is before that measurement, which then is the filter's alone.  means: by what it finds the
    heading; shows: what shows it, for messages.  prepare: its parameters.  handed: see `Handed`.
    """

    model: Model
    aid: str
    arrives: str
    starts_before: bool
    means: str
    shows: str
    prepare: Callable[[Knowledge], dict[str, Any]]
    handed: Handed


def _by_circle(p: Any, state: Values, x: Any, P: Any, prior: Any, taken: Any, back: Any) -> tuple[Any, Any, dict[str, Any]]:
    """What `every_heading` hands over: attitude, velocity and biases.

    A bias that is smaller than the one that the alignment counts, because the filter has states for the rest, has the share of
    the estimate that its variance has.
    """
    found = every_heading.answer(state)
    turn = attitude.to_dcm(back) @ strapdown.C_nw(x.q_ew).T @ found.C_nl
    remaining, before = 1 - taken, P[TILT, TILT]
    for part in (POSITION, VELOCITY, TILT):
        P[part, :] = P[:, part] = 0
    sigmas = ca.vertcat(ca.repmat(bias_sigma(p), 3, 1), ca.repmat(p.accel_bias_sigma, 3, 1))
    share = ca.diag(_share(prior[BIASES], sigmas))
    here = slice(VELOCITY.start, ACCEL.stop)
    into = ca.diagcat(taken[2] * turn, ca.diag(taken) @ turn, share)
    P[here, here] = into @ found.P @ into.T
    P[BIASES, BIASES] += (ca.SX.eye(6) - share) @ ca.diag(prior[BIASES])
    P[TILT, TILT] = _second_order(P[TILT, TILT], taken) + before * (remaining @ remaining.T)
    P[VELOCITY, VELOCITY] += (1 - taken[2]) * UNKNOWN_VELOCITY**2 * ca.SX.eye(3)
    start = ca.vertcat(p.start_gyro_bias, p.start_accel_bias)
    biases = start + share @ (ca.vertcat(found.gyro_bias, found.accel_bias) - start)
    velocity = select(taken[2], turn @ found.velocity_l, x.velocity_w)
    return P, velocity, {"gyro_bias": biases[:3], "accel_bias": biases[3:]}


def _share(variance: Any, sigma: Any) -> Any:
    """The part of a bias of standard deviation `sigma` that one of variance `variance` is."""
    return minimum(variance / maximum(sigma, 1e-30) ** 2, 1.0)


def _second_order(stated: Any, taken: Any) -> Any:
    """Covariance (3x3) with the products of two errors, which linearisation leaves out."""
    return stated + ca.trace(stated) ** 2 * ca.diag(taken)


def _by_integration(
    unknown_velocity: float, p: Any, state: Values, x: Any, P: Any, prior: Any, taken: Any, back: Any
) -> tuple[Any, Any, dict[str, Any]]:
    """What velocity integration hands over: the attitude, the errors of whose level belong to biases in body axes.

    Their covariance, that with the biases too, is the one that the alignment states; its rotation vector has the other sign
    than psi.  A bias that is smaller than the one that the alignment counts has the share of the covariance that its variance
    has.  unknown_velocity: standard deviation, m/s.
    """
    C_wi = attitude.to_dcm(back) @ strapdown.C_nw(x.q_ew).T @ attitude.to_dcm(q_ni(state, state.q_i0i))
    turn = ca.SX(3, source.N)
    turn[:, source.ANSWER] = turn[:, source.DRIFT] = C_wi
    shared = turn @ symmetric.full(state.covariance, source.N)
    stated = _second_order((shared @ turn.T + p.thrust_error**2 * ca.SX.eye(3)) * (taken @ taken.T), taken)
    for part in (POSITION, VELOCITY):
        P[part, :] = P[:, part] = 0
    remaining = 1 - taken
    before = P[TILT, :]
    P[TILT, :] = ca.repmat(remaining, 1, P.shape[1]) * before
    by_bias = ca.SX(3, 3)
    for part, theirs, counted in ((GYRO, source.GYRO, bias_sigma(p)), (ACCEL, source.ACCEL, p.accel_bias_sigma)):
        variance = ca.diag(P[part, part])
        coupling = -(taken @ _share(variance, counted).T) * shared[:, theirs]
        P[TILT, part] += coupling
        by_bias += coupling @ ca.diag(1 / maximum(variance, 1e-300)) @ before[:, part].T
    P[:, TILT] = P[TILT, :].T
    apart = by_bias * (taken @ remaining.T)  # what both share through the biases
    P[TILT, TILT] = stated + before[:, TILT] * (remaining @ remaining.T) + apart + apart.T
    P[VELOCITY, VELOCITY] = unknown_velocity**2 * ca.SX.eye(3)
    return P, x.velocity_w, {}


def _integrating(by: VelocityIntegration, shows: str, unknown_velocity: float) -> Way:
    return Way(
        model=by.model,
        aid=by.source.sensor,
        arrives=by.source.arrives,
        starts_before=False,
        means=by.source.means,
        shows=shows,
        prepare=partial(integration.prepare, by),
        handed=partial(_by_integration, unknown_velocity),
    )


BY_FIXES = _integrating(integration.BY_FIXES, "turns, changes of speed and waves show it", UNKNOWN_VELOCITY)
BY_LOG = _integrating(
    integration.BY_LOG,
    "the rotation of the Earth shows it, in minutes, to gyros with a bias far below its horizontal part",
    UNKNOWN_BY_LOG,
)
BY_TURNS = Way(
    model=every_heading.MODEL,
    aid=source.FIXES.sensor,
    arrives=source.FIXES.arrives,
    starts_before=True,
    means=source.FIXES.means,
    shows=f"to gyros that lose it in less than {source.SHORT:g} s turns and changes of speed show it, waves seldom",
    prepare=every_heading.prepare,
    handed=_by_circle,
)


def available(sensors: Collection[str], fix_velocity: bool, known: Knowledge) -> Way | None:
    """The alignment that these sensors allow, or None.  Gyros that lose a heading soon need one that estimates their biases."""
    by = integration.available(sensors, fix_velocity, known)
    if by is not integration.BY_FIXES:
        return None if by is None else BY_LOG
    return BY_TURNS if lose_heading(known) else BY_FIXES


def lose_heading(known: Knowledge) -> bool:
    """Whether the gyros of a unit lose a heading soon, in less than `source.SHORT`."""
    return source.kept_for(integration.gyro_bias_of(known)) < source.SHORT
