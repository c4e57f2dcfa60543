"""What the readings of a magnetometer say of it: silence, a wrong scale, a field of the vehicle, currents."""

import numpy as np
import pytest

from insenv.logs.magnetic import calibrated, judged
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


def turning(count: int = 3000, seed: int = 1, noise: float = 1e-7, sway: float = 0.17) -> np.ndarray:
    """The field of the Earth (count, 3), T, of a vehicle that turns twice and sways by so much (rad), with white noise."""
    yaw, roll, pitch = np.linspace(0, 4 * np.pi, count), *(sway * np.sin(np.arange(count) * w) for w in (0.07, 0.11))
    c, s = np.cos(yaw), np.sin(yaw)
    level = np.column_stack([c * EARTH[0] + s * EARTH[1], -s * EARTH[0] + c * EARTH[1], np.full(count, EARTH[2])])
    x, z = level[:, 0] * np.cos(pitch) - level[:, 2] * np.sin(pitch), level[:, 0] * np.sin(pitch) + level[:, 2] * np.cos(pitch)
    y, z = level[:, 1] * np.cos(roll) + z * np.sin(roll), -level[:, 1] * np.sin(roll) + z * np.cos(roll)
    return np.column_stack([x, y, z]) + noise * np.random.default_rng(seed).standard_normal((count, 3))


def codes(remarks):
    return [each.code for each in remarks]


def test_fields_of_zero_are_left_out_and_named_and_a_magnetometer_without_others_is_none():
    field = turning(100)
    field[[3, 7]], field[5, 1] = 0.0, 0.0  # one component may be 0
    answered, _, remarks = judged(readings(field), STATED, 1.0)
    assert len(answered.time) == 98 and 0.3 not in answered.time.round(9)
    assert codes(remarks) == ["magnetometer-silent"] and "2 of 100" in remarks[0]
    none, _, remarks = judged(readings(np.zeros((50, 3))), STATED, 1.0)
    assert none is None and codes(remarks) == ["magnetometer-silent"] and "50 of 50" in remarks[0]


@pytest.mark.parametrize(("field", "turned", "code"), [
    (np.tile(EARTH, (200, 1)), 1.0, "magnetometer-stuck"), (np.tile(EARTH, (200, 1)), 0.0, None),
    (0.45 * turning(), 1.0, "magnetometer-impossible"), (2.1 * turning(), 1.0, "magnetometer-impossible"),
    (1e3 * turning(), 1.0, "magnetometer-impossible"), (1.9 * turning(), 1.0, "magnetometer-strength"),
])  # fmt: skip
def test_readings_that_are_stuck_or_of_an_impossible_strength_are_left_out(field, turned, code):
    left, _, remarks = judged(readings(field), STATED, turned)
    assert codes(remarks)[:1] == ([] if code is None else [code])
    assert (left is None) == (code in ("magnetometer-stuck", "magnetometer-impossible"))


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


@pytest.mark.parametrize("scale", [0.7, 1.0, 1.4])
@pytest.mark.parametrize("iron", [(9e-6, -6e-6, 0.0), (0.0, 0.0, 20e-6), (8e-6, -8e-6, 8e-6)])
def test_a_strength_that_depends_on_the_direction_is_a_field_of_the_vehicle(iron, scale):
    """The noise of the readings stands on both sides of the equation of the sphere."""
    got, rows, remarks = calibrated(readings(scale * turning() + np.array(iron)), STATED)
    assert codes(remarks)[0] == "magnetometer-strength"
    np.testing.assert_allclose(got.values, turning(), atol=1.5e-6)
    assert rows["magnetometer_hard_iron_sigma"] < 1.5e-6


def test_the_noise_of_readings_that_hardly_tilt_does_not_pass_for_a_tilt():
    """It is a third of what 1.5 deg change down: without its part on both sides the field is 6 to 11 uT off."""
    level = turning(4000, noise=3e-7, sway=0.026)
    got, _, _ = calibrated(readings(level + np.array([8e-6, -8e-6, 20e-6])), STATED)
    assert np.abs((got.values - level).mean(axis=0)).max() < 3e-6


def test_a_vehicle_that_does_not_turn_does_not_tell_its_field_from_a_scale_factor():
    given = readings(0.7 * EARTH + 1e-7 * np.random.default_rng(3).standard_normal((500, 3)))
    same, rows, remarks = calibrated(given, STATED)
    assert same is given and codes(remarks) == ["magnetometer-untold"]
    assert rows["magnetometer_hard_iron_sigma"] == pytest.approx(0.3 * np.linalg.norm(EARTH), rel=0.01)
    assert rows["magnetometer_soft_iron_sigma"] == pytest.approx(0.3, rel=0.01)


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
