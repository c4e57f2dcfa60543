"""Odometer: forward speed of a wheel; and the non-holonomic constraint: wheels move neither sideways nor off the road.

With the axes v of the wheels (forward, right, down), v_v = C(mounting)^T C_bw (v + omega x l),

    odometer   (1 + k + s f_x) v_v,x     k scale factor, s slip per forward specific force
    wheels     v_v,y = v_v,z = 0

Tyres slip sideways in a turn by an angle that grows with the lateral acceleration, and the body pitches and heaves on its
suspension: the constraint's sigma grows with speed.  Its errors last for seconds, so it is used twice a second, and less for
each repetition.
"""

from __future__ import annotations

from dataclasses import replace
from math import radians
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.attitude import skew
from insenv.core.elementary import maximum, select
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, Spread, beyond_linear, gate_row, noise_variance, waited
from insenv.estimators.fusion.error_state import constant, sigma_row
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts.kalman import correlated_again
from insenv.sensors.instruments import ODOMETER

_TOLD = ODOMETER.told
_AXES = Table((_TOLD["odometer_lever_arm_b"], _TOLD["odometer_mounting"]))

SCALE = constant("odometer_scale", "scale factor of the odometer", "1", 1, _TOLD["odometer_scale_factor_sigma"])
SLIP = constant("odometer_slip", "slip of the wheel per forward specific force", "s^2/m", 1, _TOLD["odometer_slip_sigma"])
MOUNTING = constant(
    "odometer_mounting_error", "mounting error of the odometer: pitch, yaw", "rad", 2,
    replace(_TOLD["odometer_mounting_sigma"], start=radians(3.0)), "b",
)  # fmt: skip
STATES = (SCALE, SLIP, MOUNTING)


def _wheels(p: Any, seen: Navigation, age: Any) -> Any:
    """Velocity of the wheels' point in the wheels' axes (3, m/s)."""
    reported = attitude.to_dcm(attitude.from_rotation_vector(p.odometer_mounting))
    velocity = reported.T @ seen.body_velocity(p.odometer_lever_arm_b, age)
    error = seen.value(MOUNTING.name, ca.SX.zeros(2))
    return velocity - skew(ca.vertcat(0, error)) @ velocity


def _odometer(p: Any, seen: Navigation, u: Any) -> Any:
    k, s = seen.value(SCALE.name, 0.0), seen.value(SLIP.name, 0.0)
    forward = _wheels(p, seen, u.odometer_age)[0]
    return (1 + k + s * seen.specific_force_b[0]) * forward - u.odometer_speed


AID = Aid(
    id="odometer",
    title="the odometer",
    size=1,
    what="forward speed",
    unit="m/s",
    causes="its scale factor, lever arm, mounting and latency, wheels that slip or block, and its stated noise",
    residual=_odometer,
    variance=lambda p, x, u, spread: noise_variance(p.odometer_noise, 1e-3) + beyond_linear(spread, ca.sumsqr(x.velocity_w)),
    due=lambda p, x, u: u.odometer_new,
    sensors=("odometer",),
    inputs=ODOMETER.measurement,
    parameters=_AXES + Table((_TOLD["odometer_noise"], gate_row("odometer"))),
    age=lambda u: u.odometer_age,
    gate="odometer_gate",
)

UNTOLD_ARM = 1.5
"""m: standard deviation of the lever arm to the unsteered axle where nothing is told of it."""
TURN = 5.0
"""s: for which a turn of a car lasts."""
STANDSTILL = 1.0
"""m/s: below, wheels that slip are not told from wheels that stand."""


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
    residual=lambda p, seen, u: _wheels(p, seen, 0.0)[1:],
    variance=_variance,
    due=_due,
    parameters=_AXES
    + Table((
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
