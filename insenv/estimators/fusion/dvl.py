"""Doppler velocity log: velocity of the ship over the ground, or through water that flows, in the log's axes.

(1 + k) C(e)^T C_bw (v - current + omega x l)     k scale factor (speed of sound), e misalignment
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, select
from insenv.core.tables import Table
from insenv.estimators.fusion.aid import Aid, Spread, beyond_linear, gate_row, noise_variance
from insenv.estimators.fusion.error_state import constant, drifting
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts.error_model import TILT, VELOCITY
from insenv.sensors.instruments import DVL

TAKEN = 100.0
"""m/s: a larger standard deviation is that of a filter that starts from this measurement."""
_TOLD = DVL.told
SCALE = constant("dvl_scale", "scale factor of the Doppler velocity log", "1", 1, _TOLD["dvl_scale_factor_sigma"])
MISALIGNMENT = constant(
    "dvl_misalignment", "misalignment of the Doppler velocity log", "rad", 3, _TOLD["dvl_misalignment_sigma"], "b"
)
CURRENT = drifting(
    "current", "current of the water: north, east", "m/s", 2, _TOLD["dvl_current_sigma"], _TOLD["dvl_current_time"], "n"
)
STATES = (SCALE, MISALIGNMENT, CURRENT)


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    velocity = seen.body_velocity(p.dvl_lever_arm_b, u.dvl_age)
    if seen.estimates(CURRENT.name):
        current_n = ca.vertcat(seen.value(CURRENT.name), 0)
        velocity = velocity - seen.axes(u.dvl_age).T @ (seen.C_nw.T @ current_n)
    turned = velocity - skew(seen.value(MISALIGNMENT.name, ca.SX.zeros(3))) @ velocity
    return (1 + seen.value(SCALE.name, 0.0)) * turned - u.dvl_velocity_b


def _variance(p: Any, x: Any, u: Any, spread: Spread) -> Any:
    noise = noise_variance(p.dvl_noise, 1e-3) + beyond_linear(spread, ca.sumsqr(x.velocity_w))
    return ca.repmat(maximum(noise, _product(x)), 3, 1)


def _product(x: Any) -> Any:
    """Mean square (m^2/s^2) of psi x xi, which linearisation leaves out of the velocity in body axes.

    xi is the error of velocity (w) beside that of the axes.  It is large after a time without velocities; a filter that starts
    from this measurement, or has not used the log before, has none.
    """
    P = symmetric.full(x.covariance, TILT.stop)
    by_axes = ca.horzcat(ca.SX.eye(3), -skew(x.velocity_w))
    errors = [*range(VELOCITY.start, VELOCITY.stop), *range(TILT.start, TILT.stop)]
    shared = by_axes @ P[errors, errors]  # of xi with velocity and psi
    square = ca.trace(shared @ by_axes.T)
    product = square * ca.trace(P[TILT, TILT]) + 2 * ca.sumsqr(shared[:, 3:])
    return select(ca.logic_and(x.dvl_count > 0, square < TAKEN**2), product, 0.0)


AID = Aid(
    id="dvl",
    title="the Doppler velocity log",
    size=3,
    what="velocity in body axes",
    causes="its scale factor, mounting, lever arm and latency, and whether it tracks the ground or the water (current)",
    unit="m/s",
    residual=_residual,
    variance=_variance,
    due=lambda p, x, u: u.dvl_new,
    sensors=("dvl",),
    inputs=DVL.measurement,
    parameters=Table((_TOLD["dvl_lever_arm_b"], _TOLD["dvl_noise"], gate_row("dvl"))),
    age=lambda u: u.dvl_age,
    gate="dvl_gate",
)
