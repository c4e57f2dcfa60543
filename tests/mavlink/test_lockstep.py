"""Lockstep: the two protocols against small stand-ins that follow the autopilots' documented behaviour.

PX4 and ArduPilot themselves are not run here.
"""

from __future__ import annotations

import itertools
import json
import math
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from insenv.cli.lockstep import home_option
from insenv.errors import InputError
from insenv.mavlink import Vehicle
from insenv.mavlink.answers import answers
from insenv.mavlink.lockstep import (
    ArduPilotLockstep,
    Controls,
    Motion,
    Px4Lockstep,
    moving,
    px4_messages,
    px4_rates,
    steering,
)
from insenv.mavlink.lockstep.ardupilot import SILENT_S, answer, unpack
from insenv.mavlink.lockstep.cadence import SHORTEST_WAIT_S, Cadence
from insenv.mavlink.lockstep.px4 import COMPONENT
from insenv.mavlink.wire import dialect, open_link
from insenv.scenario import load

m = dialect()
INTERVAL = 0.005


class Sensors:
    """A simulation of the clock only."""

    def __init__(self) -> None:
        self.samples = 0

    def __call__(self) -> list[Any]:
        self.samples += 1
        return [sensor(self.samples)]


def sensor(sample: int) -> Any:
    return m.MAVLink_hil_sensor_message(
        round(sample * INTERVAL * 1e6), 0, 0, -9.8, 0, 0, 0, 0.2, 0, 0.4, 1013, 0, 0, 20, 0x1FFF
    )


class Px4StandIn(threading.Thread):
    """Connects, sends HEARTBEAT, reads HIL_SENSOR and answers each with outputs at its time.

    It does not answer the first `silent` sensors nor those of `skip`, and disconnects after `last` (None: never).
    """

    def __init__(
        self, port: int, silent: int, last: int | None = None, skip: frozenset[int] = frozenset(), flags: int = 1
    ) -> None:
        super().__init__(daemon=True)
        self.port, self.silent, self.last, self.skip, self.flags = port, silent, last, skip, flags
        self.times: list[int] = []
        self.answered: list[int] = []
        self.error: BaseException | None = None
        self.start()

    def run(self) -> None:
        try:
            self._fly()
        except (ConnectionError, OSError):
            pass
        except BaseException as error:
            self.error = error

    def _fly(self) -> None:
        mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
        mav.robust_parsing = True
        with socket.create_connection(("127.0.0.1", self.port), timeout=10) as link:
            link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            link.sendall(m.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(mav))
            while data := link.recv(4096):
                for message in mav.parse_buffer(data) or []:
                    assert message.get_type() != "BAD_DATA"
                    if message.get_type() != "HIL_SENSOR":
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

    def done(self) -> None:
        self.join(10)
        assert not self.is_alive() and self.error is None


# --- PX4 -----------------------------------------------------------------------------------------


def test_px4_starts_silent_and_then_runs_in_lockstep() -> None:
    sensors, taken = Sensors(), []
    with Px4Lockstep(sensors, INTERVAL, taken.append, address="tcpin:127.0.0.1:0") as simulator:
        px4 = Px4StandIn(simulator.link.address.port, silent=20)
        progress = simulator.run(steps=1000)
        assert progress.steps == sensors.samples == 1000
    px4.done()
    # no sensor message is lost, repeated or out of order
    assert px4.times == [round(i * INTERVAL * 1e6) for i in range(1, 1001)]
    # the first steps do not wait; from the first answer on each step has its own
    assert progress.unanswered == 0 and progress.answers == 980 and progress.connections == 1
    assert [round(controls.time * 1e6) for controls in taken] == px4.answered
    assert [round(controls.values[0] * 1e4) for controls in taken] == list(range(21, 1001))
    assert taken[0].values[1:3] == (-0.5, 0.25) and len(taken[0].values) == 16
    assert [controls.armed for controls in taken[:3]] == [True, False, True]


