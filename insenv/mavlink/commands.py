"""Execute commands (COMMAND_LONG and COMMAND_INT).  Every command has a result; docs/mavlink.md lists the commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from functools import lru_cache
from math import isfinite

from insenv.base.errors import InputError
from insenv.mavlink.filetransfer import replies
from insenv.mavlink.messages import DEFAULT_HZ, MESSAGES
from insenv.mavlink.messages.fields import MAX_HZ, STREAMS, Message
from insenv.mavlink.messages.status import available_modes
from insenv.mavlink.score import READERS
from insenv.mavlink.vehicle import NEXT_ALIGNMENT, REAL32, Vehicle
from insenv.mavlink.wire.frames import dialect, message_class

# The vehicle's answers to received messages.
#
# Messages addressed to another system or component are ignored.  Answers are never answered, so that two vehicles on one
# link cannot keep each other busy.

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


def _answers_set_mode(vehicle: Vehicle, message: Message) -> Answers:
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
    "SET_MODE": _answers_set_mode,
    "TIMESYNC": _timesync,
    "PING": _ping,
    **dict.fromkeys(READERS, _scored),
}
"""By name of the message."""


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


# Pending answers: a bounded queue for each peer, sent a few at a time so that the stream keeps its pace.

WAITING = 200
"""Largest number of pending answers for one peer; more are dropped and counted."""
AT_ONCE = 16
"""Largest number of answers that one `send` sends, to all peers together."""
PEERS = 64


class Outbox:
    """Pending answers by peer.

    A long answer (all parameters) is made while it is sent.  When it is requested again it restarts, so that each peer
    has at most one.  dropped: answers that did not fit.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._queues: dict[Hashable, deque[Message]] = {}
        self._long: dict[Hashable, Iterator[Message]] = {}
        self._turn: deque[Hashable] = deque()

    def put(self, peer: Hashable, messages: Answers) -> None:
        """Queue `messages` for `peer`."""
        if not isinstance(messages, (list, tuple)):
            if peer in self._turn or self._room():
                self._long[peer] = iter(messages)
                self._queue(peer)
            return
        for message in messages:
            if message is None:
                continue
            if (peer not in self._turn and not self._room()) or len(self._queue(peer)) >= WAITING:
                self.dropped += 1
            else:
                self._queue(peer).append(message)

    def send(self, send_to: Callable[[Hashable, Message], object]) -> int:
        """Send some answers, the peers in turn, and return their number."""
        sent = 0
        while self._turn and sent < AT_ONCE:
            peer = self._turn[0]
            message = self._next(peer)
            if message is None:
                self._turn.popleft()
                self._queues.pop(peer, None)
                continue
            send_to(peer, message)
            sent += 1
            self._turn.rotate(-1)
        return sent

    def _next(self, peer: Hashable) -> Message | None:
        queue = self._queues.get(peer)
        if queue:
            return queue.popleft()
        message = next(self._long[peer], None) if peer in self._long else None
        if message is None:
            self._long.pop(peer, None)
        return message

    def _queue(self, peer: Hashable) -> deque[Message]:
        if peer not in self._queues:
            self._queues[peer] = deque()
            self._turn.append(peer)
        return self._queues[peer]

    def _room(self) -> bool:
        return len(self._turn) < PEERS
