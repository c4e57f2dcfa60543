"""The temperature column of an IMU log, the calibrated slopes, and the mounting angles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from text_logs import RATE, Folder, G, as_text, imu_rows, si

import insenv
from insenv.errors import InputError
from insenv.logs import load

HEADER = "t,gx,gy,gz,ax,ay,az,temp"
BIAS, SCALE = np.array([30.0, -20.0, 10.0]), np.array([100.0, 200.0, -50.0])
KEYS = """[imu]
temperature = "temp"
temperature_reference_degc = 25.0
gyro_temperature_slope_deg_h_k = [30.0, -20.0, 10.0]
gyro_scale_factor_slope_ppm_k = [100.0, 200.0, -50.0]
accel_temperature_slope_ug_k = 150.0
accel_scale_factor_slope_ppm_k = 40.0
"""


def heated() -> np.ndarray:
    """The rows of a unit that goes from 20 to 45 deg C, as its sensors read them (deg/s, g)."""
    rows = imu_rows()
    celsius = np.linspace(20.0, 45.0, len(rows))
    warmth = celsius[:, None] - 25.0
    gyro = rows[:, 1:4] * (1 + 1e-6 * SCALE * warmth) + BIAS / 3600.0 * warmth
    accel = rows[:, 4:7] * (1 + 40e-6 * warmth) + 150e-6 * warmth
    return np.column_stack([rows[:, 0], gyro, accel, celsius])


@pytest.mark.parametrize("axes", ["FRD", "FLU"])
@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_the_calibrated_errors_are_taken_off(folder: Folder, axes: str, kind: str) -> None:
    """Whatever the axes, the slopes are the sensor's, and rates and increments give the same."""
    rows = heated()
    if kind == "increment":
        rows[:, 1:4] = np.radians(rows[:, 1:4]) / RATE
        rows[:, 4:7] *= G / RATE
        folder.hold_increments("rad")
    folder.write("imu.csv", as_text(rows, HEADER))
    folder.change("[imu]\n", KEYS)
    folder.change('"FRD"', f'"{axes}"')
    log = folder.load()
    signs = np.array([1.0, -1.0, -1.0]) if axes == "FLU" else 1.0
    gyro, accel = (signs * values / RATE for values in si(imu_rows()))
    np.testing.assert_allclose(log.delta_angle, gyro, atol=1e-12)
    np.testing.assert_allclose(log.delta_velocity, accel, atol=1e-10)
    assert any("taken off, at 20 to 45 deg C" in note for note in log.notes)


def test_a_gap_is_bridged_with_the_temperature_of_its_time(folder: Folder) -> None:
    rows = np.delete(heated(), slice(40, 45), axis=0)
    folder.write("imu.csv", as_text(rows, HEADER))
    folder.change("[imu]\n", KEYS)
    log = folder.load()
    assert log.gaps.samples == 5
    np.testing.assert_allclose(log.delta_angle, si(imu_rows())[0] / RATE, atol=1e-5)
    own = ~log.bridged
    np.testing.assert_allclose(log.delta_angle[own], si(imu_rows())[0][own] / RATE, atol=1e-12)


def test_a_column_without_slopes_and_slopes_without_a_column(folder: Folder) -> None:
    folder.write("imu.csv", as_text(heated(), HEADER))
    folder.change("[imu]\n", '[imu]\ntemperature = "temp"\n')
    log = folder.load()
    np.testing.assert_allclose(log.temperature, np.linspace(20.0, 45.0, len(log.dt)) + 273.15, rtol=1e-12)
    assert not any("taken off" in note for note in log.notes)
    folder.change('temperature = "temp"\n', "accel_temperature_slope_ug_k = 150.0\n")
    assert "must be given with accel_temperature_slope_ug_k: the column of the temperature [deg C]" in folder.error()


def test_a_log_whose_errors_are_taken_off_is_written_without_its_slopes(folder: Folder, tmp_path: Path) -> None:
    folder.write("imu.csv", as_text(heated(), HEADER))
    folder.change("[imu]\n", KEYS)
    log = folder.load()
    (description, *_) = insenv.write(log, tmp_path / "again", ["log"])
    again = load(description)
    np.testing.assert_array_equal(again.temperature, log.temperature)
    np.testing.assert_allclose(again.delta_angle, log.delta_angle, rtol=1e-15)


def test_a_temperature_in_kelvin_is_refused(folder: Folder) -> None:
    rows = heated()
    rows[:, 7] += 273.15
    folder.write("imu.csv", as_text(rows, HEADER))
    folder.change("[imu]\n", KEYS)
    assert "column 'temp': temperature is 293.15 deg C, allowed -100 to 200" in folder.error()


def test_mounting_angles_turn_the_named_axes_into_those_of_the_body(folder: Folder) -> None:
    folder.change("[imu]\n", "[imu]\nmounting_angles_deg = [3.0, -2.0, 90.0]\n")
    folder.change('"FRD"', '"FLU"')
    log = folder.load()
    C_bs = Rotation.from_euler("ZYX", [90.0, -2.0, 3.0], degrees=True).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    gyro, accel = (values @ C_bs.T / RATE for values in si(imu_rows()))
    np.testing.assert_allclose(log.delta_angle, gyro, atol=1e-12)
    np.testing.assert_allclose(log.delta_velocity, accel, atol=1e-12)


def test_a_slope_of_two_numbers_is_refused_without_naming_other_axes(folder: Folder) -> None:
    """The slopes are those of x, y, z of the sensor, which need not be forward, right, down."""
    folder.write("imu.csv", as_text(heated(), HEADER))
    folder.change("[imu]\n", KEYS)
    folder.change("[30.0, -20.0, 10.0]", "[1, 2]")
    with pytest.raises(InputError, match=r"gyro_temperature_slope.*: must be a number, or a list of three, one for each axis"):
        folder.load()