def test_px4_outputs_act_in_the_next_step() -> None:
    """Closed loop: the plant integrates the output, so that a single stale or missing output is detected."""
    value, outputs, seen = 0.0, [0.0], []
    samples = 0

    def step() -> list[Any]:
        nonlocal value, samples
        value += outputs[-1]
        samples += 1
        seen.append(value)
        return [sensor(samples)]

    with Px4Lockstep(step, INTERVAL, lambda c: outputs.append(c.values[0]), address="tcpin:127.0.0.1:0") as simulator:
        px4 = Px4StandIn(simulator.link.address.port, silent=0)
        simulator.run(steps=300)
    px4.done()
    sent = np.float32(np.arange(1, 300) / 1e4).astype(float)
    np.testing.assert_array_equal(seen, np.concatenate([[0.0], np.cumsum(sent)]))


def test_a_lost_answer_of_px4_neither_stops_nor_shifts_anything() -> None:
    with Px4Lockstep(Sensors(), INTERVAL, address="tcpin:127.0.0.1:0", patience=0.05) as simulator:
        px4 = Px4StandIn(simulator.link.address.port, silent=3, skip=frozenset({100, 101, 200}))
        progress = simulator.run(steps=300)
    px4.done()
    assert progress.steps == 300 and progress.unanswered == 3 and progress.answers == 297 - 3


@pytest.mark.parametrize("every", [2, 4])
def test_px4_that_answers_every_second_sample_costs_no_wait(every: int) -> None:
    """As PX4's rover does at half the sample rate: learnt after two answers."""
    taken: list[Controls] = []
    with Px4Lockstep(Sensors(), INTERVAL, taken.append, address="tcpin:127.0.0.1:0", patience=0.3) as simulator:
        silent = frozenset(n for n in range(10, 2001) if n % every)
        px4 = Px4StandIn(simulator.link.address.port, silent=3, skip=silent)
        progress = simulator.run(steps=2000)
        assert progress.samples_per_answer == every
    px4.done()
    assert progress.steps == 2000 and progress.unanswered <= 3 * (every - 1)
    # once learnt, each answer is waited for: none is late
    assert [round(c.time * 1e6) for c in taken[50:]] == px4.answered[50 : len(taken)]
    assert len(taken) == len(px4.answered)


def test_the_number_of_samples_per_answer_is_learnt_and_forgotten() -> None:
    def samples(cadence: Cadence, gaps: list[int]) -> int:
        for gap in gaps:
            for _ in range(gap):
                cadence.sent()
            cadence.answered(0.001)
        return cadence.samples

    assert samples(Cadence(1.0), [1, 2, 1, 1, 3, 2]) == 1  # lost answers are no pattern
    assert samples(Cadence(1.0), [1, 2, 2]) == 2 and samples(Cadence(1.0), [4, 4, 4]) == 4
    assert samples(Cadence(1.0), [4, 4, 2]) == 2 and samples(Cadence(1.0), [2, 2, 1]) == 1  # early ones count at once
    quick, slow = Cadence(1.0), Cadence(1.0)
    assert quick.wait_s == 1.0
    quick.answered(0.001), slow.answered(0.5)
    assert quick.wait_s == SHORTEST_WAIT_S and slow.wait_s == 1.0


@pytest.mark.parametrize("speed", [2.0, 0.5])
def test_a_speed_paces_px4(speed: float) -> None:
    clock = SharedClock()
    with Px4Lockstep(
        Sensors(), INTERVAL, address="tcpin:127.0.0.1:0", speed=speed, clock=clock, sleep=clock.sleep
    ) as simulator:
        px4 = Px4StandIn(simulator.link.address.port, silent=10)
        simulator.run(steps=400)
    px4.done()
    assert clock() == pytest.approx(400 * INTERVAL / speed, abs=0.02 * 400 * INTERVAL / speed)


