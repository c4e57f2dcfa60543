"""Lockstep with ArduPilot's JSON back end.

The simulator listens on UDP 9002.  For each frame of servo outputs it advances by one sample and answers with one line
of JSON.

A frame, little-endian: magic 18458, requested rate (Hz), frame number and 16 pulse widths (us); or magic 29569 and 32
pulse widths.  The number reveals a repeated frame (ArduPilot received nothing for 1 s, older versions 10 s: the answer
is repeated without a step) and a restarted autopilot.  The requested rate is not followed: the step is the scenario's
sample interval, as the time stamp of the answer shows.
https://github.com/ArduPilot/ardupilot/tree/master/libraries/SITL/examples/JSON
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from insenv.base.errors import InputError
from insenv.mavlink.lockstep.contract import Act, Controls, Lockstep, Motion, Move, ignore
from insenv.mavlink.stream import Pacer, Stop
from insenv.mavlink.wire.link import Clock, parse_address, resolve

CHANNELS = (1, 0, 2, 3)
"""Channels, from 0, of pitch, roll, throttle and yaw (rudder)."""
ADDRESS = "udpin:127.0.0.1:9002"
MAGICS = {18458: 16, 29569: 32}
"""Number of channels by magic."""
HEAD = struct.Struct("<HHI")
CENTRE_US, REACH_US = 1500, 500
SILENT_S = 15.0
"""Silence of the autopilot after which another one may take its place."""
MAX_FIRST_NUMBER = 1
"""Largest number of a first frame: ArduPilot counts from 0, and on with each answer."""
READS_PER_TURN = 256


def unpack(datagram: bytes) -> tuple[int, tuple[int, ...]] | None:
    """Number and pulse widths (us) of a frame; None if it is invalid."""
    if len(datagram) < HEAD.size:
        return None
    magic, _, number = HEAD.unpack_from(datagram)
    channels = MAGICS.get(magic)
    if channels is None or len(datagram) != HEAD.size + 2 * channels:
        return None
    return number, struct.unpack_from(f"<{channels}H", datagram, HEAD.size)


def answer(motion: Motion) -> bytes:
    """The line of JSON with the vehicle's state: SI, body axes FRD, NED from the origin, quaternion scalar first."""
    state = {
        "timestamp": motion.time,
        "imu": {"gyro": motion.rate_ib_b.tolist(), "accel_body": motion.specific_force_b.tolist()},
        "position": motion.position_n.tolist(),
        "velocity": motion.velocity_n.tolist(),
        "quaternion": motion.q_nb.tolist(),
    }
    return b"\n" + json.dumps(state, separators=(",", ":"), allow_nan=False).encode() + b"\n"


class ArduPilotLockstep(Lockstep):
    """The simulator's side.

    move: the vehicle.  act: receives the outputs before each step: (pulse - 1500) / 500 by channel, 0 without a
    pulse.  ArduPilot sends no arming state, so outputs count as armed.  There is one autopilot at a time: frames of
    others are refused until it has been silent for 15 s, unless their numbers start over, as those of a restarted
    autopilot do.  interval: of a sample (s), for speed: simulated seconds per second at most; 0: as fast as ArduPilot
    asks.  Raises `InputError` for a wrong address, or a speed without an interval.
    """

    def __init__(
        self,
        move: Move,
        act: Act = ignore,
        *,
        address: str = ADDRESS,
        interval: float = 0.0,
        speed: float = 0.0,
        clock: Clock = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__()
        if speed > 0.0 and not interval > 0.0:
            raise InputError(f"lockstep: speed {speed:g} needs the interval of a sample, above 0 s; {interval:g} s given")
        self._pacer = Pacer(interval, speed, clock, sleep)
        self._move, self._act, self._clock = move, act, clock
        parsed = parse_address(address)
        if parsed.kind != "udpin":
            raise InputError(f"address {address!r}: must be udpin:HOST:PORT for ArduPilot's JSON back end")
        family, place = resolve(parsed, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.bind(place)
        except OSError as error:
            self._socket.close()
            raise InputError(f"address {address}: {error.strerror or error}") from None
        self.address = replace(parsed, port=self._socket.getsockname()[1])
        self._peer: Any = None
        self._heard = self._time = 0.0
        self._number: int | None = None
        self._answer = b""

    def _turn(self, stop: Stop) -> None:
        """Answer the newest frame: ArduPilot sends the next only after the answer, so older ones are repetitions."""
        if not select.select([self._socket], (), (), 0.1)[0]:
            return
        newest = None
        for _ in range(READS_PER_TURN):
            try:
                datagram, source = self._socket.recvfrom(2048)
            except BlockingIOError:
                break
            except OSError:  # the report of an answer that was refused
                continue
            frame = unpack(datagram)
            if frame is None or not self._is_peer(source, frame[0]):
                self.progress.refused += 1
                continue
            newest = frame
        if newest is None:
            return
        self._follow(*newest)
        try:
            self._socket.sendto(self._answer, self._peer)
        except OSError:
            self.progress.unanswered += 1

    def _is_peer(self, source: Any, number: int) -> bool:
        now = self._clock()
        if source != self._peer:
            restarted = number <= MAX_FIRST_NUMBER and self._number is not None and number < self._number
            if self._peer is not None and now - self._heard <= SILENT_S and not restarted:
                return False
            self._peer, self._number = source, None
        self._heard = now
        return True

    def _follow(self, number: int, pulses: tuple[int, ...]) -> None:
        last = self._number
        self._number = number
        if last is not None and number == last and self._answer:
            self.progress.repeated += 1
            return
        if last is None or number < last:
            self.progress.connections += 1
            self._pacer.restart(self._pacer.speed)
        else:
            self.progress.missed += number - last - 1
        self._pacer.wait(lambda: True)
        values = tuple((pulse - CENTRE_US) / REACH_US if pulse else 0.0 for pulse in pulses)
        self.progress.answers += 1
        self._act(Controls(self._time, values, armed=True))
        motion = self._move()
        self.progress.steps += 1
        self._time, self._answer = motion.time, answer(motion)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
