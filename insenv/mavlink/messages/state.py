"""Messages of the estimate (attitude, velocity, position and their covariances), of the truth, and of the vehicle itself.

Each function returns the values of a message's fields.  Heights above mean sea level are ellipsoidal heights minus
`View.undulation`.  Messages of an alignment have the known initial position and zero velocity.  Body rates are those of
b relative to n: measured rates minus estimated bias, Earth rate and transport rate.
"""

from __future__ import annotations

from hashlib import blake2b
from math import degrees, hypot, isfinite, nan, pi, sqrt

import numpy as np

from insenv.base.shipped import __version__
from insenv.mavlink.messages.fields import CENTI_DEG, Message, Values
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


# Messages of the vehicle itself: type, state and home.  Each function returns the values of a message's fields.

_MAV_AUTOPILOT_GENERIC, _MAVLINK_VERSION = 0, 3
_BOOT, _STANDBY, _ACTIVE, _CRITICAL = 1, 3, 4, 5  # MAV_STATE
_CUSTOM_MODE, _ARMED = 1, 128
_LANDED_ON_GROUND, _LANDED_IN_AIR = 1, 2
_GYRO, _ACCEL, _MAG, _ABSOLUTE_PRESSURE, _DIFFERENTIAL_PRESSURE, _GPS, _PREARM = 1, 2, 4, 8, 16, 32, 1 << 28
_PARAM_FLOAT, _MISSION_INT, _COMMAND_INT, _FTP, _MAVLINK2, _MISSION_FENCE, _MISSION_RALLY = 2, 4, 8, 32, 8192, 16384, 32768
_NOT_SELECTABLE, _AUTO_MODE = 2, 4
_ERRORS = {"tilt": "ERR_TILT", "heading": "ERR_HDG", "velocity": "ERR_VEL", "position": "ERR_POS"}


def heartbeat(view: View) -> Values:
    """HEARTBEAT: autopilot GENERIC, since there is none on board; armed, so that ground stations draw the track.

    The state is BOOT before the first sample, STANDBY while aligning, ACTIVE afterwards, CRITICAL after a divergence.
    """
    if view.simulation.diverged:
        state = _CRITICAL
    else:
        state = _BOOT if not view.simulation.samples else _ACTIVE if view.aligned else _STANDBY
    base_mode = _CUSTOM_MODE | (_ARMED if view.armed else 0)
    return view.traits.mavlink_type, _MAV_AUTOPILOT_GENERIC, base_mode, view.mode.number, state, _MAVLINK_VERSION


def sys_status(view: View) -> Values:
    """SYS_STATUS: sensors present and healthy; ready (prearm) once aligned.  There is no battery."""
    present = _GYRO | _ACCEL | _MAG | _ABSOLUTE_PRESSURE | _PREARM
    if view.traits.airspeed:
        present |= _DIFFERENTIAL_PRESSURE
    if view.simulation.has_gnss:
        present |= _GPS
    health = present
    if not view.has_lock:
        health &= ~_GPS
    if not view.aligned:
        health &= ~_PREARM
    if view.imu_lost:
        health &= ~(_GYRO | _ACCEL)
    return present, present, health, view.load * 1000.0, nan, nan, nan, 0, 0, 0, 0, 0, 0


def extended_sys_state(view: View) -> Values:
    """EXTENDED_SYS_STATE: in the air when the wings carry more than half of the weight."""
    airborne = (view.simulation.state("airborne") or 0.0) > 0.5
    return 0, _LANDED_IN_AIR if airborne else _LANDED_ON_GROUND


def home_position(view: View) -> Values:
    """HOME_POSITION: the known initial position, origin of local positions."""
    zero, level = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    return *view.place(*view.home), *zero, level, *zero, view.time_us


def error_messages(view: View) -> list[Message]:
    """NAMED_VALUE_FLOAT: the errors of the estimate against the truth (`View.errors`), by the names of `_ERRORS`."""
    return view.fields.named(view.time_ms, {_ERRORS[name]: value for name, value in view.errors.items()})


def autopilot_version(view: View) -> Values:
    """AUTOPILOT_VERSION: the version of insenv; the uid depends on scenario, seed and system."""
    major, minor, patch = (int(part) for part in (__version__.split("+")[0] + ".0.0").split(".")[:3])
    version = major << 24 | minor << 16 | patch << 8
    plant = view.simulation.plant
    digest = blake2b(f"{plant.scenario.name}:{plant.seed}:{view.system}".encode(), digest_size=8).digest()
    # missions, fences and rally points are all empty, but a client that reads them needs that answer
    capabilities = _PARAM_FLOAT | _MISSION_INT | _COMMAND_INT | _FTP | _MAVLINK2 | _MISSION_FENCE | _MISSION_RALLY
    none = [0] * 8
    return capabilities, version, 0, 0, 0, none, none, none, 0, 0, int.from_bytes(digest, "little")


def available_modes(view: View) -> list[Values]:
    """AVAILABLE_MODES of each mode.  None can be selected: manual control begins with its first message."""
    return [
        (len(view.modes), index, 0, mode.number, _NOT_SELECTABLE | (_AUTO_MODE if mode.automatic else 0), mode.name)
        for index, mode in enumerate(view.modes, 1)
    ]