class SharedClock:
    """A clock that only sleeping advances."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_px4_requests_an_interval(vehicle: Callable[..., Vehicle]) -> None:
    """As simulator_mavlink does when it connects: HIL_STATE_QUATERNION at 200 Hz, addressed to nobody in particular."""
    car = Vehicle(load("car-city-drive"), rates=px4_rates(200.0), component=COMPONENT, hil_acceleration="mm/s^2")
    got: list[Any] = []
    with Px4Lockstep(
        px4_messages(car), car.simulation.interval, answer=lambda message: answers(car, message), address="tcpin:127.0.0.1:0"
    ) as simulator:
        link = open_link(f"tcpout:127.0.0.1:{simulator.link.address.port}", system=1, component=1)

        def fly() -> None:
            with link:
                asked = False
                while sum(g.get_type() == "HIL_SENSOR" and g.id == 0 for g in got) < 300:
                    link.wait(0.05)
                    for _, message in link.receive():
                        got.append(message)
                        if not asked:
                            asked = True
                            link.send(m.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0))
                        if message.get_type() == "HIL_SENSOR" and message.id == 0:
                            link.send(m.MAVLink_hil_actuator_controls_message(message.time_usec, [0.0] * 16, 0, 1))

        thread = threading.Thread(target=fly, daemon=True)
        thread.start()
        simulator.run(steps=300)
        thread.join(10)
    (ack,) = [g for g in got if g.get_type() == "COMMAND_ACK"]
    assert (ack.command, ack.result, ack.get_srcComponent()) == (511, 0, 200)
    truths = [g for g in got if g.get_type() == "HIL_STATE_QUATERNION"]
    assert len(truths) > 250
    # mm/s^2, as PX4 reads them
    assert np.mean([t.zacc for t in truths]) == pytest.approx(-9800, abs=200)
    # each measurement again as sensor 1, which PX4 does not round
    main = {g.time_usec: g for g in got if g.get_type() == "HIL_SENSOR" and g.id == 0}
    again = [g for g in got if g.get_type() == "HIL_SENSOR" and g.id == 1]
    assert len(again) >= 299 and all(g.fields_updated == 0b111111 for g in again)
    assert all((g.zacc, g.xgyro) == (main[g.time_usec].zacc, main[g.time_usec].xgyro) for g in again)


def test_px4_connects_by_tcp() -> None:
    with pytest.raises(InputError, match="tcpin:HOST:PORT"):
        Px4Lockstep(Sensors(), INTERVAL, address="udpin:127.0.0.1:0")
    with pytest.raises(InputError, match=r"mG or mm/s\^2"):
        Vehicle(load("car-city-drive"), hil_acceleration="g")


def test_px4_without_lockstep_is_not_waited_for() -> None:
    now = [0.0]

    def sleep(seconds: float) -> None:
        now[0] += seconds

    with Px4Lockstep(Sensors(), INTERVAL, address="tcpin:127.0.0.1:0", clock=lambda: now[0], sleep=sleep) as simulator:
        px4 = Px4StandIn(simulator.link.address.port, silent=0, flags=0)
        progress = simulator.run(steps=200)
        assert not simulator.in_step
    px4.done()
    assert progress.steps == 200 and progress.unanswered == 0
    # at the pace of the wall clock: 200 steps of 5 ms
    assert now[0] == pytest.approx(199 * INTERVAL, abs=2 * INTERVAL)


def test_px4_disconnects_and_reconnects() -> None:
    sensors = Sensors()
    with Px4Lockstep(sensors, INTERVAL, address="tcpin:127.0.0.1:0", patience=5.0) as simulator:
        port = simulator.link.address.port
        first = Px4StandIn(port, silent=2, last=50)
        second: list[Px4StandIn] = []

        def stop() -> bool:
            if not second and not first.is_alive() and not simulator.link.peers:
                second.append(Px4StandIn(port, silent=2))
            return False

        progress = simulator.run(steps=200, stop=stop)
        assert progress.connections == 2
    second[0].done()
    assert first.times == [round(i * INTERVAL * 1e6) for i in range(1, 51)]
    # no time is sent twice, and the simulation stands still while PX4 is not connected
    assert second[0].times[0] > first.times[-1] and second[0].times[0] <= round(53 * INTERVAL * 1e6)
    assert second[0].times[-1] == round(200 * INTERVAL * 1e6)


def test_px4_not_connected() -> None:
    sensors = Sensors()
    asked = iter(range(5))
    with Px4Lockstep(sensors, INTERVAL, address="tcpin:127.0.0.1:0") as simulator:
        progress = simulator.run(stop=lambda: next(asked, None) is None)
    assert progress.steps == sensors.samples == 0
    with pytest.raises(InputError, match="must be above 0"):
        Px4Lockstep(sensors, 0.0)


def test_px4_gets_the_vehicle(vehicle: Callable[..., Vehicle]) -> None:
    """PX4 receives complete sensors at each sample, and every fix once."""
    car = vehicle(px4_rates(200.0))
    with Px4Lockstep(car.step, car.simulation.interval, address="tcpin:127.0.0.1:0") as simulator:
        got: list[Any] = []
        link = open_link(f"tcpout:127.0.0.1:{simulator.link.address.port}", system=1, component=1)

        def fly() -> None:
            with link:
                while len([g for g in got if g.get_type() == "HIL_SENSOR"]) < 400:
                    link.wait(0.05)
                    for _, message in link.receive():
                        got.append(message)
                        if message.get_type() == "HIL_SENSOR":
                            link.send(m.MAVLink_hil_actuator_controls_message(message.time_usec, [0.0] * 16, 0, 1))

        thread = threading.Thread(target=fly, daemon=True)
        thread.start()
        simulator.run(steps=400)
        thread.join(10)
    sensors = [g for g in got if g.get_type() == "HIL_SENSOR"]
    assert [s.time_usec for s in sensors] == [5000 * i for i in range(1, 401)]
    assert all(s.fields_updated & 0b111111 == 0b111111 and s.id == 0 for s in sensors)
    assert any(s.fields_updated & 0b1101000000000 == 0b1101000000000 for s in sensors)
    assert np.mean([s.zacc for s in sensors]) == pytest.approx(-9.8, abs=0.2)
    fixes = [g for g in got if g.get_type() == "HIL_GPS"]
    assert len(fixes) == car.simulation.fixes and len({f.time_usec for f in fixes}) == len(fixes) >= 1
    assert {g.get_type() for g in got} == {"HEARTBEAT", "HIL_SENSOR", "HIL_GPS", "HIL_STATE_QUATERNION", "STATUSTEXT"}
    assert all((g.get_srcSystem(), g.get_srcComponent()) == (1, 200) for g in got)


# --- ArduPilot -----------------------------------------------------------------------------------


STILL = Motion(
    time=0.0,
    rate_ib_b=np.array([0.1, -0.2, 0.3]),
    specific_force_b=np.array([0.0, 0.0, -9.80665]),
    position_n=np.array([1.0, 2.0, -3.0]),
    velocity_n=np.array([0.5, 0.0, 0.25]),
    q_nb=np.array([1.0, 0.0, 0.0, 0.0]),
)


def still() -> Callable[[], Motion]:
    """A vehicle at rest whose clock advances."""
    samples = itertools.count(1)
    return lambda: replace(STILL, time=next(samples) * INTERVAL)


def servo_frame(number: int, pulses: list[int], rate: int = 400) -> bytes:
    magic = {16: 18458, 32: 29569}[len(pulses)]
    return struct.pack(f"<HHI{len(pulses)}H", magic, rate, number, *pulses)


@contextmanager
def running(simulator: ArduPilotLockstep) -> Iterator[tuple[str, int]]:
    """The simulator's side in a thread."""
    ended = threading.Event()
    errors: list[BaseException] = []

    def work() -> None:
        try:
            simulator.run(stop=ended.is_set)
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield ("127.0.0.1", simulator.address.port)
    finally:
        ended.set()
        thread.join(10)
    assert not errors


