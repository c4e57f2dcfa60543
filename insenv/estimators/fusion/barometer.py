"""Barometer: height by the pressure of the air, with a constant and a slowly varying error as states.

    height + bias + drift + scale (height gained since the start)

The height gained is that of the velocities, which is known to the speed's error.  The estimated height less the told one of the
start would differ from it by each correction of the height, and the product of an unknown scale and an unknown height would
seem to measure the height: its sigma came out below the limit.
An instrument with the lag T shows the height of T ago, to first order.  Dynamic pressure that enters the static port is a
height error k v^2 / (2 g), counted as noise that lasts.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.tables import Table
from insenv.estimators.fusion.aid import Aid, gate_row, noise_variance
from insenv.estimators.fusion.error_state import constant, drifting
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts.kalman import correlated_again
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors.instruments import BAROMETER

_TOLD = BAROMETER.told
BIAS = constant("barometer_bias", "constant height error of the barometer", "m", 1, _TOLD["barometer_bias_sigma"])
DRIFT = drifting(
    "barometer_drift", "slowly varying height error of the barometer", "m", 1, _TOLD["barometer_drift_sigma"],
    _TOLD["barometer_drift_time"],
)  # fmt: skip
SCALE = constant(
    "barometer_scale", "height error of the barometer per height above the start", "1", 1, _TOLD["barometer_scale_factor_sigma"]
)
STATES = (BIAS, DRIFT, SCALE)


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    offset_w, velocity_w = seen.point(ca.SX.zeros(3), u.barometer_age)
    height = seen.estimated_height - offset_w[2] + p.barometer_lag * velocity_w[2]
    error = seen.value(BIAS.name, 0.0) + seen.value(DRIFT.name, 0.0)
    return height + error + seen.value(SCALE.name, 0.0) * seen.climbed - u.barometer_height


def _dynamic(p: Any, x: Any) -> Any:
    return (p.barometer_speed_error * ca.sumsqr(x.velocity_w) / (2 * STANDARD_GRAVITY)) ** 2


AID = Aid(
    id="barometer",
    title="the barometer",
    size=1,
    what="height",
    causes="the air pressure or the height to which it is set, a port that sees the wind, and its bias and drift sigmas",
    unit="m",
    residual=_residual,
    variance=lambda p, x, u, spread: noise_variance(p.barometer_noise, 0.01) + _dynamic(p, x),
    due=lambda p, x, u: u.barometer_new,
    sensors=("barometer",),
    inputs=BAROMETER.measurement,
    parameters=Table((
        _TOLD["barometer_noise"], _TOLD["barometer_speed_error"], _TOLD["barometer_lag"], _TOLD["barometer_drift_time"],
        gate_row("barometer"),
    )),
    age=lambda u: u.barometer_age,
    gate="barometer_gate",
    correlated=lambda p, x, since: correlated_again(_dynamic(p, x), since, p.barometer_drift_time),
)  # fmt: skip
