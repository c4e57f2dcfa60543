"""The rows of `ecef-kf`: its parameters, state, inputs and outputs."""

from __future__ import annotations

import math

from insenv.core import symmetric
from insenv.core.tables import Row, Table
from insenv.estimators import q_method
from insenv.estimators.ecef_model import N
from insenv.estimators.parts.increments import SAMPLE_INPUTS

_TURN = 2 * math.pi


def _new(rows: tuple[Row, ...], table: Table) -> Table:
    """`rows` and those of `table` that have other names."""
    names = {row.name for row in rows}
    return Table(rows + tuple(row for row in table if row.name not in names))


PARAMETERS = _new((
    Row("latitude", "Geodetic latitude", "rad", lower=-math.pi / 2, upper=math.pi / 2),
    Row("longitude", "Longitude", "rad", lower=-_TURN, upper=_TURN),
    Row("height", "Height over the ellipsoid", "m", lower=-12e3, upper=1e5),
    Row("start_roll", "Roll at the start", "rad", lower=-_TURN, upper=_TURN),
    Row("start_pitch", "Pitch at the start", "rad", lower=-_TURN, upper=_TURN),
    Row("start_heading", "Heading at the start", "rad", lower=-_TURN, upper=_TURN),
    Row("start_velocity_n", "Velocity at the start", "m/s", (3,), "n", lower=-1e4, upper=1e4),
    Row("tilt_sigma", "Standard deviation of roll and pitch at the start of the filter", "rad", start=0.01, lower=0, upper=10),
    Row("heading_sigma", "Standard deviation of heading there", "rad", start=0.05, lower=0, upper=10),
    Row("coarse_time", "Length of the coarse alignment before the filter; 0: the start attitude is as told", "s", lower=0),
    Row("moving", "0: the velocity is known to be zero; 1: it is that of the fixes", lower=0, upper=1),
    Row("velocity_sigma", "Standard deviation of the velocity from zero", "m/s", start=3e-4, lower=1e-9, upper=1e3),
    Row("velocity_sigma_start", "Standard deviation of the velocity at the start", "m/s", start=0.1, lower=1e-9, upper=1e3),
    Row("sway_sigma", "Standard deviation of an expected sway's velocity; what is seen comes on top", "m/s", lower=0),
    Row("sway_time", "Displacement of a sway over its velocity: a period over 2 pi", "s", start=1.5, lower=0, upper=1e3),
    Row("sway_interval", "Time between observations on a swaying base", "s", start=10.0, lower=0, upper=60.0),
    Row("learning_time", "Time over which the variance of sway is learnt", "s", start=60.0, lower=0.1, upper=1e6),
    Row("update_interval", "Time between observations; 0: every two samples", "s", start=0.1, lower=0, upper=1.0),
    Row("angle_random_walk", "White noise density of the gyros", "rad/s^0.5", start=1e-6, lower=0, upper=1e3),
    Row("velocity_random_walk", "White noise density of the accelerometers", "m/s^1.5", start=1e-4, lower=0, upper=1e3),
    Row("gyro_bias_sigma", "Standard deviation of the gyro bias", "rad/s", start=1e-7, lower=0, upper=10),
    Row("accel_bias_sigma", "Standard deviation of the accelerometer bias", "m/s^2", start=1e-3, lower=0, upper=100),
    Row("gyro_correlation_time", "Time in which the gyro bias wanders by its sigma", "s", start=1e9, lower=1e-3, upper=1e12),
    Row("accel_correlation_time", "The same of the accelerometer bias", "s", start=1e9, lower=1e-3, upper=1e12),
    Row("antenna_lever_arm", "From the inertial unit to the antenna", "m", (3,), "b", lower=-1e3, upper=1e3),
), q_method.MODEL.parameters)  # fmt: skip

