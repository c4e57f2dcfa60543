"""Messages of the vehicle itself: type, state and home.  Each function returns the values of a message's fields."""

from __future__ import annotations

from hashlib import blake2b
from math import nan

from insenv.base.shipped import __version__
from insenv.mavlink.messages.fields import Message, Values
from insenv.mavlink.messages.view import View

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
