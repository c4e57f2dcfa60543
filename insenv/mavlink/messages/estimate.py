"""Messages of the estimate (attitude, velocity, position and their covariances) and of the truth.

Heights above mean sea level are ellipsoidal heights minus `View.undulation`.  Messages of an alignment have the known
initial position and zero velocity.  Body rates are those of b relative to n: measured rates minus estimated bias, Earth
rate and transport rate.
"""

from __future__ import annotations

from math import degrees, hypot, isfinite, nan, pi, sqrt

import numpy as np

from insenv.mavlink.messages.fields import CENTI_DEG, Message
from insenv.mavlink.messages.view import View, by_name

_MAV_FRAME_LOCAL_NED, _MAV_FRAME_BODY_FRD, _MAV_ESTIMATOR_TYPE_GPS_INS, _MAV_ESTIMATOR_TYPE_AUTOPILOT = 1, 12, 5, 8
_SEA_LEVEL_DENSITY = 1.225  # kg/m^3, of the standard atmosphere

# ESTIMATOR_STATUS_FLAGS
_ATTITUDE, _VELOCITY_HORIZ, _VELOCITY_VERT, _POS_HORIZ_REL, _POS_HORIZ_ABS, _POS_VERT_ABS = 1, 2, 4, 8, 16, 32
_PRED_POS_HORIZ_REL, _PRED_POS_HORIZ_ABS, _GPS_GLITCH = 256, 512, 1024


def attitude(view: View) -> Message | None:
    """ATTITUDE: roll, pitch, heading (-pi to pi), body rates."""
    values = view.values
    return view.fields.message("ATTITUDE", view.time_ms, *values["euler"].tolist(), *values["rate_nb_b"].tolist())


def attitude_quaternion(view: View) -> Message | None:
    """ATTITUDE_QUATERNION: MAVLink's quaternion is q_nb; its scalar part is made non-negative."""
    q = view.estimate["q_nb"]
    q = q if q[0] >= 0.0 else -q
    rates = view.values["rate_nb_b"].tolist()
    return view.fields.message("ATTITUDE_QUATERNION", view.time_ms, *q.tolist(), *rates, (0.0, 0.0, 0.0, 0.0))


def local_position_ned(view: View) -> Message | None:
    """LOCAL_POSITION_NED: position from home along the NED axes at home; velocity along those at the vehicle."""
    offset, velocity = view.values["offset"].tolist(), view.estimated_velocity_n.tolist()
    return view.fields.message("LOCAL_POSITION_NED", view.time_ms, *offset, *velocity)


def global_position_int(view: View) -> Message | None:
    """GLOBAL_POSITION_INT: position, velocity and heading."""
    values, height = view.values, view.estimated("height")
    return view.fields.message(
        "GLOBAL_POSITION_INT", view.time_ms,
        *view.place(view.estimated("latitude"), float(values["estimated_longitude_wrapped"]), height),
        (height - view.home[2]) * 1e3, *(view.estimated_velocity_n * 1e2).tolist(), _centidegrees(float(values["euler"][2])),
    )  # fmt: skip


def odometry(view: View) -> Message | None:
    """ODOMETRY: position from home in n, velocity and rates in b, and their covariances as far as stated.

    The position covariance is diagonal in n; the velocity covariance is diagonal in n and rotated into b, because
    estimators state sigmas only.
    """
    values, q = view.values, view.estimate["q_nb"]
    aided = view.simulation.estimator.aided
    return view.fields.message(
        "ODOMETRY", view.time_us, _MAV_FRAME_LOCAL_NED, _MAV_FRAME_BODY_FRD,
        *values["offset"].tolist(), q.tolist(), *values["velocity_b"].tolist(), *values["rate_nb_b"].tolist(),
        values["pose_covariance"].tolist(), values["velocity_covariance"].tolist(),
        view.simulation.alignments % 256, _MAV_ESTIMATOR_TYPE_GPS_INS if aided else _MAV_ESTIMATOR_TYPE_AUTOPILOT, 0,
    )  # fmt: skip