@pytest.fixture
def autopilot() -> Iterator[Callable[[], socket.socket]]:
    made: list[socket.socket] = []

    def make() -> socket.socket:
        made.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made[-1].settimeout(5)
        return made[-1]

    yield make
    for each in made:
        each.close()


def exchange(link: socket.socket, place: tuple[str, int], frame: bytes) -> dict[str, Any]:
    link.sendto(frame, place)
    line = link.recv(4096)
    assert line.startswith(b"\n") and line.endswith(b"\n") and line.count(b"\n") == 2  # as the protocol requires
    return json.loads(line)


def test_ardupilot_gets_one_answer_per_frame(autopilot: Callable[[], socket.socket]) -> None:
    motion, taken = still(), []
    with ArduPilotLockstep(motion, taken.append, address="udpin:127.0.0.1:0") as simulator, running(simulator) as place:
        link = autopilot()
        for number in range(500):
            state = exchange(link, place, servo_frame(number, [1500, 1000, 2000, 1250, *[0] * 12]))
            assert state["timestamp"] == pytest.approx((number + 1) * INTERVAL, abs=1e-12)
        assert state == {
            "timestamp": 2.5,
            "imu": {"gyro": [0.1, -0.2, 0.3], "accel_body": [0.0, 0.0, -9.80665]},
            "position": [1.0, 2.0, -3.0],
            "velocity": [0.5, 0.0, 0.25],
            "quaternion": [1.0, 0.0, 0.0, 0.0],
        }
        # channels switched to 32
        assert exchange(link, place, servo_frame(500, [1500] * 31 + [1900]))["timestamp"] == pytest.approx(501 * INTERVAL)
    assert taken[0].values == (0.0, -1.0, 1.0, -0.5, *[0.0] * 12)
    assert len(taken[-1].values) == 32 and taken[-1].values[31] == pytest.approx(0.8)
    progress = simulator.progress
    assert (progress.steps, progress.answers, progress.connections) == (501, 501, 1)
    assert (progress.repeated, progress.missed, progress.refused) == (0, 0, 0)


