"""The vehicle's answers to received messages and commands (docs/mavlink.md lists them), and the queue of pending answers.

Messages addressed to another system or component are ignored.  Answers are never answered, so that two vehicles on one
link cannot keep each other busy.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from functools import lru_cache
from math import isfinite
from typing import Any

from insenv.base.errors import InputError
from insenv.mavlink.messages import MESSAGES, STREAMED, Message
from insenv.mavlink.messages.schedule import MAX_HZ
from insenv.mavlink.messages.state import available_modes
from insenv.mavlink.parameters import NEXT_ALIGNMENT, REAL32
from insenv.mavlink.score import READERS
from insenv.mavlink.vehicle import Vehicle
from insenv.mavlink.wire.frames import dialect, message_class

Answers = Iterable[Message]
"""The messages sent back: a list, or for all parameters an iterator that makes them one by one."""
Handler = Callable[[Vehicle, Message], Answers]

_DOES_NOT_EXIST, _OUT_OF_RANGE, _READ_ONLY = 1, 2, 5  # MAV_PARAM_ERROR
_MISSION_TYPES = (0, 1, 2)  # MAV_MISSION_TYPE: mission, fence, rally points
_NO_MISSION, _LOG_BYTES, _DO_SET_MODE = 1, 90, 176
_MISSION_ACCEPTED, _MISSION_UNSUPPORTED, _MISSION_INVALID_SEQUENCE = 0, 3, 13
_NAME_BYTES = 16

_FILE_BYTES, _FILE_DONE, _FILE_REFUSED = 251, 128, 129
_FILE_HEADER = struct.Struct("<HBBBBBxI")
"""Of a payload of FILE_TRANSFER_PROTOCOL: sequence, session, opcode, size, opcode of the request, burst complete, offset."""
_FILE_END, _NO_FILE_COMMAND, _FILES_READ_ONLY, _NO_FILE = 6, 7, 9, 10
_FILE_ERRORS = {3: _FILE_END, 4: _NO_FILE, 14: _NO_FILE, **dict.fromkeys(range(6, 14), _FILES_READ_ONLY)}
"""By opcode, the error that answers it: list, open, checksum, and all that write; the others are not known."""


def answers(vehicle: Vehicle, message: Message) -> Answers:
    """Execute what a message asks for, and return the answers to its sender."""
    handler = HANDLERS.get(message.get_type())
    return () if handler is None or not _for_us(vehicle, message) else handler(vehicle, message)


def _for_us(vehicle: Vehicle, message: Message) -> bool:
    system, component = vehicle.view.system, vehicle.view.component
    if _to(message) == (system, component):
        return False
    target = getattr(message, "target_system", getattr(message, "target", 0))
    return target in (0, system) and getattr(message, "target_component", 0) in (0, component)


def _to(message: Message) -> tuple[int, int]:
    """System and component of the sender, which the answer addresses."""
    return message.get_srcSystem(), message.get_srcComponent()


def _answer(name: str, values: Callable[[Message], Sequence[Any]]) -> Handler:
    """A handler whose answer depends on the received message alone."""
    return lambda vehicle, message: [vehicle.view.fields.message(name, *values(message))]


# --- parameters ----------------------------------------------------------------------------------


def _parameter_list(vehicle: Vehicle, message: Message) -> Iterator[Message]:
    return (parameter_value(vehicle, index) for index in range(len(vehicle.parameters)))


def parameter_value(vehicle: Vehicle, index: int) -> Message:
    """PARAM_VALUE of the parameter with this index."""
    parameter = vehicle.parameters.all[index]
    return vehicle.view.fields.message("PARAM_VALUE", parameter.name, parameter.value(), REAL32, len(vehicle.parameters), index)


def parameter_frames(vehicle: Vehicle) -> list[bytes]:
    """PARAM_VALUE of all parameters as frames, numbered from 0.

    A log begins with them, as that of a ground station does, which asks for them when it connects.
    """
    packer = dialect().MAVLink(None, vehicle.view.system, vehicle.view.component)
    frames = []
    for index in range(len(vehicle.parameters)):
        packer.seq = index % 256
        frames.append(bytes(parameter_value(vehicle, index).pack(packer)))
    return frames


def _parameter_read(vehicle: Vehicle, message: Message) -> Answers:
    try:
        index = message.param_index if message.param_index >= 0 else vehicle.parameters.find(_name(message))
        return [parameter_value(vehicle, index)]
    except (InputError, IndexError):
        return _parameter_error(vehicle, message, _DOES_NOT_EXIST)


def _parameter_set(vehicle: Vehicle, message: Message) -> Answers:
    """The answer is the value in force, which tells the sender whether its own was accepted, and PARAM_ERROR if it was not."""
    try:
        index = vehicle.parameters.find(_name(message))
    except InputError:
        return _parameter_error(vehicle, message, _DOES_NOT_EXIST)
    parameter = vehicle.parameters.all[index]
    error: Answers = ()
    try:
        if message.param_type != REAL32:
            raise InputError(f"{parameter.name}: send it as REAL32")
        parameter.set(message.param_value)
        if parameter.acts == NEXT_ALIGNMENT:
            vehicle.announce(f"{parameter.name}: acts at next alignment")
    except InputError as refusal:
        vehicle.announce(str(refusal), "warning")
        error = _parameter_error(vehicle, message, _READ_ONLY if parameter.write is None else _OUT_OF_RANGE)
    return [parameter_value(vehicle, index), *error]


def _parameter_error(vehicle: Vehicle, message: Message, error: int) -> Answers:
    """PARAM_ERROR, by name or by index, as the request."""
    index = getattr(message, "param_index", -1)
    return [vehicle.view.fields.message("PARAM_ERROR", *_to(message), _name(message), index, error)]


def _name(message: Message) -> str:
    name = message.param_id
    text = name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)
    return text.split("\0")[0][:_NAME_BYTES]


# --- other messages ------------------------------------------------------------------------------


def _command_long(vehicle: Vehicle, message: Message) -> Answers:
    return _command(vehicle, message, [getattr(message, f"param{i}") for i in range(1, 8)])


def _command_int(vehicle: Vehicle, message: Message) -> Answers:
    parameters = [getattr(message, f"param{i}") for i in range(1, 5)]
    return _command(vehicle, message, [*parameters, float(message.x), float(message.y), message.z])


def _command(vehicle: Vehicle, message: Message, parameters: list[float]) -> Answers:
    result, messages = execute(vehicle, message.command, parameters)
    return [vehicle.view.fields.message("COMMAND_ACK", message.command, result, 0, 0, *_to(message)), *messages]


def _set_mode(vehicle: Vehicle, message: Message) -> Answers:
    result = set_mode(vehicle, message.custom_mode)
    return [vehicle.view.fields.message("COMMAND_ACK", _DO_SET_MODE, result, 0, 0, *_to(message))]


def _data_stream(vehicle: Vehicle, message: Message) -> Answers:
    """REQUEST_DATA_STREAM, 0 for all: no answer.  It does not change rates given on the command line."""
    hz = min(float(message.req_message_rate), MAX_HZ) if message.start_stop else 0.0
    for name, streamed in STREAMED.items():
        if streamed.stream and message.req_stream_id in (0, streamed.stream) and name not in vehicle.schedule.fixed:
            vehicle.schedule.set(name, hz, vehicle.simulation.samples)
    return ()


def _manual_control(vehicle: Vehicle, message: Message) -> Answers:
    vehicle.steer(message.x, message.y, message.z, message.r)
    return ()


def _file_transfer(vehicle: Vehicle, message: Message) -> Answers:
    """There are no files: each request is answered at once, so that clients do not wait.  https://mavlink.io/en/services/ftp.html"""
    sequence, session, opcode, *_ = _FILE_HEADER.unpack_from(bytes(message.payload))
    if opcode == 0 or opcode >= _FILE_DONE:  # nothing, or an answer
        return ()
    ends_session = opcode in (1, 2)
    kind, data = (_FILE_DONE, b"") if ends_session else (_FILE_REFUSED, bytes((_FILE_ERRORS.get(opcode, _NO_FILE_COMMAND),)))
    payload = _FILE_HEADER.pack((sequence + 1) % 65536, session, kind, len(data), opcode, 0, 0) + data
    return [vehicle.view.fields.message("FILE_TRANSFER_PROTOCOL", 0, *_to(message), list(payload.ljust(_FILE_BYTES, b"\0")))]


