"""Scripts of segments, commands from outside in their place, and the trackers that follow both."""

from types import SimpleNamespace

import numpy as np
import pytest
from lone_vehicle import history, plant

from insenv.core.runner import make_runner
from insenv.vehicles.car import SCRIPT
from insenv.vehicles.script import Tracker


def test_segments_follow_one_another_and_the_last_is_held_or_they_repeat() -> None:
    table = SCRIPT.table([{"duration": 1.0, "speed": 3.0}, {"duration": 0.5, "speed": 5.0}, {"duration": 2.0, "yaw_rate": 0.1}])
    rows = history("car", {"segments": table, "sample_interval": 0.01}, 600)
    commanded = rows["commanded_speed"][1:]
    assert set(commanded[:100]) == {3.0} and set(commanded[100:]) == {5.0}
    assert set(rows["commanded_yaw_rate"][1:151]) == {0.0} and set(rows["commanded_yaw_rate"][151:]) == {0.1}
    table = SCRIPT.table([{"duration": 0.105, "speed": 3.0}, {"duration": 0.2, "speed": 5.0}])
    rows = history("car", {"segments": table, "segments_repeat": 1, "sample_interval": 0.01}, 6100)
    assert (rows["commanded_speed"][1:] == 3.0).mean() == pytest.approx(0.105 / 0.305, abs=1e-3)


def test_commands_from_outside_replace_it() -> None:
    table = SCRIPT.table([{"duration": 1.0, "speed": 3.0}, {"duration": 1.0, "speed": 9.0}])
    runner = make_runner(plant("car"), {"segments": table, "sample_interval": 0.01})
    runner.run(50)
    runner.advance({"command_speed": 6.0, "command_acceleration": 2.0, "command_valid": 1.0})
    runner.advance({"command_valid": 0.0})
    runner.run(1500)
    assert runner.state["commanded_speed"] == 6.0 and runner.state["speed"] == pytest.approx(6.0, abs=1e-6)
    runner.advance({"command_acceleration": -3.0, "command_speed": 6.0, "command_valid": 1.0})
    runner.run(2000, every=0)
    assert runner.state["speed"] == pytest.approx(0.0, abs=1e-6)


def test_commands_of_a_multirotor() -> None:
    runner = make_runner(plant("multirotor"), {"start_height": 1000.0, "sample_interval": 0.02})
    runner.advance({"command_valid": 1.0, "command_forward": 4.0, "command_climb_rate": -1.0})
    runner.run(2000, every=0)
    np.testing.assert_allclose(runner.state["velocity_n"], [4.0, 0.0, 1.0], rtol=0, atol=1e-3)


@pytest.mark.parametrize("h", [0.01, 0.02, 0.5])
def test_it_follows_without_overshoot_or_breaking_its_limit(h: float) -> None:
    tracker, x, rng = Tracker(("s", "v", "a"), "speed", "m/s"), SimpleNamespace(s=0.0, v=0.0, a=0.0), np.random.default_rng(3)
    for _ in range(30):
        target, low, high = rng.choice([0.0, 0.0, rng.uniform(0, 20)]), x.s, x.s
        settle = round(rng.choice([1.0, 40.0]) / h)
        for _ in range(settle):
            vars(x).update(tracker.hold(x, h, target, 1.5, 2.0))
            middle = tracker.along(x, 0.5 * h)["s"]
            vars(x).update(tracker.along(x, h))
            low, high = min(low, x.s, middle), max(high, x.s, middle)
            assert x.s > -1e-12 and middle > -1e-12
            assert abs(x.v) <= 2.0 + 1e-12
        if settle * h > 30:
            assert abs(x.s - target) < 1e-3


def test_the_integral_within_a_sample_is_that_of_the_quantity() -> None:
    tracker, x, t, step = Tracker(("s", "v", "a"), "rate", "rad/s"), SimpleNamespace(s=0.7, v=-1.3, a=2.9), 0.4, 1e-4
    difference = (tracker.integral(x, t + step) - tracker.integral(x, t - step)) / (2 * step)
    assert tracker.integral(x, 0.0) == 0.0 and difference == pytest.approx(tracker.along(x, t)["s"], abs=1e-7)
