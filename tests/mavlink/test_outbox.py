"""Answers that wait for their turn, and the time at which messages are sent."""

from math import nan

import pytest
from streamed_vehicle import DENIED, command, quiet, set_parameter, texts

from insenv.errors import InputError
from insenv.mavlink.outbox import AT_ONCE, PEERS, WAITING, Outbox
from insenv.mavlink.pacing import BURST_MESSAGES, GIVE_UP_S, Pacer


def test_answers_are_bounded_and_each_peer_has_its_turn():
    outbox, out = Outbox(), []
    for peer in ("a", "b"):
        for _ in range(WAITING + 50):
            outbox.put(peer, [peer])
    assert outbox.dropped == 100
    while outbox.send(lambda peer, message: out.append((peer, message))):
        assert len(out) <= 2 * WAITING
    assert out[:4] == [("a", "a"), ("b", "b")] * 2 and out.count(("a", "a")) == out.count(("b", "b")) == WAITING
    for number in range(PEERS + 10):
        outbox.put(number, [0])
    assert outbox.dropped == 110
    assert outbox.send(lambda *_: None) == AT_ONCE
    # all parameters requested repeatedly: one list is pending
    fresh, out = Outbox(), []
    for _ in range(1000):
        fresh.put("a", iter(range(40)))
        fresh.put("b", iter(range(40)))
    while fresh.send(lambda peer, message: out.append(peer)):
        pass
    assert out.count("a") == out.count("b") == 40


class Clock:
    def __init__(self):
        self.now, self.slept = 0.0, []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def test_deadlines_are_absolute_and_bursts_have_pauses():
    clock = Clock()
    pacer = Pacer(0.005, 2.0, clock, clock.sleep)
    for _ in range(1000):
        pacer.wait(lambda: True)
        clock.now += 0.001  # the time that a sample takes
    assert clock.now == pytest.approx(2.5 + 0.001, abs=1e-9) and pacer.lateness(1.0) < 1e-9
    clock.now += 1.0  # a stall of 400 samples: caught up, in bursts
    clock.slept.clear()
    for _ in range(400):
        pacer.wait(lambda: True)
        pacer.sent(2)
    assert len(clock.slept) >= 400 * 2 // BURST_MESSAGES - 1 and pacer.slips == 0
    assert pacer.lateness(0.99) > 0.5
    clock.now += GIVE_UP_S + 2.0
    pacer.wait(lambda: True)
    assert pacer.slips == 1 and pacer.slipped == pytest.approx(GIVE_UP_S + 2.0, abs=0.2)
    served = []
    slow = Pacer(1.0, 1.0, clock, clock.sleep)
    assert slow.wait(lambda: served.append(clock.now) is None)
    assert len(served) > 40  # answers continue during a long wait
    pacer.restart(0.0)
    clock.slept.clear()
    assert pacer.wait(lambda: False)
    pacer.wait(lambda: True)
    assert not clock.slept


def test_a_new_speed_counts_at_once_and_keeps_the_part_of_the_sample_that_has_passed():
    clock = Clock()
    pacer = Pacer(1.0, 0.01, clock, clock.sleep)  # 100 s a sample
    assert not pacer.wait(lambda: clock.now < 25.0)  # interrupted after a quarter
    pacer.change(1.0)
    assert pacer.wait(lambda: True) and clock.now == pytest.approx(25.75, abs=0.05)
    # changes that follow one another without end do not delay a sample
    begun = clock.now
    speeds = [1.0, 0.5]
    while not pacer.wait(lambda: False):
        speeds.reverse()
        pacer.change(speeds[0])
    assert 1.0 <= clock.now - begun < 2.0


@pytest.mark.parametrize("speed", [1e-6, 0.0099, -1.0, 100.1, nan])
def test_speeds_that_would_freeze_the_stream_are_refused(speed):
    vehicle = quiet()
    assert command(vehicle, 31013, speed)[0] == DENIED and vehicle.speed == 1.0
    assert "0.01" in texts(vehicle)[0]
    assert set_parameter(vehicle, "SIM_SPEED", speed) == 1.0
    with pytest.raises(InputError, match=r"0.01 to 100"):
        quiet(speed=speed)