INPUTS = SAMPLE_INPUTS + Table((
    Row("gnss_valid", "1 when a fix has come with this sample", lower=0, upper=1),
    Row("gnss_age", "Time from the fix's validity to the end of this sample", "s", lower=-1.0, upper=10.0),
    Row("gnss_latitude", "Latitude of the antenna", "rad", lower=-math.pi / 2, upper=math.pi / 2),
    Row("gnss_longitude", "Longitude of the antenna", "rad", lower=-_TURN, upper=_TURN),
    Row("gnss_height", "Height of the antenna", "m", lower=-12e3, upper=1e6),
    Row("gnss_velocity_valid", "1 when the fix has a velocity", lower=0, upper=1),
    Row("gnss_velocity_n", "Velocity of the antenna", "m/s", (3,), "n"),
    Row("gnss_velocity_sigma", "Standard deviation of the velocity", "m/s", (3,), "n", 1.0, lower=1e-6, upper=1e9),
    Row("standing", "1 when a moving vehicle is known to stand", lower=0, upper=1),
))  # fmt: skip

STATE = _new((
    Row("q_eb", "Attitude after the last pair: takes b components to e components", "1", (4,), "e", (1, 0, 0, 0)),
    Row("velocity_e", "Velocity over the Earth, likewise", "m/s", (3,), "e"),
    Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b"),
    Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b"),
    Row("covariance", "Error covariance, upper triangle by columns", "SI", (symmetric.triangle_size(N),)),
    Row("place", "Latitude, longitude, height", "rad, rad, m", (3,)),
    Row("gravity_e", "Gravity there", "m/s^2", (3,), "e"),
    Row("coarse", "1 during the coarse alignment"),
    Row("coarse_spent", "Time since its start", "s"),
    Row("coarse_over", "1 at its last sample"),
    Row("held_delta_angle", "Delta angle of a pair's first sample", "rad", (3,), "b"),
    Row("held_delta_velocity", "Its delta velocity", "m/s", (3,), "b"),
    Row("held_dt", "Its interval", "s"),
    Row("holding", "1 when a first sample waits for its second"),
    Row("pair_due", "1 when the sample completes a pair"),
    Row("window", "Time since the last observation", "s"),
    Row("window_force_e", "Integral of specific force over it", "m/s", (3,), "e"),
    Row("window_velocity_e", "Integral of velocity over it", "m", (3,), "e"),
    Row("window_C_eb", "Integral of the attitude matrix over it", "s", (3, 3), "e"),
    Row("acceleration_e", "Acceleration in the last pair", "m/s^2", (3,), "e"),
    Row("rate_b", "Angular rate in it, relative to e", "rad/s", (3,), "b"),
    Row("filter_due", "1 when the filter is to run"),
    Row("fix_waiting", "1 when a fix waits for the filter"),
    Row("fix_age", "Its age when the filter runs", "s"),
    Row("fix_velocity_n", "Its velocity", "m/s", (3,), "n"),
    Row("fix_sigma", "Standard deviation of that (root mean square of its components)", "m/s"),
    Row("carry_due", "1 when the place is to be moved"),
    Row("misalignment_e", "What feedback has taken out since the start of the filter", "rad", (3,), "e"),
    Row("excess", "Learnt variance of the velocity from zero", "m^2/s^2", (3,), "e"),
    Row("observing", "Time of all observations", "s"),
    Row("swaying", "1 when sway is seen"),
    Row("innovation", "Last innovation of velocity", "m/s", (3,), "e"),
), q_method.MODEL.state)  # fmt: skip

OUTPUTS = Table((
    Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),
    Row("attitude_sigma", "Standard deviation of the misalignment about north, east, down", "rad", (3,), "n"),
    Row("attitude_covariance", "Covariance of the misalignment", "rad^2", (3, 3), "n"),
    Row("misalignment_e", "What feedback has taken out since the start of the filter", "rad", (3,), "e"),
    Row("gyro_bias", "Estimated gyro bias", "rad/s", (3,), "b"),
    Row("accel_bias", "Estimated accelerometer bias", "m/s^2", (3,), "b"),
    Row("innovation", "Last innovation of velocity", "m/s", (3,), "e"),
))  # fmt: skip
