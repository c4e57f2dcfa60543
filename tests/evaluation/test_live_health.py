"""Health of a running filter: the same verdict as over the recorded run, and what its changes of velocity could tell."""

import numpy as np
import pytest

from insenv.estimators.parts.rows import FIX_HEALTH
from insenv.evaluation import live_health
from insenv.evaluation.health import health
from insenv.evaluation.live_health import HOLD_S, LiveHealth

SIGMA = 0.1
"""Of fix and filter together, one axis, m/s."""


def outputs(k, square=1.0, velocity=(0.0, 0.0, 0.0), ratio=0.0):
    """Of a filter after k fixes of three positions and velocities with this mean NIS."""
    rows = {
        "fix_count": k, "fix_refused_count": 0, "nis_used": np.full(2, 3.0 * square * k), "nis_used_count": np.full(2, 3.0 * k),
        "nis_refused": np.zeros(2), "nis_refused_count": np.zeros(2),
    }  # fmt: skip
    sigma = np.full(3, SIGMA / np.sqrt(2.0))
    return {**rows, "velocity_n": np.array(velocity), "velocity_sigma": sigma, "test_ratio": np.full(6, ratio)}


def fed(velocities, every=1.0):
    """Health after fixes with these velocities north, m/s."""
    live = LiveHealth()
    for k, speed in enumerate(velocities):
        live.take(every * k, outputs(k + 1, velocity=(speed, 0.0, 0.0)), np.full(3, SIGMA / np.sqrt(2.0)))
    return live


def test_a_change_of_velocity_gives_the_heading_to_its_noise_over_it_and_uniform_motion_nothing():
    assert fed([0.0, 5.0]).heading_sigma == pytest.approx(np.sqrt(2.0) * SIGMA / 5.0, rel=1e-9)
    assert fed([0.0, 5.0, 5.0, 10.0]).heading_sigma == pytest.approx(SIGMA / 5.0, rel=1e-9)
    # were every change counted, each fix would bring 1 / rad^2, and 2.9 deg be known after 400
    drawn = np.random.default_rng(1).normal(20.0, SIGMA, 400)
    assert np.degrees(fed(drawn).heading_sigma) > 7.0
    assert fed(np.full(100, 20.0)).heading_sigma == np.inf
    # slow changes count within ten seconds and not across an outage
    assert fed(0.1 * np.arange(100)).heading_sigma < 0.1
    assert fed([0.0, 50.0], every=30.0).heading_sigma == np.inf
    frequent = fed(2.0 * 0.05 * np.arange(101), every=0.05)  # fixes at 20 Hz count as one within a second
    assert frequent.heading_sigma == pytest.approx(np.sqrt(2.0 / 5.0) * SIGMA / 2.0, rel=1e-6)


@pytest.mark.parametrize(("square", "verdict"), [(1.0, "consistent"), (1.3, "overconfident")])
def test_the_verdict_is_that_of_the_recorded_run_however_long_it_is(square, verdict, monkeypatch):
    """Of 300 records, 32 to 64 are kept."""
    monkeypatch.setattr(live_health, "MOST_RECORDS", 64)
    live, rows = LiveHealth(), [outputs(k, square) for k in range(1, 301)]
    for k, row in enumerate(rows):
        live.take(float(k), row, None)
    found = health({name: np.array([row[name] for row in rows], dtype=float) for name in FIX_HEALTH.names})
    assert live.verdict == found.verdict == verdict
    assert live.well == (verdict == "consistent")


def test_a_verdict_must_have_been_good_for_some_seconds():
    live, states = LiveHealth(), []
    for n in range(1, 41):
        live.take(float(n), outputs(n, square=4.0 if n <= 10 else 0.8), None)
        states.append((live.verdict, live.well))
    assert states[9] == ("overconfident", False)
    assert states[10] == ("consistent", False)
    assert [consistent for _, consistent in states].index(True, 10) + 1 == 10 + HOLD_S


def test_the_median_of_the_latest_fixes_contradicts():
    live = LiveHealth()
    for n, ratio in enumerate([0.0] * 10 + [9.0, 9.0, 0.0, 0.0, 0.0]):
        live.take(float(n), outputs(n + 1, ratio=ratio), None)
        assert not live.contradicted  # single outliers do not
    for n in range(15, 20):
        live.take(float(n), outputs(n + 1, ratio=4.0), None)
    assert live.contradicted
