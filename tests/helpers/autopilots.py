"""Stand-ins for the autopilots at the other end of lockstep, which follow their documented behaviour."""

import itertools
import json
import socket
import struct
import threading
import time

from pymavlink.dialects.v20 import common as m


class Px4StandIn(threading.Thread):
    """Connects, sends HEARTBEAT and what it asks, reads HIL_SENSOR and answers each with outputs at its time.

    It does not answer the first `silent` sensors nor those of `skip`, and disconnects after `last` (None: never).
    got: all messages.  times, answered: of the sensors received and answered, microseconds.
    """

    def __init__(self, port, silent=0, last=None, skip=frozenset(), flags=1, ask=()):
        super().__init__(daemon=True)
        self.port, self.silent, self.last, self.skip, self.flags, self.ask = port, silent, last, skip, flags, ask
        self.got, self.times, self.answered, self.error = [], [], [], None
        self.start()

    def run(self):
        try:
            self._fly()
        except OSError:
            pass
        except BaseException as error:
            self.error = error

    def _connected(self):
        for _ in itertools.repeat(None, 1000):
            try:
                return socket.create_connection(("127.0.0.1", self.port), timeout=10)
            except ConnectionError:
                time.sleep(0.01)
        raise AssertionError("nobody listens")

    def _fly(self):
        mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
        mav.robust_parsing = True
        with self._connected() as link:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for message in (m.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3), *self.ask):
                link.sendall(message.pack(mav))
            while data := link.recv(65536):
                for message in mav.parse_buffer(data) or []:
                    assert message.get_type() != "BAD_DATA"
                    self.got.append(message)
                    if message.get_type() != "HIL_SENSOR" or message.id != 0:
                        continue
                    self.times.append(message.time_usec)
                    count = len(self.times)
                    if count > self.silent and count not in self.skip:
                        controls = [count / 1e4, -0.5, 0.25, *[0.0] * 13]
                        mode = m.MAV_MODE_FLAG_SAFETY_ARMED if count % 2 else 0
                        outputs = m.MAVLink_hil_actuator_controls_message(message.time_usec, controls, mode, self.flags)
                        link.sendall(outputs.pack(mav))
                        self.answered.append(message.time_usec)
                    if count == self.last:
                        return

    def done(self):
        self.join(10)
        assert not self.is_alive() and self.error is None


def servo_frame(number, pulses=(1500,) * 16):
    """A frame of ArduPilot's JSON interface."""
    return struct.pack(f"<HHI{len(pulses)}H", {16: 18458, 32: 29569}[len(pulses)], 400, number, *pulses)


def exchange(link, number, *pulses):
    """The answer to a frame over a connected socket."""
    link.send(servo_frame(number, *pulses))
    line = link.recv(4096)
    assert line.startswith(b"\n") and line.endswith(b"\n") and line.count(b"\n") == 2  # as the protocol requires
    return json.loads(line)