def _mission_acknowledged(result: int) -> Handler:
    return _answer("MISSION_ACK", lambda message: (*_to(message), result, message.mission_type))


def _mission_list(vehicle: Vehicle, message: Message) -> Answers:
    """The number of items, 0, of a mission, fence or rally points; an unknown kind is refused."""
    if message.mission_type not in _MISSION_TYPES:
        return _mission_acknowledged(_MISSION_UNSUPPORTED)(vehicle, message)
    return [vehicle.view.fields.message("MISSION_COUNT", *_to(message), 0, message.mission_type)]


def _timesync(vehicle: Vehicle, message: Message) -> Answers:
    if message.tc1 != 0:
        return ()
    return [vehicle.view.fields.message("TIMESYNC", round(vehicle.simulation.time * 1e9), message.ts1)]


def _ping(vehicle: Vehicle, message: Message) -> Answers:
    if message.target_system != 0:
        return ()
    return [vehicle.view.fields.message("PING", message.time_usec, message.seq, *_to(message))]


def _scored(vehicle: Vehicle, message: Message) -> Answers:
    """The errors of an estimate; the first refusal of a kind is announced to all."""
    if vehicle.score is None:
        return ()
    before = len(vehicle.score.refused)
    errors = vehicle.score.take(message)
    if len(vehicle.score.refused) > before:
        vehicle.announce(list(vehicle.score.refused)[-1], "warning")
    return errors