def test_ardupilot_repeated_and_lost_frames_and_a_restart(autopilot: Callable[[], socket.socket]) -> None:
    motion = still()
    with ArduPilotLockstep(motion, address="udpin:127.0.0.1:0") as simulator, running(simulator) as place:
        link = autopilot()
        times = [exchange(link, place, servo_frame(n, [1500] * 16))["timestamp"] for n in (7, 8, 8, 8, 9, 13, 0, 1)]
    np.testing.assert_allclose(times, np.array([1, 2, 2, 2, 3, 4, 5, 6]) * INTERVAL, atol=1e-12)
    progress = simulator.progress
    assert (progress.steps, progress.repeated, progress.missed, progress.connections) == (6, 2, 3, 2)


def test_ardupilot_invalid_frames_and_strangers(autopilot: Callable[[], socket.socket]) -> None:
    now = [0.0]
    motion = still()
    good = servo_frame(1, [1500] * 16)
    with (
        ArduPilotLockstep(motion, address="udpin:127.0.0.1:0", clock=lambda: now[0]) as simulator,
        running(simulator) as place,
    ):
        link, stranger = autopilot(), autopilot()
        for wrong in (b"", b"x", good[:-1], good + b"\0", b"\0" * 40, servo_frame(2, [1500] * 32)[:40], bytes(3000)):
            assert unpack(wrong) is None
            stranger.sendto(wrong, place)
        exchange(link, place, good)
        stranger.sendto(servo_frame(2, [2000] * 16), place)
        exchange(link, place, servo_frame(2, [1500] * 16))
        assert simulator.progress.steps == 2 and simulator.progress.refused == 8
        now[0] += SILENT_S + 1  # silent: another takes its place
        assert exchange(stranger, place, servo_frame(5, [1500] * 16))["timestamp"] == pytest.approx(3 * INTERVAL)
        assert simulator.progress.connections == 2


def test_a_restarted_ardupilot_is_taken_at_once(autopilot: Callable[[], socket.socket]) -> None:
    now = [0.0]
    with (
        ArduPilotLockstep(still(), address="udpin:127.0.0.1:0", clock=lambda: now[0]) as simulator,
        running(simulator) as place,
    ):
        first, second, stranger = autopilot(), autopilot(), autopilot()
        for number in range(5):
            exchange(first, place, servo_frame(number, [1500] * 16))
        stranger.sendto(servo_frame(3, [1500] * 16), place)  # another one, in mid-run
        exchange(first, place, servo_frame(5, [1500] * 16))
        times = [exchange(second, place, servo_frame(n, [1500] * 16))["timestamp"] for n in (0, 1, 2)]
        np.testing.assert_allclose(times, np.array([7, 8, 9]) * INTERVAL, atol=1e-12)
        assert simulator.progress.connections == 2 and simulator.progress.refused == 1


