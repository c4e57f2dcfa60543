"""Lockstep with ArduPilot's JSON back end: the simulator listens on UDP 9002, takes a frame of servo outputs, goes one sample
on, and answers with one line of JSON.

A frame, little end first: magic 18458, rate (Hz) that the autopilot would like, number, and 16 pulse widths (us); or magic
29569 and 32 of them.  The number tells a frame that comes again (ArduPilot heard nothing for 10 s: it is answered again, and
the simulation stays where it is) and an autopilot that has been started anew.  The rate is not followed: the step is the
scenario's sample interval, and the answer's time stamp says so.
https://github.com/ArduPilot/ardupilot/tree/master/libraries/SITL/examples/JSON
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from dataclasses import replace
from typing import Any

from insenv.errors import InputError
from insenv.mavlink.lockstep.contract import Act, Controls, Motion, Progress, Stop, ignore, never
from insenv.mavlink.wire.address import Address, parse_address, resolve
from insenv.mavlink.wire.link import Clock

ADDRESS = "udpin:127.0.0.1:9002"
MAGICS = {18458: 16, 29569: 32}
"""Channels by magic."""
HEAD = struct.Struct("<HHI")
CENTRE_US, REACH_US = 1500, 500
SILENT_S = 15.0
"""After so long without a frame from the autopilot another one may take its place."""
READS_PER_TURN = 256


def unpack(datagram: bytes) -> tuple[int, int, tuple[int, ...]] | None:
    """Rate (Hz), number and pulse widths (us) of a frame, or None: it is none."""
    if len(datagram) < HEAD.size:
        return None
    magic, rate, number = HEAD.unpack_from(datagram)
    channels = MAGICS.get(magic)
    if channels is None or len(datagram) != HEAD.size + 2 * channels:
        return None
    return rate, number, struct.unpack_from(f"<{channels}H", datagram, HEAD.size)


def answer(motion: Motion) -> bytes:
    """The line that says where the vehicle is: SI, body axes FRD, NED from the origin, quaternion scalar first."""
    state = {
        "timestamp": motion.time,
        "imu": {"gyro": motion.rate_ib_b.tolist(), "accel_body": motion.specific_force_b.tolist()},
        "position": motion.position_n.tolist(),
        "velocity": motion.velocity_n.tolist(),
        "quaternion": motion.q_nb.tolist(),
    }
    return b"\n" + json.dumps(state, separators=(",", ":"), allow_nan=False).encode() + b"\n"


class ArduPilotLockstep:
    """The simulator's side.

    motion: the vehicle.  act: takes the outputs, (pulse - 1500) / 500 by channel and 0 where there is no pulse, before the
    step.  ArduPilot sends no arming state; outputs count as armed.  One autopilot at a time: frames of others are refused
    until it has been silent for 15 s.
    """

    def __init__(self, motion: Motion, act: Act = ignore, *, address: str = ADDRESS, clock: Clock = time.monotonic) -> None:
        self.progress = Progress()
        self._motion, self._act, self._clock = motion, act, clock
        self.address = parse_address(address)
        if self.address.kind != "udpin":
            raise InputError(f"address {address!r}: ArduPilot's JSON back end is listened for at udpin:HOST:PORT")
        self._socket = _bound(self.address)
        self.address = replace(self.address, port=self._socket.getsockname()[1])
        self._peer: Any = None
        self._heard = 0.0
        self._number: int | None = None
        self._said = b""

    def run(self, steps: int | None = None, stop: Stop = never) -> Progress:
        """Go on for so many steps (None: without end), or until `stop`."""
        end = None if steps is None else self.progress.steps + steps
        while not stop() and (end is None or self.progress.steps < end):
            if select.select([self._socket], (), (), 0.1)[0]:
                self._turn()
        return self.progress

    def _turn(self) -> None:
        """Answer the newest frame that waits: ArduPilot sends the next only after the answer, so older ones are repeats."""
        newest = None
        for _ in range(READS_PER_TURN):
            try:
                datagram, source = self._socket.recvfrom(2048)
            except BlockingIOError:
                break
            except OSError:  # an answer that nobody took
                continue
            frame = unpack(datagram)
            if frame is None or not self._is_peer(source):
                self.progress.refused += 1
                continue
            newest = frame
        if newest is None:
            return
        self._follow(*newest[1:])
        try:
            self._socket.sendto(self._said, self._peer)
        except OSError:
            self.progress.unanswered += 1

    def _is_peer(self, source: Any) -> bool:
        now = self._clock()
        if source != self._peer:
            if self._peer is not None and now - self._heard <= SILENT_S:
                return False
            self._peer, self._number = source, None
        self._heard = now
        return True

    def _follow(self, number: int, pulses: tuple[int, ...]) -> None:
        last = self._number
        self._number = number
        if last is not None and number == last and self._said:
            self.progress.repeated += 1
            return
        if last is None or number < last:
            self.progress.connections += 1
        else:
            self.progress.missed += number - last - 1
        values = tuple((pulse - CENTRE_US) / REACH_US if pulse else 0.0 for pulse in pulses)
        self.progress.answers += 1
        self._act(Controls(self._motion.time, values, armed=True))
        self._motion.step()
        self.progress.steps += 1
        self._said = answer(self._motion)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def __enter__(self) -> ArduPilotLockstep:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _bound(address: Address) -> socket.socket:
    family, place = resolve(address, socket.SOCK_DGRAM)
    bound = socket.socket(family, socket.SOCK_DGRAM)
    try:
        bound.setblocking(False)
        bound.bind(place)
    except OSError as error:
        bound.close()
        raise InputError(f"address {address}: {error.strerror or error}") from None
    return bound