HANDLERS: dict[str, Handler] = {
    "PARAM_REQUEST_LIST": _parameter_list,
    "PARAM_REQUEST_READ": _parameter_read,
    "PARAM_SET": _parameter_set,
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "SET_MODE": _set_mode,
    "REQUEST_DATA_STREAM": _data_stream,
    "MANUAL_CONTROL": _manual_control,
    "TIMESYNC": _timesync,
    "PING": _ping,
    **dict.fromkeys(READERS, _scored),
    "FILE_TRANSFER_PROTOCOL": _file_transfer,
    # there are no missions and no logs: requests are refused so that clients do not wait
    "MISSION_REQUEST_LIST": _mission_list,
    "MISSION_COUNT": _mission_acknowledged(_MISSION_UNSUPPORTED),
    "MISSION_CLEAR_ALL": _mission_acknowledged(_MISSION_ACCEPTED),
    "MISSION_REQUEST": _mission_acknowledged(_MISSION_INVALID_SEQUENCE),
    "MISSION_REQUEST_INT": _mission_acknowledged(_MISSION_INVALID_SEQUENCE),
    "MISSION_SET_CURRENT": _answer("MISSION_CURRENT", lambda message: (0, 0, _NO_MISSION, 0)),
    "LOG_REQUEST_LIST": _answer("LOG_ENTRY", lambda message: (0, 0, 0, 0, 0)),
    "LOG_REQUEST_DATA": _answer("LOG_DATA", lambda message: (message.id, message.ofs, 0, [0] * _LOG_BYTES)),
}
"""By name of the message."""

# --- commands ------------------------------------------------------------------------------------

ACCEPTED, TEMPORARILY_REJECTED, DENIED, UNSUPPORTED = 0, 1, 2, 3
"""MAV_RESULT."""

Result = tuple[int, list[Message]]
"""The result, and messages sent with it."""
_MESSAGE_INTERVAL = 244


def execute(vehicle: Vehicle, command: int, parameters: Sequence[float]) -> Result:
    """Execute a command; `parameters` are param1 to param7.  Every command has a result, whatever they hold."""
    action = ACTIONS.get(command)
    if action is None:
        return UNSUPPORTED, []
    try:
        return action(vehicle, parameters) or (ACCEPTED, [])
    except InputError as error:
        vehicle.announce(str(error), "warning")
        return DENIED, []


@lru_cache(maxsize=1)
def names_by_number() -> dict[int, str]:
    """Names of the messages that the vehicle can make, by message number."""
    return {message_class(name).id: name for name in MESSAGES}


def _flag(value: float) -> bool:
    if value not in (0.0, 1.0):
        raise InputError(f"param1 = {value:g}: allowed is 0 or 1")
    return value == 1.0


def _arm(vehicle: Vehicle, p: Sequence[float]) -> None:
    vehicle.view.armed = _flag(p[0])


def _set_interval(vehicle: Vehicle, p: Sequence[float]) -> Result:
    name = _named(p[0])
    if name not in STREAMED:
        return UNSUPPORTED, []
    if p[1] == 0:
        hz = STREAMED[name].hz
    elif p[1] == -1:
        hz = 0.0
    elif p[1] > 0 and isfinite(p[1]):
        hz = min(1e6 / p[1], MAX_HZ)
    else:
        raise InputError(f"interval {p[1]:g} us: allowed is above 0, 0 or -1")
    vehicle.schedule.set(name, hz, vehicle.simulation.samples)
    return ACCEPTED, []


def _get_interval(vehicle: Vehicle, p: Sequence[float]) -> Result:
    """MESSAGE_INTERVAL for a message number: microseconds, -1 not sent, 0 unknown."""
    number = int(p[0]) if isfinite(p[0]) and 0 <= p[0] < 65536 else 0
    hz = vehicle.schedule.rates.get(names_by_number().get(number, ""))
    interval = 0.0 if hz is None else -1.0 if hz == 0.0 else 1e6 / hz
    return ACCEPTED, [vehicle.view.fields.message("MESSAGE_INTERVAL", number, interval)]


