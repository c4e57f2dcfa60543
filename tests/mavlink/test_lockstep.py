"""Lockstep: the two protocols against small stand-ins that follow the autopilots' documented behaviour."""

import itertools
import math
import threading
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from autopilots import Px4StandIn, exchange, servo_frame
from pymavlink.dialects.v20 import common as m
from streamed_vehicle import Clock, wait_for

from insenv import geodesy
from insenv.base.errors import InputError
from insenv.mavlink import Vehicle
from insenv.mavlink.commands import answers
from insenv.mavlink.lockstep import ArduPilotLockstep, Controls, Motion, Px4Lockstep, moving, px4_messages, px4_rates, steering
from insenv.mavlink.lockstep.ardupilot import SILENT_S, answer, on_map, unpack
from insenv.mavlink.lockstep.px4 import COMPONENT, Cadence
from insenv.scenario import load

INTERVAL = 0.005
TCP, UDP = "tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"


def sensor(sample):
    return m.MAVLink_hil_sensor_message(
        round(sample * INTERVAL * 1e6), 0, 0, -9.8, 0, 0, 0, 0.2, 0, 0.4, 1013, 0, 0, 20, 0x1FFF
    )


def sensors():
    """A simulation of the clock only."""
    samples = itertools.count(1)
    return lambda: [sensor(next(samples))]


def microseconds(*samples):
    return [round(sample * INTERVAL * 1e6) for sample in range(*samples)]


def standing_in(simulator, **options):
    return Px4StandIn(simulator.link.address.port, **options)


def test_px4_starts_silent_and_then_runs_in_lockstep():
    taken = []
    with Px4Lockstep(sensors(), INTERVAL, taken.append, address=TCP) as simulator:
        px4 = standing_in(simulator, silent=20)
        progress = simulator.run(steps=1000)
        assert progress.steps == 1000
    px4.done()
    # no sensor message is lost, repeated or out of order
    assert px4.times == microseconds(1, 1001)
    # the first steps do not wait; from the first answer on each step has its own
    assert progress.unanswered == 0 and progress.answers == 980 and progress.connections == 1
    assert [round(controls.time * 1e6) for controls in taken] == px4.answered
    assert [round(controls.values[0] * 1e4) for controls in taken] == list(range(21, 1001))
    assert taken[0].values[1:3] == (-0.5, 0.25) and len(taken[0].values) == 16
    assert [controls.armed for controls in taken[:3]] == [True, False, True]


def test_px4_outputs_act_in_the_next_step():
    """Closed loop: the plant integrates the output, so that a single stale or missing output is detected."""
    read, outputs, seen = sensors(), [0.0], [0.0]

    def step():
        seen.append(seen[-1] + outputs[-1])
        return read()

    with Px4Lockstep(step, 0.5, lambda c: outputs.append(c.values[0]), address=TCP) as simulator:  # the first step waits 0.5 s
        px4 = standing_in(simulator)
        simulator.run(steps=300)
    px4.done()
    sent = np.float32(np.arange(1, 300) / 1e4).astype(float)
    np.testing.assert_array_equal(seen[1:], np.concatenate([[0.0], np.cumsum(sent)]))


def test_a_lost_answer_of_px4_neither_stops_nor_shifts_anything():
    with Px4Lockstep(sensors(), INTERVAL, address=TCP, patience=0.05) as simulator:
        px4 = standing_in(simulator, silent=3, skip=frozenset({100, 101, 200}))
        progress = simulator.run(steps=300)
    px4.done()
    assert progress.steps == 300 and progress.unanswered == 3 and progress.answers == 297 - 3


def test_the_number_of_samples_per_answer_is_learnt_and_forgotten():
    def samples(*gaps):
        cadence = Cadence(1.0)
        for gap in gaps:
            for _ in range(gap):
                cadence.sent()
            cadence.answered(0.001)
        return cadence.samples

    assert samples(1, 2, 1, 1, 3, 2) == 1  # lost answers are no pattern
    assert samples(1, 2, 2) == 2 and samples(4, 4, 4) == 4
    assert samples(4, 4, 2) == 2 and samples(2, 2, 1) == 1  # early ones count at once