def test_a_speed_paces_ardupilot(autopilot: Callable[[], socket.socket]) -> None:
    clock = SharedClock()
    with (
        ArduPilotLockstep(
            still(), address="udpin:127.0.0.1:0", interval=INTERVAL, speed=0.5, clock=clock, sleep=clock.sleep
        ) as simulator,
        running(simulator) as place,
    ):
        link = autopilot()
        for number in range(100):
            exchange(link, place, servo_frame(number, [1500] * 16))
        assert clock() == pytest.approx(100 * INTERVAL / 0.5, abs=1e-9)
    with pytest.raises(InputError, match="interval"):
        ArduPilotLockstep(still(), speed=1.0)


def test_home_as_ardupilot_takes_it() -> None:
    car = Vehicle(load("car-city-drive"))
    latitude, longitude, height, heading = map(float, home_option(car).split(","))
    known = car.simulation.plant.knowledge
    assert (latitude, longitude) == pytest.approx((math.degrees(known.latitude), math.degrees(known.longitude)), abs=1e-7)
    assert height == pytest.approx(known.height, abs=0.01)
    assert heading == pytest.approx(math.degrees(known.heading) % 360.0, abs=0.06)


def test_ardupilot_gets_finite_numbers_only() -> None:
    motion = replace(STILL, position_n=np.array([math.nan, 0.0, 0.0]))
    with pytest.raises(ValueError, match="Out of range"):
        answer(motion)
    with pytest.raises(InputError, match="udpin:HOST:PORT"):
        ArduPilotLockstep(still(), address="tcpin:127.0.0.1:9002")


def test_ardupilot_gets_the_vehicle(vehicle: Callable[..., Vehicle], autopilot: Callable[[], socket.socket]) -> None:
    car = vehicle(dict.fromkeys(px4_rates(200.0), 0.0))
    truth = car.simulation.truth
    with ArduPilotLockstep(moving(car), address="udpin:127.0.0.1:0") as simulator, running(simulator) as place:
        link = autopilot()
        states = [exchange(link, place, servo_frame(n, [1500] * 16)) for n in range(200)]
        last = states[-1]
        assert last["timestamp"] == pytest.approx(1.0)
        np.testing.assert_array_equal(last["velocity"], truth["velocity_n"])
        np.testing.assert_array_equal(last["quaternion"], truth["q_nb"])
        np.testing.assert_array_equal(last["imu"]["gyro"], car.simulation.last_increment[:3] / INTERVAL)
        assert np.linalg.norm(last["position"]) < 20.0
    assert np.mean([state["imu"]["accel_body"][2] for state in states]) == pytest.approx(-9.8, abs=0.2)


@pytest.fixture
def vehicle() -> Callable[..., Vehicle]:
    return lambda rates: Vehicle(load("car-city-drive"), "loosely-coupled", rates=rates, start_unix=1.7e9)


def test_outputs_steer_a_vehicle_that_can_be_steered(vehicle: Callable[..., Vehicle]) -> None:
    car = vehicle({})
    act = steering(car, (1, 0, 2, 3))
    values = (0.0, 0.0, 0.6, 0.5, *[0.0] * 12)
    for _ in range(400):
        act(Controls(car.simulation.time, values, armed=True))
        car.step()
    state = car.simulation.state
    assert state("commanded_speed") == pytest.approx(0.6 * car.sticks.full_scale["SPEED"])
    assert state("commanded_yaw_rate") == pytest.approx(math.radians(0.5 * car.sticks.full_scale["TURN"]))
    act(Controls(0.0, (0.0, 0.0, 0.1, *[0.0] * 13), armed=False))  # not armed: not followed
    car.step()
    assert state("commanded_speed") == pytest.approx(0.6 * car.sticks.full_scale["SPEED"])
