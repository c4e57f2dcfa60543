"""Chunks of samples, the interval between records, lost samples."""

import numpy as np

from insenv.plant.feeding import bridge_lost, chunks


def test_chunks_cover_all_samples_in_whole_records():
    assert list(chunks(60, 6, 20)) == [(0, 18), (18, 18), (36, 18), (54, 6)]
    assert list(chunks(60, 30, 20)) == [(0, 30), (30, 30)]  # a record is longer than a chunk


def test_lost_samples_are_interpolated_and_held_at_the_ends():
    rising = np.arange(6.0)[:, None] * np.ones(3)
    columns = {
        "imu_valid": np.array([0.0, 1.0, 0.0, 0.0, 1.0, 0.0]),
        "delta_angle": np.where([[0], [1], [0], [0], [1], [0]], rising, np.nan),
        "delta_velocity": rising.copy(),
    }
    assert bridge_lost(columns) == 4
    np.testing.assert_allclose(columns["delta_angle"][:, 0], [1, 1, 2, 3, 4, 4])
    np.testing.assert_allclose(columns["delta_velocity"][:, 2], [1, 1, 2, 3, 4, 4])
