"""The rows of `loosely-coupled`: its parameters, state, inputs and outputs."""

from __future__ import annotations

import math

from insenv.core import symmetric
from insenv.core.tables import Row, Table
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.error_model import N
from insenv.estimators.parts.increments import SAMPLE_INPUTS

_DEG = math.pi / 180

PARAMETERS = strapdown.START + Table(
    (
        Row(
            "position_sigma",
            "Standard deviation of the start position, north, east, down",
            "m",
            (3,),
            "n",
            10.0,
            lower=0,
            upper=1e12,
        ),
        Row("velocity_sigma", "Standard deviation of the start velocity", "m/s", (3,), "n", 1.0, lower=0, upper=1e12),
        Row("tilt_sigma", "Standard deviation of the start roll and pitch", "rad", start=1 * _DEG, lower=0, upper=1e12),
        Row("heading_sigma", "Standard deviation of the start heading", "rad", start=5 * _DEG, lower=0, upper=1e12),
        Row("start_gyro_bias", "Gyro bias at the start", "rad/s", (3,), "b", lower=-1, upper=1),
        Row("start_accel_bias", "Accelerometer bias at the start", "m/s^2", (3,), "b", lower=-100, upper=100),
        Row(
            "gyro_bias_sigma",
            "Standard deviation of the gyro bias, at the start and of its drift",
            "rad/s",
            start=1e-6,
            lower=0,
            upper=1e12,
        ),
        Row(
            "accel_bias_sigma",
            "Standard deviation of the accelerometer bias, as above",
            "m/s^2",
            start=1e-2,
            lower=0,
            upper=1e12,
        ),
        Row("gyro_correlation_time", "Correlation time of the gyro bias", "s", start=3600.0, lower=1e-3, upper=1e12),
        Row("accel_correlation_time", "Correlation time of the accelerometer bias", "s", start=3600.0, lower=1e-3, upper=1e12),
        Row("angle_random_walk", "White noise density of the gyros", "rad/s^0.5", start=1e-5, lower=0, upper=1e12),
        Row("velocity_random_walk", "White noise density of the accelerometers", "m/s^1.5", start=1e-3, lower=0, upper=1e12),
        Row("antenna_lever_arm", "From the inertial unit to the antenna", "m", (3,), "b", lower=-1e3, upper=1e3),
        Row("covariance_interval", "Longest stretch between propagations of the covariance", "s", start=0.05, lower=0, upper=1),
        Row(
            "innovation_gate",
            "Innovations beyond so many standard deviations are not used; 0: all are",
            start=5.0,
            lower=0,
            upper=1e12,
        ),
        Row(
            "standing_sigma",
            "Standard deviation of the velocity when said or found to be standing",
            "m/s",
            start=0.02,
            lower=1e-9,
            upper=1e3,
        ),
        Row("standing_window", "Time over which standing is looked for; 0: it is not", "s", start=1.0, lower=0, upper=60.0),
        Row(
            "standing_rate", "Angular rate that engine, wind and people cause at rest", "rad/s", start=5e-3, lower=0, upper=10.0
        ),
        Row("standing_force", "Specific force that they cause", "m/s^2", start=0.05, lower=0, upper=100.0),
        Row("fix_wander_sigma", "Part of a fix's position sigma that changes slowly", "m", (3,), "n", lower=0, upper=1e6),
        Row("fix_wander_time", "Correlation time of that part", "s", start=60.0, lower=1e-3, upper=1e9),
        Row(
            "rotation_error",
            "Gyro scale factor and misalignment: tilt gained when turning through one radian",
            "1",
            lower=0,
            upper=1.0,
        ),
        Row(
            "thrust_error",
            "Accelerometer scale factor and misalignment: part of a change of velocity that is felt wrongly",
            "1",
            lower=0,
            upper=1.0,
        ),
    )
)

INPUTS = SAMPLE_INPUTS + Table(
    (
        Row("gnss_valid", "1 when a fix has come with this sample", lower=0, upper=1),
        Row("gnss_age", "Time from the fix's validity to the end of this sample", "s", lower=-1.0, upper=10.0),
        Row("gnss_latitude", "Latitude of the antenna", "rad", lower=-math.pi / 2, upper=math.pi / 2),
        Row("gnss_longitude", "Longitude of the antenna", "rad", lower=-2 * math.pi, upper=2 * math.pi),
        Row("gnss_height", "Height of the antenna", "m", lower=-12e3, upper=1e6),
        Row("gnss_position_sigma", "Standard deviation of the position", "m", (3,), "n", 1.0, lower=1e-6, upper=1e9),
        Row("gnss_velocity_valid", "1 when the fix has a velocity", lower=0, upper=1),
        Row("gnss_velocity_n", "Velocity of the antenna", "m/s", (3,), "n"),
        Row("gnss_velocity_sigma", "Standard deviation of the velocity", "m/s", (3,), "n", 1.0, lower=1e-6, upper=1e9),
        Row("standing", "1 when the vehicle is known to stand", lower=0, upper=1),
    )
)

STATE = strapdown.STATE + Table(
    (
        Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b"),
        Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b"),
        Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(N),)),
        Row("dt", "Interval of the last sample", "s", start=1.0),
        Row("stretch", "Time since the covariance was propagated", "s"),
        Row("stretch_velocity_w", "Integral of the specific force over that time", "m/s", (3,), "w"),
        Row("stretch_C_wb", "Integral of the attitude matrix over that time", "s", (3, 3), "w"),
        Row("omega_ie_w", "Earth rate at the last sample", "rad/s", (3,), "w"),
        Row("omega_ew_w", "Transport rate at the last sample", "rad/s", (3,), "w"),
        Row("covariance_due", "1 when the covariance is to be propagated"),
        Row("stretch_angle", "Rotation over that time", "rad", (3,), "b"),
        Row("stretch_change_w", "Change of velocity over that time", "m/s", (3,), "w"),
        Row("still_samples", "Samples in the window in which standing is looked for"),
        Row("still_time", "Length of that window so far", "s"),
        Row("still_angle_square", "Sum of its squared delta angles", "rad^2"),
        Row("still_velocity", "Sum of its delta velocities", "m/s", (3,), "b"),
        Row("still_velocity_square", "Sum of their squares", "m^2/s^2"),
        Row("still_change_w", "Change of velocity over it", "m/s", (3,), "w"),
        Row("still_due", "1 when the window is full"),
        Row("standing_now", "1 when the vehicle is said or found to stand"),
        Row("since_fix", "Time since the last fix", "s", start=1e9),
        Row("acceleration_w", "Acceleration over the Earth in the last sample", "m/s^2", (3,), "w"),
        Row("innovation", "Innovation of the last fix: position, then velocity", "m, m/s", (6,), "n"),
        Row("test_ratio", "Innovation over its standard deviation, likewise", "1", (6,), "n"),
        Row("rejected", "Scalar measurements not used because of the gate", "1"),
        Row("refusals", "Fixes in a row with an innovation beyond the gate", "1"),
    )
)

OUTPUTS = strapdown.OUTPUTS + Table(
    (
        Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b"),
        Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b"),
        Row("position_sigma", "Standard deviation of the position", "m", (3,), "n"),
        Row("velocity_sigma", "Standard deviation of the velocity", "m/s", (3,), "n"),
        Row("attitude_sigma", "Standard deviation of the misalignment about north, east, down", "rad", (3,), "n"),
        Row("innovation", "Innovation of the last fix: position, then velocity", "m, m/s", (6,), "n"),
        Row("test_ratio", "Innovation over its standard deviation, likewise", "1", (6,), "n"),
    )
)
