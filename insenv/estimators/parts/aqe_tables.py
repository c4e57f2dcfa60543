"""The rows of `aqe-ekf` and `aqe-sukf`: parameters, state, inputs and outputs, and how they are set from what is known."""

from __future__ import annotations

from insenv.core import symmetric
from insenv.core.tables import Row, Table
from insenv.estimators import loosely_coupled_tables
from insenv.estimators.parts import strapdown

N = 16
DQ, GYRO, ACCEL, VELOCITY, POSITION = slice(0, 4), slice(4, 7), slice(7, 10), slice(10, 13), slice(13, 16)
"""The error state: the paper's 13 states, quaternion first, and the position error."""

_SHARED = (
    "velocity_sigma", "tilt_sigma", "heading_sigma", "start_gyro_bias", "start_accel_bias", "gyro_bias_sigma",
    "accel_bias_sigma", "gyro_correlation_time", "accel_correlation_time", "angle_random_walk", "velocity_random_walk",
    "antenna_lever_arm", "position_sigma", "standing_sigma",
)  # fmt: skip

PARAMETERS = (
    strapdown.START
    + Table(tuple(row for row in loosely_coupled_tables.PARAMETERS if row.name in _SHARED))
    + Table((Row("filter_interval", "Longest stretch between time updates", "s", start=1.0, lower=0.0, upper=10.0),))
)

INPUTS = loosely_coupled_tables.INPUTS

STATE = strapdown.STATE + Table((
    Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b"),
    Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b"),
    Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(N),)),
    Row("dt", "Interval of the last sample", "s", start=1.0),
    Row("stretch", "Time since the last time update", "s"),
    Row("stretch_q_wb", "Attitude at the last time update", "1", (4,), "w", (1, 0, 0, 0)),
    Row("stretch_turn", "Rotation since: takes b components to components in b then", "1", (4,), "b then", (1, 0, 0, 0)),
    Row("stretch_velocity", "Integral of the specific force since", "m/s", (3,), "b then"),
    Row("stretch_distance", "Its integral", "m", (3,), "b then"),
    Row("stretch_C", "Integral of the matrix of that rotation", "s", (3, 3), "b then"),
    Row("omega_ie_w", "Earth rate at the last sample", "rad/s", (3,), "w"),
    Row("omega_ew_w", "Transport rate at the last sample", "rad/s", (3,), "w"),
    Row("acceleration_w", "Acceleration over the Earth in the last sample", "m/s^2", (3,), "w"),
    Row("predict_due", "1 when the time update is to be made"),
    Row("innovation", "Innovation of the last fix: position, then velocity", "m, m/s", (6,), "n"),
    Row("test_ratio", "Innovation over its standard deviation, likewise", "1", (6,), "n"),
))  # fmt: skip

OUTPUTS = loosely_coupled_tables.OUTPUTS
