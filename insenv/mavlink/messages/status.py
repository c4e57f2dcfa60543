"""Messages of the vehicle itself: what it is, how it is, where home is, what time it is."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import blake2b
from math import nan

from insenv import __version__
from insenv.mavlink.messages.fields import DEG_E7, Message
from insenv.mavlink.messages.view import View

SYSTEM, COMPONENT = 1, 1
"""The vehicle's ids: clients look for component 1."""

_MAV_AUTOPILOT_GENERIC, _MAV_STATE_ACTIVE, _MAVLINK_VERSION = 0, 4, 3
_CUSTOM_MODE, _ARMED = 1, 128
_LANDED_ON_GROUND, _LANDED_IN_AIR = 1, 2
_GYRO, _ACCEL, _MAG, _ABSOLUTE_PRESSURE, _DIFFERENTIAL_PRESSURE, _GPS, _PREARM = 1, 2, 4, 8, 16, 32, 1 << 28
_IMU_LOST = 10  # samples without any between them
_CAPABILITY_PARAM_FLOAT, _CAPABILITY_COMMAND_INT, _CAPABILITY_MAVLINK2 = 2, 8, 8192


def heartbeat(view: View) -> Message | None:
    """HEARTBEAT: autopilot GENERIC, for it is none; armed, so that ground stations draw its way."""
    mode = _CUSTOM_MODE | (_ARMED if view.armed else 0)
    kind = view.traits.mavlink_type
    return view.fields.message("HEARTBEAT", kind, _MAV_AUTOPILOT_GENERIC, mode, 0, _MAV_STATE_ACTIVE, _MAVLINK_VERSION)


def sys_status(view: View) -> Message | None:
    """SYS_STATUS: what there is and whether it works; ready (prearm) once the attitude is good.  There is no battery."""
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
    if view.simulation.lost_in_a_row >= _IMU_LOST:
        health &= ~(_GYRO | _ACCEL)
    load = view.load * 1000.0
    return view.fields.message("SYS_STATUS", present, present, health, load, nan, nan, nan, 0, 0, 0, 0, 0, 0)


def extended_sys_state(view: View) -> Message | None:
    """EXTENDED_SYS_STATE: an aircraft is in the air when its wings carry more than half of its weight."""
    airborne = (view.simulation.state("airborne") or 0.0) > 0.5
    return view.fields.message("EXTENDED_SYS_STATE", 0, _LANDED_IN_AIR if airborne else _LANDED_ON_GROUND)


def system_time(view: View) -> Message | None:
    """SYSTEM_TIME: the wall clock's time at the start, and from there on the simulation's clock."""
    return view.fields.message("SYSTEM_TIME", view.unix_us, view.time_ms)


def home_position(view: View) -> Message | None:
    """HOME_POSITION: the start as the estimator was told it, origin of the local position."""
    latitude, longitude, height = view.home
    return view.fields.message(
        "HOME_POSITION",
        latitude * DEG_E7,
        longitude * DEG_E7,
        (height - view.undulation) * 1e3,
        0.0,
        0.0,
        0.0,
        (1.0, 0.0, 0.0, 0.0),
        0.0,
        0.0,
        0.0,
        view.time_us,
    )


def gps_global_origin(view: View) -> Message | None:
    """GPS_GLOBAL_ORIGIN: home."""
    latitude, longitude, height = view.home
    return view.fields.message(
        "GPS_GLOBAL_ORIGIN", latitude * DEG_E7, longitude * DEG_E7, (height - view.undulation) * 1e3, view.time_us
    )


def autopilot_version(view: View) -> Message | None:
    """AUTOPILOT_VERSION: insenv's version; the uid tells scenarios and seeds apart."""
    major, minor, patch = (int(part) for part in (__version__.split("+")[0] + ".0.0").split(".")[:3])
    version = major << 24 | minor << 16 | patch << 8
    plant = view.simulation.plant
    uid = int.from_bytes(blake2b(f"{plant.scenario.name}:{plant.seed}".encode(), digest_size=8).digest(), "little")
    capabilities = _CAPABILITY_PARAM_FLOAT | _CAPABILITY_COMMAND_INT | _CAPABILITY_MAVLINK2
    none = [0] * 8
    return view.fields.message("AUTOPILOT_VERSION", capabilities, version, 0, 0, 0, none, none, none, 0, 0, uid)


STATUS: dict[str, Callable[[View], Message | None]] = {
    "HEARTBEAT": heartbeat,
    "SYS_STATUS": sys_status,
    "EXTENDED_SYS_STATE": extended_sys_state,
    "SYSTEM_TIME": system_time,
    "HOME_POSITION": home_position,
    "GPS_GLOBAL_ORIGIN": gps_global_origin,
}
"""Streamed."""

ON_REQUEST: dict[str, Callable[[View], Message | None]] = {
    "AUTOPILOT_VERSION": autopilot_version,
}
