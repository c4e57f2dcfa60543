"""PX4's logs: real ones, instruments against what was written, the lever arm, and damaged files."""

import gzip
import re

import numpy as np
import pytest
from flight_drive import described
from flight_writers import UlogWriter
from places import ROOT

from insenv import replay
from insenv.logs import load

REAL = ROOT / "tests" / "logs" / "data" / "px4" / "rest.ulg.gz"
FIELD_G = np.array([0.2, 0.01, 0.44])


def ulog(path):
    log = UlogWriter()
    for axis, value in zip("XYZ", (0.25, -0.5, -1.0), strict=True):
        log.parameter(f"EKF2_GPS_POS_{axis}", value)
    log.formats("sensor_combined", "vehicle_magnetometer", "vehicle_air_data", "vehicle_gps_position")
    for i in range(1000):
        at = 10_000 * (i + 1)
        log.add("sensor_combined", at, (0.0, 0.0, 0.0), 10_000, 0, (0.0, 0.0, -9.81), 10_000)
        if i % 5 == 0:
            log.add("vehicle_magnetometer", at + 900, at, FIELD_G * (1 + 1e-5 * i))
        if i % 10 == 0:
            log.add("vehicle_air_data", at + 900, at - 4000, 430.0 + 0.01 * i)
        if i % 20 == 0:
            heading = 1.25 if i % 40 else float("nan")
            log.add("vehicle_gps_position", at, at, 47.0, 8.0, 430.0, 478.0, 0.1, 1.0, 2.0, 0, 0, 0, heading, 0.02, 3, True)
    path.write_bytes(log.data)
    return path


def test_instruments_and_the_lever_arm(tmp_path):
    log = load(ulog(tmp_path / "a.ulg"))
    found = {each.id: each for each in log.instruments}
    np.testing.assert_allclose(found["magnetometer"].values[-1], FIELD_G * 1e-4 * 1.00995, rtol=1e-6)
    np.testing.assert_allclose(np.diff(found["magnetometer"].time), 0.05, atol=1e-9)
    # at its time of validity, and above the ellipsoid by the undulation of the receiver, 48 m
    np.testing.assert_allclose(found["barometer"].values[:, 0], 478.0 + 0.01 * np.arange(0, 1000, 10), atol=1e-4)
    assert found["barometer"].time[0] == pytest.approx(0.006, abs=1e-9)
    np.testing.assert_allclose(found["heading"].values, np.tile([1.25, 0.02], (25, 1)), rtol=1e-6)
    with pytest.warns(FutureWarning, match="stated_errors"):
        assert log.told is log.stated_errors
    assert log.stated_errors["magnetometer_hard_iron_sigma"] == pytest.approx(500e-9), "the default grade, calibrated"
    assert 2.0e-5 < np.hypot(*log.stated_errors["magnetic_field_n"][:2]) < 2.3e-5, "of the place of the fixes"
    assert log.lever_arm_b == pytest.approx([0.25, -0.5, -1.0])
    assert load(described(tmp_path / "a.ulg", "lever_arm_m = [0.0, 0.0, 0.5]")).lever_arm_b.tolist() == [0.0, 0.0, 0.5]


def test_a_real_log_of_2020_whole_and_damaged(tmp_path):
    """A vehicle at rest; receiver in degrees times 1e7, a solution without origin; the logger dropped out once."""
    log = load(REAL)
    assert log.rate_hz == pytest.approx(204.6, abs=0.1) and log.duration_s == pytest.approx(6.50, abs=0.01)
    assert len(log.gnss.time) == 32 and np.degrees(log.gnss.latitude[0]) == pytest.approx(63.417, abs=1e-3)
    assert log.reference.heading is not None and log.reference.latitude is None
    assert np.linalg.norm((log.delta_velocity / log.dt[:, None]).mean(axis=0)) == pytest.approx(9.82, abs=0.25)  # uncalibrated
    assert log.description.initial.static_until_s == pytest.approx(26.33, abs=0.01)
    assert any("dropouts of the logger" in note for note in log.notes)
    assert not any("cut off" in note or "damaged" in note for note in log.notes)
    whole, path = gzip.decompress(REAL.read_bytes()), tmp_path / "rest.ulg"
    for size in (len(whole) - 1, len(whole) * 2 // 3):
        path.write_bytes(whole[:size])
        assert sum("the file is cut off within its last message" in note for note in load(path).notes) == 1, size
    begin = len(whole) // 2  # a block of the card with other bytes: the messages after it are read
    path.write_bytes(whole[:begin] + bytes(4096) + whole[begin + 4096 :])
    log = load(path)
    (note,) = [note for note in log.notes if "the file is damaged" in note]
    assert 3900 < int(note.split("damaged: ")[1].split(" bytes")[0]) < 4400 and log.imu_time[-1] > 26.0


def test_a_real_log_of_2024():
    """PX4's simulated quadrotor takes off: the estimate follows PX4's own, and the touch-down is said.

    There it stops from 0.71 m/s, and its accelerometer shows nothing of it.
    """
    report = replay(ROOT / "examples" / "logs" / "px4-takeoff.ulg.gz", ["loosely-coupled"], start="reference")
    errors = {name: float(np.sqrt(np.mean(values**2))) for name, values in report.results[0].errors.items()}
    assert report.imu_samples > 5000
    assert max(errors["roll_deg"], errors["pitch_deg"], errors["heading_deg"]) < 0.5
    assert max(errors["north_m"], errors["east_m"]) < 0.5 and errors["down_m"] < 2.0
    (found,) = [note for note in report.results[0].notes if "touch-down" in note]
    assert re.match(r"between 25\.7\d and 25\.\d\d s the receiver's vd changes by -0\.[67]", found)
