"""Execute commands (COMMAND_LONG and COMMAND_INT).  Every command has a result; docs/mavlink.md lists the commands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import isfinite

from insenv.base.errors import InputError
from insenv.mavlink.messages import DEFAULT_HZ, MESSAGES, Message
from insenv.mavlink.messages.schedule import MAX_HZ
from insenv.mavlink.messages.status import available_modes
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire.frames import message_class

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
"""MAV_RESULT."""

Answer = tuple[int, list[Message]]
"""The result, and messages sent with it."""
_Action = Callable[[Vehicle, Sequence[float]], Answer]
_MESSAGE_INTERVAL = 244


def execute(vehicle: Vehicle, command: int, parameters: Sequence[float]) -> Answer:
    """Execute a command; `parameters` are param1 to param7.  Every command has a result, whatever they hold."""
    action = ACTIONS.get(command)
    if action is None:
        return UNSUPPORTED, []
    try:
        return action(vehicle, parameters)
    except InputError as error:
        vehicle.announce(str(error), "warning")
        return DENIED, []


@lru_cache(maxsize=1)
def names_by_number() -> dict[int, str]:
    """Names of the messages that the vehicle can make, by message number."""
    return {message_class(name).id: name for name in MESSAGES}


def _realign(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    vehicle.realign()
    return ACCEPTED, []


def _gnss(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    vehicle.set_gnss(_flag(p[0], "param1"))
    return ACCEPTED, []


def _pause(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    vehicle.set_paused(_flag(p[0], "param1"))
    return ACCEPTED, []


def _speed(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    vehicle.set_speed(p[0])
    return ACCEPTED, []


def _disturb(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    vehicle.disturb_gnss(p[0], p[1:4])
    return ACCEPTED, []


def _arm(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    vehicle.view.armed = _flag(p[0], "param1")
    return ACCEPTED, []


def _set_interval(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    name = _named(p[0])
    if name not in DEFAULT_HZ:
        return UNSUPPORTED, []
    sample = vehicle.simulation.samples
    if p[1] == 0:
        vehicle.schedule.reset(name, sample)
    elif p[1] == -1:
        vehicle.schedule.set(name, 0.0, sample)
    elif p[1] > 0 and isfinite(p[1]):
        vehicle.schedule.set(name, min(1e6 / p[1], MAX_HZ), sample)
    else:
        raise InputError(f"interval {p[1]:g} us: allowed is above 0, 0 or -1")
    return ACCEPTED, []


def _get_interval(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    number = int(p[0]) if isfinite(p[0]) and 0 <= p[0] < 65536 else 0
    return ACCEPTED, [message_interval(vehicle, number)]


def message_interval(vehicle: Vehicle, number: int) -> Message:
    """MESSAGE_INTERVAL for a message number: microseconds, -1 not sent, 0 unknown."""
    hz = vehicle.schedule.rates.get(names_by_number().get(number, ""))
    interval = 0.0 if hz is None else -1.0 if hz == 0.0 else 1e6 / hz
    return vehicle.view.fields.message("MESSAGE_INTERVAL", number, interval)


def _request_message(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    if p[0] == _MESSAGE_INTERVAL:
        return _get_interval(vehicle, p[1:])
    name = _named(p[0])
    if name == "AVAILABLE_MODES":  # param2: the number of one of the modes, 0 for all
        modes = [mode for mode in available_modes(vehicle.view) if p[1] in (0.0, mode.mode_index)]
        return (ACCEPTED, modes) if modes else (DENIED, [])
    return (UNSUPPORTED, []) if name is None else _make(vehicle, name)


def _make(vehicle: Vehicle, name: str) -> Answer:
    message = vehicle.make(name)
    return (TEMPORARILY_REJECTED, []) if message is None else (ACCEPTED, [message])


def set_mode(vehicle: Vehicle, custom_mode: float) -> int:
    """The result of a request for a mode: only the present one is accepted, since modes follow from what steers the vehicle."""
    if custom_mode == vehicle.view.mode.number:
        return ACCEPTED
    names = {mode.number: mode.name for mode in vehicle.view.modes}
    if custom_mode in names:
        vehicle.announce(f"mode {names[int(custom_mode)]}: not by command", "warning")
    return DENIED


def _set_mode(vehicle: Vehicle, p: Sequence[float]) -> Answer:
    return set_mode(vehicle, p[1]), []


def _request(name: str) -> _Action:
    return lambda vehicle, _: _make(vehicle, name)


def _named(number: float) -> str | None:
    return names_by_number().get(int(number)) if isfinite(number) else None


def _flag(value: float, name: str) -> bool:
    if value not in (0.0, 1.0):
        raise InputError(f"{name} = {value:g}: allowed is 0 or 1")
    return value == 1.0


ACTIONS: dict[int, _Action] = {
    31010: _realign,  # MAV_CMD_USER_1
    31011: _gnss,  # MAV_CMD_USER_2
    31012: _pause,  # MAV_CMD_USER_3
    31013: _speed,  # MAV_CMD_USER_4
    31014: _disturb,  # MAV_CMD_USER_5
    176: _set_mode,  # DO_SET_MODE: param2 the custom mode
    400: _arm,  # COMPONENT_ARM_DISARM
    510: _get_interval,  # GET_MESSAGE_INTERVAL
    511: _set_interval,  # SET_MESSAGE_INTERVAL: param2 in us; 0 the default, -1 never
    512: _request_message,  # REQUEST_MESSAGE
    519: _request("PROTOCOL_VERSION"),  # REQUEST_PROTOCOL_VERSION
    520: _request("AUTOPILOT_VERSION"),  # REQUEST_AUTOPILOT_CAPABILITIES
    410: _request("HOME_POSITION"),  # GET_HOME_POSITION
}
"""By number of the command (MAV_CMD)."""
