"""A streamed vehicle: what a client asks it, what it answers, what it sends; the client's side of a link."""

import socket
import threading
import time

import numpy as np
from pymavlink.dialects.v20 import common, development

from insenv.mavlink import Vehicle
from insenv.mavlink.commands import answers
from insenv.mavlink.messages import SILENT
from insenv.mavlink.parameters import NEVER
from insenv.scenario import load

PROGRAM = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from insenv.cli import main; main()"
"""The command line in a process that hears SIGINT, also where the tests run in the background."""
UNSUPPORTED, DENIED, ACCEPTED = 3, 2, 0


def quiet(scenario="car-city-drive", hz=None, **options):
    """A vehicle without streamed messages.  hz: samples a second, too few for a vibration, for long runs."""
    loaded = load(scenario) if isinstance(scenario, str) else scenario
    if hz is not None:
        smooth = loaded.vehicle.model_copy(update={"engine": ()} if hasattr(loaded.vehicle, "engine") else {})
        loaded = loaded.model_copy(update={"rate_hz": hz, "vehicle": smooth})
    return Vehicle(loaded, rates=SILENT, **options)


def steps(vehicle, seconds):
    """Simulate `seconds`, and return the messages sent meanwhile."""
    return [message for _ in range(round(seconds / vehicle.simulation.interval)) for message in vehicle.step()]


def sent(name, *values, system=245, component=190):
    """A client's message as the vehicle reads it."""
    message = getattr(common, f"MAVLink_{name.lower()}_message")(*values)
    return common.MAVLink(None).decode(bytearray(message.pack(common.MAVLink(None, system, component))))


def answered(vehicle, message):
    """The answers as the client reads them."""
    reader, sender = development.MAVLink(None), common.MAVLink(None, 1, 1)
    return [reader.decode(bytearray(m.pack(sender))) for m in answers(vehicle, message)]


def command(vehicle, number, *parameters):
    """The result of a command, and the other answers."""
    padded = [*parameters, *[0.0] * (7 - len(parameters))]
    ack, *more = answered(vehicle, sent("COMMAND_LONG", 1, 1, number, 0, *padded))
    assert (ack.get_type(), ack.command, ack.target_system, ack.target_component) == ("COMMAND_ACK", number, 245, 190)
    return ack.result, more


def texts(vehicle):
    return [message.text for message in vehicle.texts()]


def set_parameter(vehicle, name, value, kind=9):
    answer, *wrong = answered(vehicle, sent("PARAM_SET", 1, 1, name.encode(), value, kind))
    if wrong:
        error = 5 if vehicle.parameters.all[vehicle.parameters.find(name)].acts == NEVER else 2
        assert [(m.get_type(), m.param_id, m.error) for m in wrong] == [("PARAM_ERROR", name, error)]
    assert bool(wrong) == (answer.param_value != np.float32(value) or kind != 9)
    return answer.param_value


class Clock:
    """A clock that the test sets, and that sleeping advances."""

    def __init__(self, now=100.0):
        self.now, self.slept = now, []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def heartbeat():
    return common.MAVLink_heartbeat_message(common.MAV_TYPE_GCS, 8, 0, 0, common.MAV_STATE_ACTIVE, 3)


def ping(number):
    return common.MAVLink_ping_message(number, 0, 0, 0)


def frame_of(message, sequence=0, system=255, component=190):
    packer = common.MAVLink(None, srcSystem=system, srcComponent=component)
    packer.seq = sequence
    return message.pack(packer)


def decoded(data):
    """All messages in a stream of bytes, by pymavlink's own parser."""
    parser = common.MAVLink(None)
    parser.robust_parsing = True
    return parser.parse_buffer(data) or []


def until(link, enough, tries=2000):
    """What `link` receives until `enough`; loopback delivers at once, TCP a little later."""
    got = []
    for _ in range(tries):
        got += link.receive()
        if enough(got):
            return got
        time.sleep(0.001)
    raise AssertionError(f"not enough: {got}, {link.statistics}")


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class Receiver:
    """A UDP socket that a thread reads into memory: within the block, all that comes until 0.1 s after it."""

    def __enter__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.1)
        self.to = f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"
        self.frames, self._open = [], True
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        return self

    def _read(self):
        while True:
            try:
                self.frames.append(self.socket.recv(2048))
            except TimeoutError:
                if not self._open:
                    return

    def __exit__(self, *error):
        self._open = False
        self._thread.join()
        self.socket.close()

    def messages(self):
        reader = common.MAVLink(None)
        return [reader.decode(bytearray(frame)) for frame in self.frames]


def lost(frames):
    """Frames missing between the first and the last, by their sequence numbers."""
    return int(np.sum((np.diff([frame[4] for frame in frames]) - 1) % 256))


def records(path):
    """(time in microseconds, frame) of each record of a telemetry log; fails where it is cut off."""
    data, at = path.read_bytes(), 0
    while at < len(data):
        size = 12 + data[at + 9] + 13 * (data[at + 10] & 1)
        assert data[at + 8] == 0xFD and at + 8 + size <= len(data)
        yield int.from_bytes(data[at : at + 8], "big"), data[at + 8 : at + 8 + size]
        at += 8 + size


def logged(path):
    """The frames of a telemetry log: the parameters with which it begins, and the others."""
    frames = [frame for _, frame in records(path)]
    number = next(i for i, frame in enumerate(frames) if int.from_bytes(frame[7:10], "little") != 22)
    return frames[:number], frames[number:]


UNKNOWN = [float("nan")] * 21


def estimate(name, **changes):
    """A client's estimate as the vehicle reads it, with changed fields."""
    fields = {
        "ODOMETRY": {
            "time_usec": 5_000_000, "frame_id": 1, "child_frame_id": 12, "x": 1.0, "y": 2.0, "z": 3.0, "q": [1.0, 0, 0, 0],
            "vx": 1.0, "vy": 0.0, "vz": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0,
            "pose_covariance": UNKNOWN, "velocity_covariance": UNKNOWN, "reset_counter": 0, "estimator_type": 5,
        },
        "ATTITUDE": dict.fromkeys(("time_boot_ms", "roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"), 0),
        "ATTITUDE_QUATERNION": {"time_boot_ms": 5000, "q1": 1.0} | dict.fromkeys(("q2", "q3", "q4", "a", "b", "c"), 0.0),
        "VISION_POSITION_ESTIMATE": dict.fromkeys(("usec", "x", "y", "z", "roll", "pitch", "yaw"), 0)
        | {"covariance": UNKNOWN},
    }[name]  # fmt: skip
    more = [changes.pop("repr_offset_q")] if "repr_offset_q" in changes else []
    return sent(name, *{**fields, **changes}.values(), *more, system=42, component=191)
