"""Lockstep with ArduPilot's JSON back end.

The simulator listens on UDP 9002.  For each frame of servo outputs it advances by one sample and answers with one line
of JSON.

A frame, little-endian: magic 18458, requested rate (Hz), frame number and 16 pulse widths (us); or magic 29569 and 32
pulse widths.  The number reveals a repeated frame (ArduPilot received nothing for 1 s, older versions 10 s: the answer
is repeated without a step) and a restarted autopilot.  The requested rate is not followed: the step is the scenario's
sample interval, as the time stamp of the answer shows.  A pulse width of 0 is no signal.
https://github.com/ArduPilot/ardupilot/tree/master/libraries/SITL/examples/JSON
"""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import cos, pi
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Vector
from insenv.mavlink.lockstep.contract import Act, Controls, Lockstep, ignore
from insenv.mavlink.stream import Pacer, Stop
from insenv.mavlink.vehicle import Vehicle
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
MAP_RADIUS = 0.011131884502145034e7 * 180.0 / pi
"""Radius (m) of the sphere on which ArduPilot draws north and east (`LOCATION_SCALING_FACTOR`, metres per 1e-7 deg)."""
LEAST_COSINE = 0.01
PARAMETERS = {
    "SIM_DRIFT_SPEED": 0.0,
    "SIM_GYR1_RND": 0.0,
    "SIM_ACC1_RND": 0.0,
    **{f"INS_ACC{unit}OFFS_{axis}": 1e-5 for unit in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{unit}SCAL_{axis}": 1.0 for unit in ("", "2") for axis in "XYZ"},
}
"""With which ArduPilot's simulation adds the least to the inertial unit's own errors: no drift, no motor noise, no calibration
of either of the two units that it makes of one.

White noise remains that no parameter sets (`AP_InertialSensor_SITL::generate_accel`, `generate_gyro`): uniform, one or two
times within 0.01 m/s^2 and 0.04 deg/s in each sample.  An offset of exactly 0 counts as not calibrated and forbids arming:
1e-5 m/s^2 is a micro-g.
"""


def parameter_file() -> str:
    """`PARAMETERS` as ``--add-param-file`` of ArduPilot's `sim_vehicle.py` and ``--defaults`` of its program read them."""
    return "".join(f"{name} {value:g}\n" for name, value in PARAMETERS.items())


@dataclass(frozen=True)
class Motion:
    """The motion of a vehicle at the end of a sample.

    time: simulation clock (s).  rate_ib_b (3, rad/s), specific_force_b (3, m/s^2): measured means over the sample.
    position: true position from home on ArduPilot's map (3, m), see `on_map`.  velocity_n: true velocity (3, m/s).
    q_nb: true attitude (4).
    """

    time: float
    rate_ib_b: Vector
    specific_force_b: Vector
    position: Vector
    velocity_n: Vector
    q_nb: Vector


Move = Callable[[], Motion]
"""Advances by one sample and returns the motion at its end."""


def on_map(place: Sequence[float], home: Sequence[float]) -> Vector:
    """North, east and down (3, m) from home from which ArduPilot finds a place again: latitude, longitude (rad), height (m).

    ArduPilot turns metres into degrees on a sphere, east by the cosine of the mean latitude (`Location::offset_latlng`), and
    height into down by a difference (`Aircraft::update_position`).  A tangent plane would be on another place of this map: by
    0.9 m at 0.5 km, 12 to 21 m at 10 km.
    """
    middle = 0.5 * (place[0] + home[0])
    east = (place[1] - home[1] + pi) % (2.0 * pi) - pi
    return np.array([MAP_RADIUS * (place[0] - home[0]), MAP_RADIUS * max(cos(middle), LEAST_COSINE) * east, home[2] - place[2]])


def moving(vehicle: Vehicle) -> Move:
    """The steps of a vehicle as its motion from home; its messages are discarded."""
    simulation = vehicle.simulation

    def step() -> Motion:
        vehicle.step()
        truth, increment = simulation.truth, simulation.last_increment
        place = [float(truth[name]) for name in ("latitude", "longitude", "height")]
        return Motion(
            time=simulation.time,
            rate_ib_b=increment[:3] / simulation.interval,
            specific_force_b=increment[3:] / simulation.interval,
            position=on_map(place, vehicle.view.home),
            velocity_n=np.array(truth["velocity_n"]),
            q_nb=np.array(truth["q_nb"]),
        )

    return step


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
    """The line of JSON with the vehicle's state: SI, body axes FRD, NED from home, quaternion scalar first."""
    state = {
        "timestamp": motion.time,
        "imu": {"gyro": motion.rate_ib_b.tolist(), "accel_body": motion.specific_force_b.tolist()},
        "position": motion.position.tolist(),
        "velocity": motion.velocity_n.tolist(),
        "quaternion": motion.q_nb.tolist(),
    }
    return b"\n" + json.dumps(state, separators=(",", ":"), allow_nan=False).encode() + b"\n"


class ArduPilotLockstep(Lockstep):
    """The simulator's side.

    move: the vehicle.  act: receives the outputs before each step: (pulse - 1500) / 500 by channel, 0 without a
    pulse.  ArduPilot sends no arming state, so outputs count as armed as soon as a channel has a pulse.  There is one
    autopilot at a time: frames of others are refused until it has been silent for 15 s, unless their numbers start over,
    as those of a restarted autopilot do.  interval: of a sample (s), for speed: simulated seconds per second at most;
    0: as fast as ArduPilot asks.  Raises `InputError` for a wrong address, or a speed without an interval.
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
            restarted = number <= MAX_FIRST_NUMBER and self._number is not None and number <= self._number
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
        self._act(Controls(self._time, values, armed=any(pulses)))
        motion = self._move()
        self.progress.steps += 1
        self._time, self._answer = motion.time, answer(motion)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
