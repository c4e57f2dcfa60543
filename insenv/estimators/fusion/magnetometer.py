"""Magnetometer: the Earth's field in the body, with the vehicle's own iron as states.

    (I + S) C_bn (m + G d + a) + h + drift

m is the field at the reported start and G its gradient, as told; d the way from there; a the error of that field (crust,
model, declination); h and S the hard and the soft iron of the vehicle, S diagonal (`magnetometer_soft_iron`) plus couplings.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.tables import Table
from insenv.estimators.fusion.aid import Aid, gate_row, noise_variance
from insenv.estimators.fusion.error_state import constant, drifting
from insenv.estimators.fusion.inertial import coupled
from insenv.estimators.fusion.navigation import Navigation
from insenv.sensors.instruments import MAGNETOMETER

_TOLD = MAGNETOMETER.told
HARD_IRON = constant(
    "hard_iron", "hard iron: constant magnetic field of the vehicle", "T", 3, _TOLD["magnetometer_hard_iron_sigma"], "b"
)
DRIFT = drifting(
    "magnetometer_drift", "slowly varying magnetic field of the vehicle", "T", 3,
    _TOLD["magnetometer_drift_sigma"], _TOLD["magnetometer_drift_time"], "b",
)  # fmt: skip
SOFT_IRON = constant("soft_iron", "soft iron: diagonal of the matrix", "1", 3, _TOLD["magnetometer_soft_iron_sigma"], "b")
COUPLING = constant(
    "soft_iron_coupling", "soft iron: other elements of the matrix, xy, xz, yx, yz, zx, zy", "1", 6,
    _TOLD["magnetometer_coupling_sigma"], "b",
)  # fmt: skip
FIELD = constant(
    "magnetic_field_error", "error of the model of the Earth's magnetic field", "T", 3, _TOLD["magnetic_field_sigma"], "n"
)
STATES = (HARD_IRON, DRIFT, SOFT_IRON, COUPLING, FIELD)


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    way = -seen.offset_n(p.start_latitude, p.start_longitude, p.start_height)
    field_n = p.magnetic_field_n + p.magnetic_field_gradient @ way + seen.value(FIELD.name, ca.SX.zeros(3))
    field_b = seen.axes(u.magnetometer_age).T @ (seen.C_nw.T @ field_n)
    shown = field_b + seen.value(SOFT_IRON.name, ca.SX.zeros(3)) * field_b
    if seen.estimates(COUPLING.name):
        shown = shown + coupled(seen.value(COUPLING.name), field_b)
    return shown + seen.value(HARD_IRON.name, ca.SX.zeros(3)) + seen.value(DRIFT.name, ca.SX.zeros(3)) - u.magnetometer_field_b


AID = Aid(
    id="magnetometer",
    title="the magnetometer",
    size=3,
    what="field in body axes",
    causes="iron and currents near it (hard and soft iron sigmas), the date of the field model, and its axes",
    unit="T",
    residual=_residual,
    variance=lambda p, x, u, spread: ca.repmat(noise_variance(p.magnetometer_noise, 1e-9), 3, 1),
    due=lambda p, x, u: u.magnetometer_new,
    sensors=("magnetometer",),
    inputs=MAGNETOMETER.measurement,
    parameters=Table((
        _TOLD["magnetic_field_n"], _TOLD["magnetic_field_gradient"], _TOLD["magnetometer_noise"], gate_row("magnetometer"),
    )),
    age=lambda u: u.magnetometer_age,
    gate="magnetometer_gate",
)  # fmt: skip
