"""Messages of the estimate (attitude, velocity, position and their covariances) and of the truth.

Each function returns the values of a message's fields.  Heights above mean sea level are ellipsoidal heights minus
`View.undulation`.  Messages of an alignment have the known initial position and zero velocity.  Body rates are those of
b relative to n: measured rates minus estimated bias, Earth rate and transport rate.
"""

from __future__ import annotations

from math import degrees, hypot, isfinite, nan, pi, sqrt

import numpy as np

from insenv.mavlink.messages.fields import CENTI_DEG, Values
from insenv.mavlink.messages.view import POSITION_LIMIT, VELOCITY_LIMIT, View

_MAV_FRAME_LOCAL_NED, _MAV_FRAME_BODY_FRD, _MAV_ESTIMATOR_TYPE_GPS_INS, _MAV_ESTIMATOR_TYPE_AUTOPILOT = 1, 12, 5, 8
_SEA_LEVEL_DENSITY = 1.225  # kg/m^3, of the standard atmosphere

# ESTIMATOR_STATUS_FLAGS
_ATTITUDE, _VELOCITY_HORIZ, _VELOCITY_VERT, _POS_HORIZ_REL, _POS_HORIZ_ABS, _POS_VERT_ABS = 1, 2, 4, 8, 16, 32
_PRED_POS_HORIZ_REL, _PRED_POS_HORIZ_ABS, _GPS_GLITCH = 256, 512, 1024


def attitude_quaternion(view: View) -> Values:
    """ATTITUDE_QUATERNION: MAVLink's quaternion is q_nb; its scalar part is made non-negative."""
    q = view.estimate["q_nb"]
    q = q if q[0] >= 0.0 else -q
    return view.time_ms, *q.tolist(), *view.derived("rate_nb_b"), (0.0, 0.0, 0.0, 0.0)


def global_position_int(view: View) -> Values:
    """GLOBAL_POSITION_INT: position, velocity and heading."""
    values, height = view.values, view.estimated("height")
    place = view.place(view.estimated("latitude"), float(values["longitude_wrapped"]), height)
    velocity = (view.estimated_velocity_n * 1e2).tolist()
    heading = float(values["euler"][2])
    heading = round(heading % (2 * pi) * CENTI_DEG) % 36000 if isfinite(heading) else nan
    return view.time_ms, *place, (height - view.home[2]) * 1e3, *velocity, heading


def odometry(view: View) -> Values:
    """ODOMETRY: position from home in n, velocity and rates in b, and their covariances as far as stated.

    The position covariance is diagonal in n; the velocity covariance is diagonal in n and rotated into b, because
    estimators state sigmas only.
    """
    simulation = view.simulation
    return (
        view.time_us, _MAV_FRAME_LOCAL_NED, _MAV_FRAME_BODY_FRD, *view.derived("offset"), view.estimate["q_nb"].tolist(),
        *view.derived("velocity_b", "rate_nb_b"),
        view.derived("pose_covariance"), view.derived("velocity_covariance"), simulation.alignments % 256,
        _MAV_ESTIMATOR_TYPE_GPS_INS if simulation.estimator.aided else _MAV_ESTIMATOR_TYPE_AUTOPILOT, 0,
    )  # fmt: skip


def vfr_hud(view: View) -> Values:
    """VFR_HUD: without wind, airspeed equals speed over the Earth; throttle is not simulated."""
    north, east, down = view.estimated_velocity_n.tolist()
    heading = degrees(float(view.values["euler"][2]))
    heading = round(heading) % 360 if isfinite(heading) else nan
    speed = sqrt(north**2 + east**2 + down**2)
    return speed, hypot(north, east), heading, 0, view.estimated("height") - view.undulation, -down


def altitude(view: View) -> Values:
    """ALTITUDE: altitude_monotonic is the barometer's; the terrain is unknown."""
    height = view.estimated("height")
    relative = height - view.home[2]
    return view.time_us, view.air.pressure_height, height - view.undulation, relative, relative, nan, nan


def estimator_status(view: View) -> Values:
    """ESTIMATOR_STATUS: flags by `VELOCITY_LIMIT` and `POSITION_LIMIT`; ratios are squared innovations divided by the
    squared gate.

    In an outage the present position is not absolute, but predicted by dead reckoning, and there are no innovations.
    """
    estimate = view.estimate
    flags = _ATTITUDE if view.aligned else 0
    velocity_sigma, position_sigma = estimate.get("velocity_sigma"), view.position_sigma
    if velocity_sigma is not None:
        flags |= _VELOCITY_HORIZ if np.max(velocity_sigma[:2]) < VELOCITY_LIMIT else 0
        flags |= _VELOCITY_VERT if velocity_sigma[2] < VELOCITY_LIMIT else 0
    horizontal = vertical = nan
    if position_sigma is not None:
        horizontal, vertical = hypot(*position_sigma[:2].tolist()) / sqrt(2.0), float(position_sigma[2])
        if horizontal < POSITION_LIMIT:
            flags |= _POS_HORIZ_REL | _PRED_POS_HORIZ_REL | _PRED_POS_HORIZ_ABS
            flags |= 0 if view.in_outage else _POS_HORIZ_ABS
        flags |= _POS_VERT_ABS if vertical < POSITION_LIMIT and not view.in_outage else 0
    ratios = [nan, nan, nan]
    gate = view.simulation.estimator_row("innovation_gate")
    if "test_ratio" in estimate and gate and not view.in_outage:
        test = (estimate["test_ratio"] / gate) ** 2
        ratios = [float(np.max(test[3:])), float(np.max(test[:2])), float(test[2])]
        flags |= _GPS_GLITCH if np.max(test) > 1.0 else 0
    return view.time_us, flags, *ratios, nan, nan, nan, horizontal, vertical


def hil_state_quaternion(view: View) -> Values:
    """HIL_STATE_QUATERNION: the truth.  Accelerations are specific forces in the unit `View.hil_acceleration`."""
    truth = view.truth
    velocity = truth["velocity_n"]
    speed = float(np.sqrt(np.dot(velocity, velocity)))
    airspeed = speed * sqrt(max(view.air.density, 0.0) / _SEA_LEVEL_DENSITY)
    place = view.place(float(truth["latitude"]), float(view.values["true_longitude_wrapped"]), float(truth["height"]))
    force = truth["true_delta_velocity"] / view.simulation.interval * view.hil_acceleration
    return (
        view.time_us, truth["q_nb"].tolist(), *view.derived("true_rate_nb_b"), *place, *(velocity * 1e2).tolist(),
        airspeed * 1e2, speed * 1e2, *force.tolist(),
    )  # fmt: skip
