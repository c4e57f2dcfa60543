"""Fixes that a logger holds until the next ones arrive."""

import numpy as np
from text_logs import imu_rows

from insenv.logs.text import repeats


def test_a_value_that_is_repeated_at_the_inertial_rate_is_one_fix(folder):
    """A receiver of 1 Hz in rows at 50 Hz; the last 10 s stand still."""
    imu = imu_rows(2000)
    epoch = np.minimum(np.floor(imu[:, 0] + 1e-9), 40.0)
    fixes = np.column_stack([45 + 1e-5 * epoch, np.full(2000, -93.0), np.full(2000, 200.0)])
    folder.imu(np.column_stack([imu, fixes]), ",lat,lon,h")
    folder.fixes_in_the_imu_file()
    log = folder.load()
    assert len(log.gnss.time) == len(np.unique(epoch))
    np.testing.assert_allclose(np.diff(log.gnss.time[1:]), 1.0, atol=0.021)
    assert any("2000 rows repeat 31 fixes, each about 50 times: a fix counts once" in note for note in log.notes)


def test_a_receiver_at_rest_that_states_the_same_place_is_not_repeating():
    time = np.arange(0.0, 60.0, 1.0)
    place = np.where(time < 30, 0.0, time - 30)[:, None] * [1e-5, 1e-5, 0.0]
    assert repeats(time, place) is None
    assert repeats(time, np.ones((60, 3))) is None  # at rest all the time
    fast = repeats(np.arange(0.0, 10.0, 0.01), np.ones((1000, 3)))  # a receiver of 100 Hz does not state the same for 10 s
    assert fast is not None and fast.rows.tolist() == [0]


def test_the_last_fix_before_an_outage_is_one_fix():
    """Thirty seconds of the same row, as thirty fixes, are each later and more wrong than the one before."""
    time = np.arange(0.0, 100.0, 0.01)
    epoch = np.floor(time)
    epoch[(time >= 40) & (time < 70)] = 40.0
    found = repeats(time, epoch[:, None] * [1e-5, 2e-5, 0.1])
    assert found is not None
    np.testing.assert_allclose(time[found.rows], np.unique(epoch), atol=1e-9)