@pytest.mark.parametrize(("flags", "options", "speed"), [(1, {"speed": 0.5}, 0.5), (0, {}, 1.0)])
def test_a_speed_paces_px4_and_without_lockstep_the_wall_clock_does(flags, options, speed):
    clock = Clock(0.0)
    with Px4Lockstep(sensors(), INTERVAL, address=TCP, clock=clock, sleep=clock.sleep, **options) as simulator:
        px4 = standing_in(simulator, silent=10 * flags, flags=flags)
        wait_for(lambda: simulator.run(steps=1).answers)  # the clock does not wait for its thread
        begun, steps = clock(), simulator.progress.steps
        progress = simulator.run(steps=400)
        assert simulator.in_step == bool(flags)
    px4.done()
    assert progress.steps == steps + 400 and progress.unanswered == 0
    assert clock() - begun == pytest.approx(400 * INTERVAL / speed, abs=3 * INTERVAL / speed)


def test_px4_disconnects_and_reconnects():
    with Px4Lockstep(sensors(), INTERVAL, address=TCP, patience=5.0) as simulator:
        first, second = standing_in(simulator, silent=2, last=50), []

        def stop():
            if not second and not first.is_alive() and not simulator.link.peers:
                second.append(standing_in(simulator, silent=2))
            return False

        progress = simulator.run(steps=200, stop=stop)
        assert progress.connections == 2
    second[0].done()
    assert first.times == microseconds(1, 51)
    # no time is sent twice, and the simulation stands still while PX4 is not connected
    assert second[0].times[0] > first.times[-1] and second[0].times[0] <= round(53 * INTERVAL * 1e6)
    assert second[0].times[-1] == round(200 * INTERVAL * 1e6)


def test_wrong_simulators_are_refused():
    for make, message in (
        (lambda: Px4Lockstep(sensors(), 0.0), "must be above 0"),
        (lambda: Px4Lockstep(sensors(), INTERVAL, address=UDP), "tcpin:HOST:PORT"),
        (lambda: Vehicle(load("car-city-drive"), hil_acceleration="g"), r"mG or mm/s\^2"),
        (lambda: ArduPilotLockstep(still(), speed=1.0), "interval"),
    ):
        with pytest.raises(InputError, match=message):
            make()


def test_px4_gets_the_vehicle_and_requests_an_interval():
    """Complete sensors at each sample, every fix once; HIL_STATE_QUATERNION as simulator_mavlink requests it: of nobody."""
    car = Vehicle(load("car-city-drive"), rates=px4_rates(200.0), component=COMPONENT, hil_acceleration="mm/s^2")
    request = m.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0)
    with Px4Lockstep(px4_messages(car), INTERVAL, answer=lambda message: answers(car, message), address=TCP) as simulator:
        px4 = standing_in(simulator, ask=(request,))
        simulator.run(steps=400)
    px4.done()
    got = px4.got
    kinds = {name: [g for g in got if g.get_type() == name] for name in {g.get_type() for g in got}}
    assert set(kinds) == {"HEARTBEAT", "HIL_SENSOR", "HIL_GPS", "HIL_STATE_QUATERNION", "STATUSTEXT", "COMMAND_ACK"}
    assert all((g.get_srcSystem(), g.get_srcComponent()) == (1, 200) for g in got)
    assert [(ack.command, ack.result) for ack in kinds["COMMAND_ACK"]] == [(511, 0)]
    truths = kinds["HIL_STATE_QUATERNION"]
    assert len(truths) > 350 and np.mean([t.zacc for t in truths]) == pytest.approx(-9800, abs=200)  # mm/s^2, as PX4 reads them
    first = [s for s in kinds["HIL_SENSOR"] if s.id == 0]
    assert [s.time_usec for s in first] == microseconds(1, 401)
    assert all(s.fields_updated & 0b111111 == 0b111111 for s in first)
    assert any(s.fields_updated & 0b1101000000000 == 0b1101000000000 for s in first)
    assert np.mean([s.zacc for s in first]) == pytest.approx(-9.8, abs=0.2)
    # each measurement again as sensor 1, which PX4 does not round
    main, again = {s.time_usec: s for s in first}, [s for s in kinds["HIL_SENSOR"] if s.id == 1]
    assert len(again) >= 399 and all(s.fields_updated == 0b111111 for s in again)
    assert all((s.zacc, s.xgyro) == (main[s.time_usec].zacc, main[s.time_usec].xgyro) for s in again)
    fixes = kinds["HIL_GPS"]
    assert len(fixes) == car.simulation.fixes and len({f.time_usec for f in fixes}) == len(fixes) >= 1


