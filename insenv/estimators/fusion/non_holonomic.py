"""The non-holonomic constraint: wheels move neither sideways nor off the road.

With the axes v of the wheels (forward, right, down), which are those of the odometer,

    v_v,y = v_v,z = 0

Tyres slip sideways in a turn by an angle that grows with the lateral acceleration, and the body pitches and heaves on its
suspension: the constraint's sigma grows with speed.  Its errors last for seconds, so it is used twice a second, and less for
each repetition.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.elementary import maximum, select
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, Spread, gate_row, waited
from insenv.estimators.fusion.error_state import sigma_row
from insenv.estimators.fusion.instruments import states_of
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts.kalman import correlated_again
from insenv.sensors.odometer import LEVER_ARM, ODOMETER, axis
from insenv.sensors.odometer import MOUNTING as NOMINAL_MOUNTING

MOUNTING = next(state for state in states_of(ODOMETER) if state.name == "odometer_mounting_error")
"""The state of the odometer that the constraint shows too."""
UNKNOWN_ARM = 1.5
"""m: standard deviation of the lever arm to the unsteered axle where none is stated."""
TURN = 5.0
"""s: for which a turn of a car lasts."""
STANDSTILL = 1.0
"""m/s: below, wheels that slip cannot be distinguished from wheels that stand."""


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    error = ca.SX(3, 1) if not seen.estimates(MOUNTING.name) else ca.vertcat(0, seen.value(MOUNTING.name))
    velocity_b = seen.body_velocity(p.odometer_lever_arm_b, 0.0)
    return ca.vertcat(*(ca.dot(axis(number, p, error), velocity_b) for number in (1, 2)))


def _due(p: Any, x: Any, u: Any) -> Any:
    again = waited(x.non_holonomic_since, u, p.non_holonomic_interval)
    return select(ca.logic_and(again, ca.sumsqr(x.velocity_w) > STANDSTILL**2), 1.0, 0.0)


def _variance(p: Any, x: Any, u: Any, spread: Spread) -> Any:
    """Sideways: own motion, and the slip angle of the lateral acceleration; up and down: the body's pitch and heave."""
    speed2, lateral = ca.sumsqr(x.velocity_w), u.delta_velocity[1] / u.dt
    moving = ca.vertcat(speed2 * (p.non_holonomic_slip * lateral) ** 2, speed2 * p.non_holonomic_pitch**2)
    return p.non_holonomic_sigma**2 + moving + _by_arm(p, u)


def _by_arm(p: Any, u: Any) -> Any:
    """Variance (2) of omega x (error of the lever arm), sideways and downward; all uses in a turn count as one."""
    rate2 = (u.delta_angle / u.dt) ** 2
    uses = maximum(TURN / maximum(p.non_holonomic_interval, u.dt), 1.0)
    return uses * p.non_holonomic_arm_sigma**2 * ca.vertcat(rate2[0] + rate2[2], rate2[0] + rate2[1])


NON_HOLONOMIC = Aid(
    id="non_holonomic",
    title="the non-holonomic constraint of the wheels",
    size=2,
    what="no velocity sideways and downward",
    unit="m/s",
    causes="the lever arm and the mounting (odometer_lever_arm, odometer_mounting), slip in turns, and whether the vehicle has "
    "wheels",
    residual=_residual,
    holds=("vertical",),
    variance=_variance,
    due=_due,
    parameters=Table((
        LEVER_ARM,
        NOMINAL_MOUNTING,
        sigma_row("non_holonomic_sigma", "Motion of the body against the road, sideways and downward", "m/s", start=0.05),
        sigma_row("non_holonomic_slip", "Slip angle of the wheels per lateral acceleration", "rad s^2/m", start=0.003),
        sigma_row("non_holonomic_pitch", "Pitch of the body against the road", "rad", start=0.01),
        sigma_row("non_holonomic_arm_sigma", "Error of the lever arm to the unsteered axle, each axis", "m"),
        Row("non_holonomic_interval", "Time between uses of the constraint", "s", start=0.5, lower=0.0, upper=3600.0),
        Row("non_holonomic_time", "Correlation time of its error", "s", start=2.0, lower=1e-3, upper=1e9),
        gate_row("non_holonomic"),
    )),
    gate="non_holonomic_gate",
    correlated=lambda p, x, since: ca.repmat(correlated_again(p.non_holonomic_sigma**2, since, p.non_holonomic_time), 2, 1),
)  # fmt: skip
