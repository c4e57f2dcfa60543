"""Trackers follow their commands without overshoot, within their limits."""

from types import SimpleNamespace

import numpy as np
import pytest

from insenv.vehicles.script import Tracker


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
