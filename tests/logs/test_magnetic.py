"""What the readings of a magnetometer say of it: silence, a wrong scale, a field of the vehicle, currents."""

import numpy as np
import pytest

from insenv.logs.magnetic import calibrated, without_silence
from insenv.logs.recorded import Readings

EARTH = np.array([24e-6, 0.3e-6, 39e-6])
STATED = {
    "magnetic_field_n": EARTH, "magnetometer_hard_iron_sigma": 5e-7, "magnetometer_soft_iron_sigma": 0.01,
    "magnetometer_coupling_sigma": 0.005, "magnetic_field_sigma": np.full(3, 1e-7), "magnetometer_drift_sigma": 5e-8,
    "magnetometer_noise": 3e-7,
}  # fmt: skip
INTERVAL = 0.1


def readings(values: np.ndarray) -> Readings:
    return Readings("magnetometer", "MAG", INTERVAL * np.arange(len(values)), values, ("magnetometer_field_b",))


def turning(count: int = 3000, seed: int = 1) -> np.ndarray:
    """The field of the Earth (count, 3), T, of a vehicle that turns twice and sways by 10 deg, with noise of 0.1 uT."""
    yaw, roll, pitch = np.linspace(0, 4 * np.pi, count), *(0.17 * np.sin(np.arange(count) * w) for w in (0.07, 0.11))
    c, s = np.cos(yaw), np.sin(yaw)
    level = np.column_stack([c * EARTH[0] + s * EARTH[1], -s * EARTH[0] + c * EARTH[1], np.full(count, EARTH[2])])
    x, z = level[:, 0] * np.cos(pitch) - level[:, 2] * np.sin(pitch), level[:, 0] * np.sin(pitch) + level[:, 2] * np.cos(pitch)
    y, z = level[:, 1] * np.cos(roll) + z * np.sin(roll), -level[:, 1] * np.sin(roll) + z * np.cos(roll)
    return np.column_stack([x, y, z]) + 1e-7 * np.random.default_rng(seed).standard_normal((count, 3))


def codes(remarks):
    return [each.code for each in remarks]


def test_fields_of_zero_are_left_out_and_named_and_a_magnetometer_without_others_is_none():
    field = turning(100)
    field[[3, 7]], field[5, 1] = 0.0, 0.0  # one component may be 0
    answered, remarks = without_silence([readings(field), readings(np.zeros((50, 3)))])
    assert len(answered) == 1 and len(answered[0].time) == 98 and 0.3 not in answered[0].time.round(9)
    assert codes(remarks) == ["magnetometer-silent"] * 2
    assert "2 of 100" in remarks[0] and "50 of 50" in remarks[1]


def test_a_magnetometer_as_stated_stays_as_it_is():
    given = readings(turning() + np.array([4e-7, -3e-7, 2e-7]))
    same, rows, remarks = calibrated(given, STATED)
    assert same is given and rows == {} and remarks == []


@pytest.mark.parametrize("scale", [0.65, 1.6])
def test_a_strength_that_is_wrong_in_all_directions_is_a_scale_factor(scale):
    got, rows, remarks = calibrated(readings(scale * turning()), STATED)
    np.testing.assert_allclose(np.linalg.norm(got.values, axis=1).mean(), np.linalg.norm(EARTH), rtol=2e-3)
    assert codes(remarks)[0] == "magnetometer-strength" and rows["magnetometer_hard_iron_sigma"] < 1.5e-6
    assert rows["magnetometer_soft_iron_sigma"] == rows["magnetometer_coupling_sigma"] == 0.05, "of the grade uncalibrated"


def test_a_strength_that_depends_on_the_direction_is_a_field_of_the_vehicle():
    iron = np.array([9e-6, -6e-6, 0.0])
    got, rows, remarks = calibrated(readings(turning() + iron), STATED)
    assert codes(remarks)[0] == "magnetometer-strength"
    assert 4e-6 < rows["magnetometer_hard_iron_sigma"] < 12e-6  # rms of the components: 6.2 uT
    np.testing.assert_allclose(got.values, turning() + iron, rtol=0.1)


def test_a_vehicle_that_does_not_turn_does_not_tell_its_field_from_a_scale_factor():
    field = 0.7 * EARTH + 1e-7 * np.random.default_rng(3).standard_normal((500, 3))
    _, rows, remarks = calibrated(readings(field), STATED)
    assert codes(remarks) == ["magnetometer-strength"]
    assert rows["magnetometer_hard_iron_sigma"] == pytest.approx(0.3 / 0.7 * np.linalg.norm(EARTH), rel=0.15)


def test_currents_are_white_noise_of_the_same_spectrum_at_low_frequency():
    """Currents of 1 uT that last for 2 x 3 s: a white noise of 1 uT sqrt(6 s / 0.1 s) in the strength."""
    field, decay = turning(6000), np.exp(-INTERVAL / 3.0)
    current, rng = np.zeros(len(field)), np.random.default_rng(5)
    for i in range(1, len(field)):
        current[i] = decay * current[i - 1] + np.sqrt(1 - decay**2) * 1e-6 * rng.standard_normal()
    along = field / np.linalg.norm(field, axis=1)[:, None]
    _, rows, remarks = calibrated(readings(field + current[:, None] * along), STATED)
    assert codes(remarks) == ["magnetometer-disturbed"]
    assert rows["magnetometer_noise"] == pytest.approx(1e-6 * np.sqrt(6.0 / INTERVAL), rel=0.35)


def test_few_readings_show_nothing():
    given = readings(0.5 * turning(40))
    assert calibrated(given, STATED) == (given, {}, [])
