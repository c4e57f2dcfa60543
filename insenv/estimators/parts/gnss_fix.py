"""A GNSS fix at its own time, predicted from a navigation state in the wander-azimuth frame.

The age of a fix is the time from its validity to the end of the last inertial sample, not necessarily a whole number of
samples. Position and velocity of the antenna at that time follow from the present state, the acceleration and rate of the
last sample and the angular acceleration (`insenv.estimators.parts.lever_arm`), so a fix may lie between two samples or be
some tenths of a second late.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.estimators.parts import lever_arm, strapdown
from insenv.estimators.parts.kalman import correlated_again
from insenv.estimators.parts.rows import FIX_HEALTH
from insenv.estimators.parts.rows import counted as counting_counted

OLDEST = 0.5
"""s: of a fix, over which acceleration and angular acceleration are taken as constant.

Velocity errors of a car in a city are up to 1.6 times as large as stated with 0.5 s, and four times with 1 s.
"""


@dataclass(frozen=True)
class Antenna:
    """The antenna at the time of a fix, and what its sensitivities are made of (3 each).

    offset_w: its position relative to the present position of the inertial unit, m. velocity_w: its velocity, m/s.
    arm_b: lever arm at that time in present b components, m. swing_b: velocity of the lever arm's end over the Earth, m/s.
    rate_b: present angular rate relative to the Earth, rad/s. specific_force_w: specific force of the last sample, m/s^2.
    C_wb (3x3): present attitude.
    """

    offset_w: Any
    velocity_w: Any
    arm_b: Any
    swing_b: Any
    rate_b: Any
    specific_force_w: Any
    C_wb: Any


def antenna(p: Any, x: Any, age: Any) -> Antenna:
    """The antenna `age` seconds ago.

    p: row `antenna_lever_arm`. x: rows of `strapdown.STATE` and `lever_arm.MEMORY`, `acceleration_w` and `dt` of the last
    sample.
    """
    C_wb, acceleration = attitude.to_dcm(x.q_wb), x.acceleration_w
    rate = x.previous_delta_angle / x.dt  # that of the middle of the sample
    change = lever_arm.angular_acceleration(x, rate, x.dt)
    earth_rate = geodesy.earth_rate_w(x.q_ew)
    now = rate + change * (x.dt / 2) - C_wb.T @ earth_rate
    arm_then, swing = lever_arm.then(now, change, p.antenna_lever_arm, age)
    return Antenna(
        offset_w=-x.velocity_w * age + acceleration * (age**2 / 2) + C_wb @ arm_then,
        velocity_w=x.velocity_w - acceleration * age + C_wb @ swing,
        arm_b=arm_then,
        swing_b=swing,
        rate_b=now,
        specific_force_w=acceleration - geodesy.normal_gravity_about_axis(earth_rate / geodesy.OMEGA_IE, x.height),
        C_wb=C_wb,
    )


def innovation(x: Any, u: Any, predicted: Antenna) -> Any:
    """Predicted minus measured position (m) and velocity (m/s) of the antenna (6, n). u: rows of `rows.FIX_INPUTS`.

    Down is a difference of heights, as `strapdown.corrected` changes it: 100 km away the tangent plane is 800 m off.
    """
    C_nw = strapdown.C_nw(x.q_ew)
    latitude, longitude, _ = geodesy.geodetic_from_q_ew(x.q_ew)
    measured = geodesy.position_error(u.gnss_latitude, u.gnss_longitude, u.gnss_height, latitude, longitude, x.height)
    return ca.vertcat(C_nw @ predicted.offset_w - measured, C_nw @ predicted.velocity_w - u.gnss_velocity_n)


def present(u: Any) -> Any:
    """1 for each of the six components that the fix has, else 0."""
    return ca.vertcat(1, 1, 1, *[u.gnss_velocity_valid] * 3)


def correlated_variance(p: Any, since: Any) -> Any:
    """Variance (6) to add to a fix because the slow error of its position is partly that of the fix `since` seconds before."""
    return ca.vertcat(correlated_again(p.fix_wander_sigma**2, since, p.fix_wander_time), ca.SX.zeros(3))


def counted(x: Any, present: Any, accept: Any, ratio: Any) -> dict[str, Any]:
    """Rows of `rows.FIX_HEALTH` after a fix, position and velocity apart; arguments (6 each) as for `counting_counted`."""
    return counting_counted(x, FIX_HEALTH.names, (slice(0, 3), slice(3, 6)), present, accept, ratio)