STILL = Motion(
    time=0.0,
    rate_ib_b=np.array([0.1, -0.2, 0.3]),
    specific_force_b=np.array([0.0, 0.0, -9.80665]),
    position=np.array([1.0, 2.0, -3.0]),
    velocity_n=np.array([0.5, 0.0, 0.25]),
    q_nb=np.array([1.0, 0.0, 0.0, 0.0]),
)


def still():
    """A vehicle at rest whose clock advances."""
    samples = itertools.count(1)
    return lambda: replace(STILL, time=next(samples) * INTERVAL)


@contextmanager
def running(simulator):
    """The simulator's side in a thread; gives its port."""
    ended, errors = threading.Event(), []

    def work():
        try:
            simulator.run(stop=ended.is_set)
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work, daemon=True)
    with simulator:
        thread.start()
        try:
            yield simulator.address.port
        finally:
            ended.set()
            thread.join(10)
    assert not errors


def times(link, *numbers):
    """The simulation's times, in samples, in the answers to these frames."""
    return [exchange(link, number)["timestamp"] / INTERVAL for number in numbers]


def test_ardupilot_gets_one_answer_per_frame(sockets):
    taken = []
    simulator = ArduPilotLockstep(still(), taken.append, address=UDP)
    with running(simulator) as port:
        link = sockets(to=port)
        for number in range(500):
            state = exchange(link, number, [1500, 1000, 2000, 1250, *[0] * 12])
            assert state["timestamp"] == pytest.approx((number + 1) * INTERVAL, abs=1e-12)
        assert state == {
            "timestamp": 2.5,
            "imu": {"gyro": [0.1, -0.2, 0.3], "accel_body": [0.0, 0.0, -9.80665]},
            "position": [1.0, 2.0, -3.0],
            "velocity": [0.5, 0.0, 0.25],
            "quaternion": [1.0, 0.0, 0.0, 0.0],
        }
        assert exchange(link, 500, [1500] * 31 + [1900])["timestamp"] == pytest.approx(501 * INTERVAL)
        exchange(link, 501, [0] * 16)
    assert taken[0].values == (0.0, -1.0, 1.0, -0.5, *[0.0] * 12) and taken[0].armed
    assert not taken.pop().armed  # no signal is no command: the script drives on
    assert len(taken[-1].values) == 32 and taken[-1].values[31] == pytest.approx(0.8)
    assert simulator.progress.answers == 502


def test_ardupilot_repeated_and_lost_frames_and_a_restart(sockets):
    simulator = ArduPilotLockstep(still(), address=UDP)
    with running(simulator) as port:
        shown = times(sockets(to=port), 7, 8, 8, 8, 9, 13, 0, 1)
    np.testing.assert_allclose(shown, [1, 2, 2, 2, 3, 4, 5, 6], atol=1e-9)
    progress = simulator.progress
    assert (progress.steps, progress.repeated, progress.missed, progress.connections) == (6, 2, 3, 2)


def test_ardupilot_invalid_frames_and_strangers(sockets):
    clock, good = Clock(0.0), servo_frame(1)
    simulator = ArduPilotLockstep(still(), address=UDP, clock=clock)
    with running(simulator) as port:
        link, stranger = sockets(to=port), sockets(to=port)
        for wrong in (b"", b"x", good[:-1], good + b"\0", b"\0" * 40, servo_frame(2, [1500] * 32)[:40], bytes(3000)):
            assert unpack(wrong) is None
            stranger.send(wrong)
        wait_for(lambda: simulator.progress.refused == 7)
        exchange(link, 1)
        stranger.send(servo_frame(2, [2000] * 16))
        exchange(link, 2)
        assert simulator.progress.steps == 2 and simulator.progress.refused == 8
        clock.now += SILENT_S + 1  # silent: another takes its place
        assert times(stranger, 5) == pytest.approx([3]) and simulator.progress.connections == 2