def _request_message(vehicle: Vehicle, p: Sequence[float]) -> Result:
    if p[0] == _MESSAGE_INTERVAL:
        return _get_interval(vehicle, p[1:])
    name = _named(p[0])
    if name == "AVAILABLE_MODES":  # param2: the number of one of the modes, 0 for all
        modes = [vehicle.view.fields.message(name, *mode) for mode in available_modes(vehicle.view) if p[1] in (0.0, mode[1])]
        return (ACCEPTED, modes) if modes else (DENIED, [])
    return (UNSUPPORTED, []) if name is None else _make(vehicle, name)


def _make(vehicle: Vehicle, name: str) -> Result:
    message = vehicle.make(name)
    return (TEMPORARILY_REJECTED, []) if message is None else (ACCEPTED, [message])


def _named(number: float) -> str | None:
    return names_by_number().get(int(number)) if isfinite(number) else None


def set_mode(vehicle: Vehicle, custom_mode: float) -> int:
    """The result of a request for a mode: only the present one is accepted, since modes follow from what steers the vehicle."""
    if custom_mode == vehicle.view.mode.number:
        return ACCEPTED
    for mode in vehicle.view.modes:
        if mode.number == custom_mode:
            vehicle.announce(f"mode {mode.name}: not by command", "warning")
    return DENIED


ACTIONS: dict[int, Callable[[Vehicle, Sequence[float]], Result | None]] = {
    31010: lambda vehicle, p: vehicle.realign(),  # MAV_CMD_USER_1
    31011: lambda vehicle, p: vehicle.set_gnss(_flag(p[0])),  # MAV_CMD_USER_2
    31012: lambda vehicle, p: vehicle.set_paused(_flag(p[0])),  # MAV_CMD_USER_3
    31013: lambda vehicle, p: vehicle.set_speed(p[0]),  # MAV_CMD_USER_4
    31014: lambda vehicle, p: vehicle.disturb_gnss(p[0], p[1:4]),  # MAV_CMD_USER_5
    176: lambda vehicle, p: (set_mode(vehicle, p[1]), []),  # DO_SET_MODE: param2 the custom mode
    420: lambda vehicle, p: vehicle.fail_imu(*p[:3]),  # INJECT_FAILURE: gyros or accelerometers, type, axis
    400: _arm,  # COMPONENT_ARM_DISARM
    510: _get_interval,  # GET_MESSAGE_INTERVAL
    511: _set_interval,  # SET_MESSAGE_INTERVAL: param2 in us; 0 the default, -1 never
    512: _request_message,  # REQUEST_MESSAGE
    520: lambda vehicle, p: _make(vehicle, "AUTOPILOT_VERSION"),  # REQUEST_AUTOPILOT_CAPABILITIES
    410: lambda vehicle, p: _make(vehicle, "HOME_POSITION"),  # GET_HOME_POSITION
}
"""By number of the command (MAV_CMD); None means accepted."""

# --- pending answers -----------------------------------------------------------------------------

MAX_WAITING = 200
"""Largest number of pending answers for one peer; more are dropped and counted."""
MAX_PER_SEND = 16
"""Largest number of answers that one `send` sends, to all peers together."""
MAX_PEERS = 64


class Outbox:
    """Pending answers by peer, sent a few at a time so that the stream keeps its pace.

    A long answer (all parameters) is made while it is sent.  When it is requested again it restarts, so that each peer
    has at most one.  dropped: answers that did not fit.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._queues: dict[Hashable, deque[Message]] = {}  # in the order of their turn
        self._long: dict[Hashable, Iterator[Message]] = {}

    def put(self, peer: Hashable, messages: Answers) -> None:
        """Queue `messages` for `peer`."""
        has_room = peer in self._queues or len(self._queues) < MAX_PEERS
        if isinstance(messages, (list, tuple)):
            made = [message for message in messages if message is not None]
            room = MAX_WAITING - len(self._queues.get(peer, ())) if has_room else 0
            self.dropped += max(len(made) - room, 0)
            if made[:room]:
                self._queues.setdefault(peer, deque()).extend(made[:room])
        elif has_room:
            self._long[peer] = iter(messages)
            self._queues.setdefault(peer, deque())

    def send(self, send_to: Callable[[Hashable, Message], object]) -> int:
        """Send some answers, the peers in turn, and return their number."""
        sent = 0
        while self._queues and sent < MAX_PER_SEND:
            peer, queue = next(iter(self._queues.items()))
            del self._queues[peer]
            message = queue.popleft() if queue else next(self._long.get(peer, iter(())), None)
            if message is None:
                self._long.pop(peer, None)
                continue
            self._queues[peer] = queue
            send_to(peer, message)
            sent += 1
        return sent
