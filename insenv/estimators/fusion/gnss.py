"""GNSS: position and velocity of the antenna at the fix's own time; its lever arm, delay and slow error as states.

The fix comes with its age (`insenv.estimators.parts.gnss_fix`): `Navigation.point` gives position and velocity of the
antenna at that time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.elementary import maximum
from insenv.core.tables import Table
from insenv.estimators.fusion.aid import Aid, Spread, gate_row
from insenv.estimators.fusion.instruments import error_states
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts import gnss_fix, rows
from insenv.geodesy import NOMINAL_GRAVITY
from insenv.sensors.gnss import GNSS_STATED, TERMS

STATES = LEVER_ARM, DELAY, WANDER = error_states(TERMS, GNSS_STATED)


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    arm = seen.value(LEVER_ARM.name, p.antenna_lever_arm)
    offset_w, velocity_w = seen.point(arm, u.gnss_age + seen.value(DELAY.name, 0.0))
    shown = seen.C_nw @ offset_w + seen.value(WANDER.name, ca.SX.zeros(3))
    return ca.vertcat(
        shown - seen.offset_n(u.gnss_latitude, u.gnss_longitude, u.gnss_height), seen.C_nw @ velocity_w - u.gnss_velocity_n
    )


def _variance(p: Any, x: Any, u: Any, spread: Spread) -> Any:
    return ca.vertcat(u.gnss_position_sigma, u.gnss_velocity_sigma) ** 2 + _second_order(x, u, spread)


def _white(p: Any, x: Any, u: Any, spread: Spread) -> Any:
    """Without the slow part, which the receiver's sigma contains; a tenth of the variance at least is white."""
    position = u.gnss_position_sigma**2
    white = ca.vertcat(maximum(position - p.fix_wander_sigma**2, 0.1 * position), u.gnss_velocity_sigma**2)
    return white + _second_order(x, u, spread)


def _total(values: Any) -> Any:
    return ca.sum1(values)


JERK = 3.0
"""m/s^3: of a vehicle that brakes or turns, for what linearisation in the delay leaves out of the velocity."""


def _second_order(x: Any, u: Any, spread: Spread) -> Any:
    """Variance (6) of what linearisation leaves out while the delay t and the lever arm l are unknown.

    Second moments of a t^2 / 2 and jerk t^2 / 2 with t normal, and of the products psi x l, w t x l.
    """
    delay, arm, psi = (_total(spread(name)) for name in (DELAY.name, LEVER_ARM.name, "attitude"))
    rate2 = ca.sumsqr(u.delta_angle / u.dt)
    force_w = attitude.to_dcm(x.q_wb) @ (u.delta_velocity / u.dt) + ca.vertcat(0, 0, NOMINAL_GRAVITY)
    bent = 0.75 * ca.sumsqr(force_w) * delay**2
    turned = arm * (psi + rate2 * delay)
    return ca.vertcat(ca.repmat(bent + turned, 3, 1), ca.repmat(0.75 * JERK**2 * delay**2 + rate2 * turned, 3, 1))


WHITE = Aid(
    id="gnss",
    title="GNSS",
    size=6,
    what="position, then velocity",
    unit="m, m/s",
    frame="n",
    residual=_residual,
    variance=_variance,
    due=lambda p, x, u: u.gnss_valid,
    sensors=("gnss",),
    inputs=rows.FIX_INPUTS,
    parameters=rows.LEVER_ARM
    + rows.FIX_WANDER
    + Table((replace(gate_row("gnss"), name="innovation_gate"),)),
    present=lambda p, x, u: gnss_fix.present(u),
    age="gnss_age",
    gate="innovation_gate",
    correlated=lambda p, x, since: gnss_fix.correlated_variance(p, since),
    restarts=True,
    groups=(slice(0, 3), slice(3, 6)),
    renamed=dict(zip(rows.REPORTED, rows.FIX_REPORTED.names, strict=True)),
)  # fmt: skip
"""The aid of a filter that does not estimate the slow error of fixes: repeated fixes count less."""
WANDER_ESTIMATED = replace(WHITE, variance=_white, correlated=None)
"""The aid of a filter that does."""