def test_a_restarted_ardupilot_is_taken_at_once(sockets):
    simulator = ArduPilotLockstep(still(), address=UDP, clock=Clock(0.0))
    with running(simulator) as port:
        first, second, stranger = (sockets(to=port) for _ in range(3))
        times(first, *range(5))
        stranger.send(servo_frame(3))  # another one, in mid-run
        times(first, 5)
        np.testing.assert_allclose(times(second, 0, 1, 2), [7, 8, 9], atol=1e-9)
        assert simulator.progress.connections == 2 and simulator.progress.refused == 1
    simulator = ArduPilotLockstep(still(), address=UDP, clock=Clock(0.0))
    with running(simulator) as port:
        for restarts in (1, 2):  # after its first frame alone
            assert times(sockets(to=port), 0) == pytest.approx([restarts]) and simulator.progress.connections == restarts


@pytest.mark.parametrize("distance", [500.0, 1400.0, 10e3, 100e3])
def test_ardupilot_finds_each_place_again_on_its_map(distance):
    """By `Location::offset_latlng` in the integers and single precision that ArduPilot has."""
    home, degree = (np.radians(47.3), np.radians(179.9), 400.0), 1e-7 * np.pi / 180.0
    for azimuth in np.radians(range(0, 360, 45)):
        latitude = home[0] + distance * np.cos(azimuth) / 6.37e6
        place = latitude, home[1] + distance * np.sin(azimuth) / 6.39e6 / np.cos(home[0]), 250.0
        north, east, down = on_map(place, home)
        first, turn = round(home[0] / degree), int(north / 0.011131884502145034)
        scale = max(np.cos(np.float32((first + turn // 2) * degree)), np.float32(0.01))
        found = first + turn, round(home[1] / degree) + int(east / 0.011131884502145034 / scale)
        assert np.abs((np.array(found) - np.array(place[:2]) / degree + 1.8e9) % 3.6e9 - 1.8e9).max() < 2.0 + 1e-6 * distance
        assert home[2] - down == pytest.approx(250.0)
        flat = np.ravel(geodesy.numeric.ned_offset(*place, *home))
        assert np.hypot(*(flat - on_map(place, home))[:2]) > 9e-4 * distance  # a tangent plane is another map


def test_ardupilot_gets_the_vehicle_in_finite_numbers(sockets):
    with pytest.raises(ValueError, match="Out of range"):
        answer(replace(STILL, position=np.array([math.nan, 0.0, 0.0])))
    car = Vehicle(load("car-city-drive"), rates=dict.fromkeys(px4_rates(200.0), 0.0))
    truth = car.simulation.truth
    with running(ArduPilotLockstep(moving(car), address=UDP)) as port:
        link = sockets(to=port)
        states = [exchange(link, n) for n in range(200)]
        last = states[-1]
        assert last["timestamp"] == pytest.approx(1.0)
        np.testing.assert_array_equal(last["velocity"], truth["velocity_n"])
        np.testing.assert_array_equal(last["quaternion"], truth["q_nb"])
        np.testing.assert_array_equal(last["imu"]["gyro"], car.simulation.last_increment[:3] / INTERVAL)
        assert np.linalg.norm(last["position"]) < 20.0
    assert np.mean([state["imu"]["accel_body"][2] for state in states]) == pytest.approx(-9.8, abs=0.2)


def test_outputs_steer_a_vehicle_that_can_be_steered():
    car = Vehicle(load("car-city-drive"), rates={})
    act, state, scale = steering(car, (1, 0, 2, 3)), car.simulation.state, car.sticks.full_scale
    for _ in range(400):
        act(Controls(car.simulation.time, (0.0, 0.0, 0.6, 0.5, *[0.0] * 12), armed=True))
        car.step()
    assert state("commanded_speed") == pytest.approx(0.6 * scale["SPEED"])
    assert state("commanded_yaw_rate") == pytest.approx(math.radians(0.5 * scale["TURN"]))
    act(Controls(0.0, (0.0, 0.0, 0.1, *[0.0] * 13), armed=False))  # not armed: not followed
    car.step()
    assert state("commanded_speed") == pytest.approx(0.6 * scale["SPEED"])
