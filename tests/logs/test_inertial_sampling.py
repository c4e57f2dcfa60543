"""Regular and irregular stamps, gaps, and increments that a logger adds up or loses."""

import numpy as np
import pytest
from text_logs import N, imu_rows, si

from insenv.logs.inertial import missing_samples, sampling


def test_irregular_steps_are_no_gaps(folder):
    """Every sample covers the time since the one before, and none is invented; a longer gap among them is bridged."""
    rows = imu_rows()
    rows[:, 0] = 10.0 + np.cumsum(np.random.default_rng(2).uniform(0.004, 0.036, N))  # as of a phone
    folder.imu(rows)
    log, steps = folder.load(), np.diff(rows[:, 0])
    assert log.gaps.count == 0 and len(log.imu_time) == N
    np.testing.assert_allclose(log.dt[1:], steps, atol=1e-9)
    np.testing.assert_allclose(log.delta_angle[1:], si(imu_rows())[0][1:] * steps[:, None], rtol=1e-6, atol=1e-9)
    assert any("irregular time stamps" in note for note in log.notes)
    rows[60:, 0] += 0.4
    folder.imu(rows)
    log = folder.load()
    assert log.gaps.count == 1 and log.gaps.samples == pytest.approx(20, abs=8)


def merged(counts):
    """Increments at rest at 100 Hz, and the same added up over `counts` samples (k,), rows (k, 7) in SI."""
    total = int(counts.sum())
    noise = np.random.default_rng(5).normal(size=(total, 6)) * [1e-5] * 6
    full = np.column_stack([0.01 * np.arange(1, total + 1), noise + [0, 0, 0, 0, 0, -0.0980665]])
    last = np.cumsum(counts)
    sums = np.add.reduceat(full[:, 1:], np.concatenate([[0], last[:-1]]), axis=0)
    return full, np.column_stack([full[last - 1, 0], sums])


@pytest.mark.parametrize(("share", "longest"), [(0.3, 2), (0.8, 4)], ids=["regular", "irregular"])
def test_merged_increments_cover_their_time_and_show_the_rest(folder, share, longest):
    """Nothing is invented beside an increment of two samples, and the first, of unknown length, does not hide the rest."""
    rng = np.random.default_rng(3)
    counts = np.where(rng.random(3000) < share, rng.integers(2, longest + 1, 3000), 1)
    counts[0] = 2
    full, rows = merged(counts)
    folder.imu(rows)
    folder.hold_increments("rad")
    log = folder.load()
    assert log.gaps.count == 0 and len(log.imu_time) == len(rows) - 1
    np.testing.assert_allclose(log.dt, 0.01 * counts[1:], atol=1e-9)
    np.testing.assert_allclose(log.delta_velocity.sum(axis=0), full[2:, 4:].sum(axis=0), atol=1e-9)
    until = log.description.initial.static_until_s
    assert until is not None and full[-1, 0] - 3.0 < until <= full[-1, 0]  # whole windows of a hundred samples


def test_a_late_stamp_is_jitter_not_a_gap():
    steps = np.array([1, 1, 1.9, 0.1, 1, 1, 3.0, 1, 1, 1.7, 0.8, 0.8, 1, 2.0, 1.0]) * 0.01
    missing = missing_samples(np.concatenate(([0.0], np.cumsum(steps))), 0.01)
    assert missing.tolist() == [0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize(
    "time", [np.concatenate([k * 0.1 + np.arange(16) * 1e-3 for k in range(50)]), np.cumsum(np.tile([0.005, 0.015], 200))]
)
def test_bursts_and_alternating_steps_are_no_gaps(time):
    found = sampling(time, None)
    assert found.gap_s is not None and found.missing(time).sum() == 0


@pytest.mark.parametrize("share", [0.0, 0.02, 0.1])
def test_a_regular_log_that_loses_samples_stays_regular(share):
    draw = np.random.default_rng(5)
    kept = np.flatnonzero(draw.random(2000) >= share)
    time = (kept + draw.uniform(-0.1, 0.1, kept.size)) / 100.0
    found = sampling(time, None)
    assert found.gap_s is None and found.missing(time).sum() == kept[-1] - kept[0] + 1 - kept.size