def vfr_hud(view: View) -> Message | None:
    """VFR_HUD: without wind, airspeed equals speed over the Earth; throttle is not simulated."""
    north, east, down = view.estimated_velocity_n.tolist()
    heading = degrees(float(view.values["euler"][2]))
    return view.fields.message(
        "VFR_HUD", sqrt(north**2 + east**2 + down**2), hypot(north, east),
        round(heading) % 360 if isfinite(heading) else nan, 0, view.estimated("height") - view.undulation, -down,
    )  # fmt: skip


def altitude(view: View) -> Message | None:
    """ALTITUDE: altitude_monotonic is the barometer's; the terrain is unknown."""
    height = view.estimated("height")
    relative = height - view.home[2]
    above_sea = height - view.undulation
    monotonic = view.air.pressure_height
    return view.fields.message("ALTITUDE", view.time_us, monotonic, above_sea, relative, relative, nan, nan)


def estimator_status(view: View) -> Message | None:
    """ESTIMATOR_STATUS: flags by `View.thresholds`; ratios are squared innovations divided by the squared gate.

    In an outage the present position is not absolute, but predicted by dead reckoning, and there are no innovations.
    """
    estimate, limits = view.estimate, view.thresholds
    flags = _ATTITUDE if view.aligned else 0
    velocity_sigma, position_sigma = estimate.get("velocity_sigma"), view.position_sigma
    if velocity_sigma is not None:
        flags |= _VELOCITY_HORIZ if np.max(velocity_sigma[:2]) < limits.velocity else 0
        flags |= _VELOCITY_VERT if velocity_sigma[2] < limits.velocity else 0
    horizontal = vertical = nan
    if position_sigma is not None:
        horizontal, vertical = hypot(*position_sigma[:2].tolist()) / sqrt(2.0), float(position_sigma[2])
        if horizontal < limits.position:
            flags |= _POS_HORIZ_REL | _PRED_POS_HORIZ_REL | _PRED_POS_HORIZ_ABS
            flags |= 0 if view.in_outage else _POS_HORIZ_ABS
        flags |= _POS_VERT_ABS if vertical < limits.position and not view.in_outage else 0
    ratios = [nan, nan, nan]
    gate = view.simulation.estimator_row("innovation_gate")
    if "test_ratio" in estimate and gate and not view.in_outage:
        test = (estimate["test_ratio"] / gate) ** 2
        ratios = [float(np.max(test[3:])), float(np.max(test[:2])), float(test[2])]
        flags |= _GPS_GLITCH if np.max(test) > 1.0 else 0
    return view.fields.message("ESTIMATOR_STATUS", view.time_us, flags, *ratios, nan, nan, nan, horizontal, vertical)


def hil_state_quaternion(view: View) -> Message | None:
    """HIL_STATE_QUATERNION: the truth.  Accelerations are specific forces in the unit `View.hil_acceleration`."""
    truth, values, dt = view.truth, view.values, view.simulation.interval
    velocity = truth["velocity_n"]
    speed = float(np.sqrt(np.dot(velocity, velocity)))
    density = view.air.density
    force = truth["true_delta_velocity"] / dt * view.hil_acceleration
    return view.fields.message(
        "HIL_STATE_QUATERNION", view.time_us, truth["q_nb"].tolist(), *values["true_rate_nb_b"].tolist(),
        *view.place(float(truth["latitude"]), float(values["true_longitude_wrapped"]), float(truth["height"])),
        *(velocity * 1e2).tolist(), speed * sqrt(max(density, 0.0) / _SEA_LEVEL_DENSITY) * 1e2, speed * 1e2, *force.tolist(),
    )  # fmt: skip


def _centidegrees(heading: float) -> float:
    """Heading in centidegrees, 0 to 35999; NaN if unknown."""
    return round(heading % (2 * pi) * CENTI_DEG) % 36000 if isfinite(heading) else nan


ESTIMATES = by_name(
    attitude, attitude_quaternion, local_position_ned, global_position_int, odometry, vfr_hud, altitude, estimator_status,
    hil_state_quaternion,
)  # fmt: skip
