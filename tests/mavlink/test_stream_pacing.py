"""The time at which samples are due."""

import pytest
from streamed_vehicle import Clock

from insenv.mavlink.stream import BURST_MESSAGES, GIVE_UP_S, Pacer


def test_deadlines_are_absolute_and_bursts_have_pauses():
    clock = Clock(0.0)
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


def test_a_new_speed_counts_at_once_and_keeps_the_part_of_the_sample_that_has_passed():
    clock = Clock(0.0)
    pacer = Pacer(1.0, 0.01, clock, clock.sleep)  # 100 s a sample
    assert not pacer.wait(lambda: clock.now < 25.0)  # interrupted after a quarter
    pacer.change(1.0)
    assert pacer.wait(lambda: True) and clock.now == pytest.approx(25.75, abs=0.05)
    # changes that follow one another without end do not delay a sample
    begun, speeds = clock.now, [1.0, 0.5]
    while not pacer.wait(lambda: False):
        speeds.reverse()
        pacer.change(speeds[0])
    assert 1.0 <= clock.now - begun < 2.0
