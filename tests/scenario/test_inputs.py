"""Chunks of samples, the interval between records, lost samples."""

import numpy as np

from insenv.scenario.inputs import bridge_lost


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
