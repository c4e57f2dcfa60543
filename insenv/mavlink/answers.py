"""The vehicle's answers to received messages.

Messages addressed to another system or component are ignored.  Answers are never answered, so that two vehicles on one
link cannot keep each other busy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from insenv.base.errors import InputError
from insenv.mavlink.commands import execute, set_mode
from insenv.mavlink.filetransfer import replies
from insenv.mavlink.messages.fields import Message
from insenv.mavlink.messages.schedule import STREAMS
from insenv.mavlink.parameters import NEXT_ALIGNMENT, REAL32
from insenv.mavlink.received import READERS
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire.frames import dialect

Answers = Iterable[Message]
"""The messages sent back: a list, or for all parameters an iterator that makes them one by one."""

_DOES_NOT_EXIST, _OUT_OF_RANGE, _READ_ONLY = 1, 2, 5  # MAV_PARAM_ERROR
_MISSION_TYPES = (0, 1, 2)  # MAV_MISSION_TYPE: mission, fence, rally points
_NO_MISSION, _LOG_BYTES, _DO_SET_MODE = 1, 90, 176
_MISSION_UNSUPPORTED, _MISSION_ACCEPTED, _MISSION_INVALID_SEQUENCE = 3, 0, 13
_NAME_BYTES = 16


def answers(vehicle: Vehicle, message: Message) -> Answers:
    """Execute what a message asks for, and return the answers to its sender."""
    handler = HANDLERS.get(message.get_type())
    if handler is None or not _for_us(vehicle, message):
        return ()
    return handler(vehicle, message)


def _for_us(vehicle: Vehicle, message: Message) -> bool:
    own_system, own_component = vehicle.view.system, vehicle.view.component
    if (message.get_srcSystem(), message.get_srcComponent()) == (own_system, own_component):
        return False
    system = getattr(message, "target_system", getattr(message, "target", 0))
    return system in (0, own_system) and getattr(message, "target_component", 0) in (0, own_component)


def _to(message: Message) -> tuple[int, int]:
    """System and component of the sender, which the answer addresses."""
    return message.get_srcSystem(), message.get_srcComponent()


# --- parameters ----------------------------------------------------------------------------------


def _parameter_list(vehicle: Vehicle, message: Message) -> Iterator[Message]:
    for place in range(len(vehicle.parameters)):
        yield parameter_value(vehicle, place)


def parameter_value(vehicle: Vehicle, place: int) -> Message:
    """PARAM_VALUE of the parameter with index `place`."""
    parameter = vehicle.parameters.all[place]
    return vehicle.view.fields.message("PARAM_VALUE", parameter.name, parameter.value(), REAL32, len(vehicle.parameters), place)


def parameter_frames(vehicle: Vehicle) -> list[bytes]:
    """PARAM_VALUE of all parameters as frames, numbered from 0.

    A log begins with them, as that of a ground station does, which asks for them when it connects.
    """
    packer = dialect().MAVLink(None, vehicle.view.system, vehicle.view.component)
    frames = []
    for place in range(len(vehicle.parameters)):
        frames.append(bytes(parameter_value(vehicle, place).pack(packer)))
        packer.seq = (packer.seq + 1) % 256
    return frames


def _parameter_read(vehicle: Vehicle, message: Message) -> Answers:
    place = message.param_index
    if place < 0:
        try:
            place = vehicle.parameters.find(_name(message))
        except InputError:
            return _parameter_error(vehicle, message, _DOES_NOT_EXIST)
    if place >= len(vehicle.parameters):
        return _parameter_error(vehicle, message, _DOES_NOT_EXIST)
    return [parameter_value(vehicle, place)]


def _parameter_set(vehicle: Vehicle, message: Message) -> Answers:
    """The answer is the value in force, which tells the sender whether its own was accepted, and PARAM_ERROR if it was not."""
    try:
        place = vehicle.parameters.find(_name(message))
    except InputError:
        return _parameter_error(vehicle, message, _DOES_NOT_EXIST)
    parameter = vehicle.parameters.all[place]
    wrong: Answers = ()
    try:
        if message.param_type != REAL32:
            raise InputError(f"{parameter.name}: send it as REAL32")
        parameter.set(message.param_value)
        if parameter.acts == NEXT_ALIGNMENT:
            vehicle.announce(f"{parameter.name}: acts at next alignment")
    except InputError as error:
        vehicle.announce(str(error), "warning")
        wrong = _parameter_error(vehicle, message, _READ_ONLY if parameter.write is None else _OUT_OF_RANGE)
    return [parameter_value(vehicle, place), *wrong]


def _parameter_error(vehicle: Vehicle, message: Message, error: int) -> Answers:
    """PARAM_ERROR.  The message comes by name or by index, as the request."""
    index = getattr(message, "param_index", -1)
    return [vehicle.view.fields.message("PARAM_ERROR", *_to(message), _name(message), index, error)]


def _name(message: Message) -> str:
    name = message.param_id
    text = name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)
    return text.split("\0")[0][:_NAME_BYTES]


# --- commands ------------------------------------------------------------------------------------


def _command_long(vehicle: Vehicle, message: Message) -> Answers:
    return _command(vehicle, message, [getattr(message, f"param{i}") for i in range(1, 8)])


def _command_int(vehicle: Vehicle, message: Message) -> Answers:
    parameters = [getattr(message, f"param{i}") for i in range(1, 5)]
    return _command(vehicle, message, [*parameters, float(message.x), float(message.y), message.z])


def _command(vehicle: Vehicle, message: Message, parameters: list[float]) -> Answers:
    result, more = execute(vehicle, message.command, parameters)
    return [vehicle.view.fields.message("COMMAND_ACK", message.command, result, 0, 0, *_to(message)), *more]


def _data_stream(vehicle: Vehicle, message: Message) -> Answers:
    """REQUEST_DATA_STREAM: no answer.  It does not change rates given on the command line."""
    groups = STREAMS.values() if message.req_stream_id == 0 else (STREAMS.get(message.req_stream_id, ()),)
    hz = float(message.req_message_rate) if message.start_stop else 0.0
    for name in (name for group in groups for name in group):
        if name not in vehicle.schedule.fixed:
            vehicle.schedule.set(name, min(hz, 1000.0), vehicle.simulation.samples)
    return ()


def _manual_control(vehicle: Vehicle, message: Message) -> Answers:
    vehicle.steer(message.x, message.y, message.z, message.r)
    return ()


# --- unsupported services, refused so that clients do not wait -----------------------------------


def _file_transfer(vehicle: Vehicle, message: Message) -> Answers:
    """The files of the component metadata; all else is refused."""
    payloads = replies(vehicle.files, bytes(message.payload))
    return [vehicle.view.fields.message("FILE_TRANSFER_PROTOCOL", 0, *_to(message), list(payload)) for payload in payloads]


def _mission_list(vehicle: Vehicle, message: Message) -> Answers:
    """The number of items, 0, of a mission, fence or rally points; an unknown kind is refused."""
    if message.mission_type not in _MISSION_TYPES:
        return _mission(_MISSION_UNSUPPORTED)(vehicle, message)
    return [vehicle.view.fields.message("MISSION_COUNT", *_to(message), 0, message.mission_type)]


def _mission(result: int) -> Callable[[Vehicle, Message], Answers]:
    def acknowledge(vehicle: Vehicle, message: Message) -> Answers:
        return [vehicle.view.fields.message("MISSION_ACK", *_to(message), result, message.mission_type)]

    return acknowledge


def _log_list(vehicle: Vehicle, message: Message) -> Answers:
    return [vehicle.view.fields.message("LOG_ENTRY", 0, 0, 0, 0, 0)]


def _log_data(vehicle: Vehicle, message: Message) -> Answers:
    """No log has any data."""
    return [vehicle.view.fields.message("LOG_DATA", message.id, message.ofs, 0, [0] * _LOG_BYTES)]


def _mission_current(vehicle: Vehicle, message: Message) -> Answers:
    """There is no mission, so that its present item stays the first of none."""
    return [vehicle.view.fields.message("MISSION_CURRENT", 0, 0, _NO_MISSION, 0)]


def _set_mode(vehicle: Vehicle, message: Message) -> Answers:
    result = set_mode(vehicle, message.custom_mode)
    return [vehicle.view.fields.message("COMMAND_ACK", _DO_SET_MODE, result, 0, 0, *_to(message))]


# --- clocks --------------------------------------------------------------------------------------


def _timesync(vehicle: Vehicle, message: Message) -> Answers:
    if message.tc1 != 0:
        return ()
    return [vehicle.view.fields.message("TIMESYNC", round(vehicle.simulation.time * 1e9), message.ts1)]


def _scored(vehicle: Vehicle, message: Message) -> Answers:
    """The errors of an estimate; the first refusal of a kind is announced to all."""
    if vehicle.score is None:
        return ()
    before = len(vehicle.score.refused)
    found = vehicle.score.take(message)
    if len(vehicle.score.refused) > before:
        vehicle.announce(list(vehicle.score.refused)[-1], "warning")
    return found


def _ping(vehicle: Vehicle, message: Message) -> Answers:
    if message.target_system != 0:
        return ()
    return [vehicle.view.fields.message("PING", message.time_usec, message.seq, *_to(message))]


HANDLERS: dict[str, Callable[[Vehicle, Message], Answers]] = {
    "PARAM_REQUEST_LIST": _parameter_list,
    "PARAM_REQUEST_READ": _parameter_read,
    "PARAM_SET": _parameter_set,
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "REQUEST_DATA_STREAM": _data_stream,
    "MANUAL_CONTROL": _manual_control,
    "FILE_TRANSFER_PROTOCOL": _file_transfer,
    "MISSION_REQUEST_LIST": _mission_list,
    "MISSION_COUNT": _mission(_MISSION_UNSUPPORTED),
    "MISSION_CLEAR_ALL": _mission(_MISSION_ACCEPTED),
    "MISSION_REQUEST": _mission(_MISSION_INVALID_SEQUENCE),
    "MISSION_REQUEST_INT": _mission(_MISSION_INVALID_SEQUENCE),
    "MISSION_SET_CURRENT": _mission_current,
    "LOG_REQUEST_LIST": _log_list,
    "LOG_REQUEST_DATA": _log_data,
    "SET_MODE": _set_mode,
    "TIMESYNC": _timesync,
    "PING": _ping,
    **dict.fromkeys(READERS, _scored),
}
"""By name of the message."""
