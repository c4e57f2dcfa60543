"""The start of a gyro bias that comes from a time at rest: its error, which the errors of the start attitude share.

At rest a gyro measures its bias and the Earth's rate. The bias is the mean rate minus the Earth's rate in the attitude of
the start, so an error of that attitude leaves a part of the Earth's rate in the bias. With psi the small rotation of
`insenv.estimators.parts.error_model` (the computed attitude is I - [psi x] times the true one) the bias that is left, true
minus estimated, is

    C_bn (psi x w_ie)

times the part of the bias that comes from the rest. The two errors cancel in the rate of the attitude, so a heading that is
found later corrects the bias with it.
"""

from __future__ import annotations

from typing import Any

from insenv import attitude, geodesy
from insenv.core.elementary import select


def bias_of_tilt(p: Any) -> Any:
    """Derivative (3x3) of the start gyro bias that is left (rad/s, b) with respect to psi (rad, n)."""
    C_bn = attitude.to_dcm(attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading)).T
    return -p.start_rest_share * (C_bn @ attitude.skew(geodesy.earth_rate_n(p.start_latitude)))


def bias_sigma(p: Any) -> Any:
    """Standard deviation (rad/s) of the start gyro bias for the start attitude."""
    return select(p.start_gyro_bias_error > 0, p.start_gyro_bias_error, p.gyro_bias_sigma)
