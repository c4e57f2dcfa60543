"""ArduPilot's logs: old clocks, parameters, attitude alone, instruments, and the time of their samples."""

import numpy as np
import pytest
from flight_drive import described
from flight_writers import DataflashWriter

from insenv import replay
from insenv.geodesy.magnetic import world_magnetic_model
from insenv.logs import load

REST = (0.0, 0.0, 0.0, 0.0, 0.0, -9.8)


def at_rest(path, parameters=(), attitude=False, instruments=False, week=0):
    """Ten seconds at rest as ArduPilot writes them, fixes at 5 Hz."""
    log = DataflashWriter("IMU", "GPS", "PARM", "ATT", "MAG", "BARO")
    for name, value in dict(parameters).items():
        log.add("PARM", 0, name.encode(), value)
    for i in range(1000):
        at = i * 10_000
        log.add("IMU", at, 0, *REST)
        if i % 20 == 0:
            log.add("GPS", at, 0, 3, 0, week, 12, 0.8, 47.0, 15.0, 400.0, 0.0, 0.0, 0.0, 0, 1)
        if attitude and i % 10 == 0:
            log.add("ATT", at, 1.0, 2.0, 90.0)
        if instruments and i % 10 == 0:
            for instance in (0, 1):
                log.add("MAG", at, instance, 200 + instance, -10, 440)
            log.add("BARO", at, 0, 3.0, 95_000.0)
    path.write_bytes(log.data)
    return path


def test_the_lever_arm_comes_from_the_parameters_in_the_log_and_attitude_alone_is_a_reference(tmp_path):
    parameters = {"GPS_POS1_X": 0.5, "GPS_POS1_Y": 0.0, "GPS_POS1_Z": -0.25, "INS_POS1_X": 0.125}
    log = load(at_rest(tmp_path / "flight.BIN", parameters))
    assert log.lever_arm_b == pytest.approx([0.375, 0.0, -0.25])
    assert any("GPS_POS1_X, Y, Z less INS_POS1_X" in note for note in log.notes)
    log = load(at_rest(tmp_path / "flight.BIN", attitude=True))
    assert log.reference.latitude is None
    assert any("ATT: attitude without position and velocity" in note for note in log.notes)
    assert replay(log, "q-method").results[0].errors["pitch_deg"][-1] == pytest.approx(-2.0, abs=0.05)


def test_instruments_and_an_offset_of_the_fixes(tmp_path):
    log = load(described(at_rest(tmp_path / "flight.BIN", instruments=True), "gnss_time_offset_s = -0.25"))
    assert log.gnss.time[0] == pytest.approx(-0.25)
    assert any("no accuracy of the fixes' position" in note for note in log.notes)
    found = {each.id: each.values for each in log.instruments}
    assert sorted(found) == ["barometer", "magnetometer"]
    np.testing.assert_allclose(found["magnetometer"], np.tile([2e-5, -1e-6, 4.4e-5], (100, 1)), rtol=1e-9)
    # the pressure, not the height above the place of arming; ICAO Doc 7488: 540.3 m at 950 hPa
    np.testing.assert_allclose(found["barometer"], 540.3, atol=0.2)


def test_the_field_of_the_earth_is_that_of_the_log_s_date(tmp_path):
    """GPS week 1826: January 2015."""
    log = load(at_rest(tmp_path / "flight.BIN", instruments=True, week=1826))
    year = {
        each: world_magnetic_model(np.radians(47.0), np.radians(15.0), 400.0, each)[0] for each in (2010.0, 2015.03, 2026.0)
    }
    np.testing.assert_allclose(log.stated_errors["magnetic_field_n"], year[2015.03], atol=1e-9)
    assert np.abs(year[2015.03] - year[2026.0]).max() > 4e-7
    for week, expected in ((1, 2010.0), (0, 2026.0)):  # before the first coefficients; not known
        log = load(at_rest(tmp_path / "flight.BIN", instruments=True, week=week))
        np.testing.assert_allclose(log.stated_errors["magnetic_field_n"], year[expected], atol=1e-10)


def test_increments_are_over_intervals_of_their_own(tmp_path):
    """IMT: DelA over DelaT, DelV over DelvT; here the two differ from one another and from the step of 10 ms."""
    log = DataflashWriter("IMT")
    angle_s, velocity_s, rates, force = 0.008, 0.005, np.array([0.01, -0.02, 0.03]), np.array([0.5, -0.25, -9.75])
    for i in range(300):
        log.add("IMT", i * 10_000, 0, 0.01, velocity_s, angle_s, *(rates * angle_s), *(force * velocity_s))
    (tmp_path / "flight.BIN").write_bytes(log.data)
    found = load(tmp_path / "flight.BIN")
    assert len(found.dt) > 290
    np.testing.assert_allclose(found.delta_angle / found.dt[:, None], np.tile(rates, (len(found.dt), 1)), rtol=1e-6)
    np.testing.assert_allclose(found.delta_velocity / found.dt[:, None], np.tile(force, (len(found.dt), 1)), rtol=1e-6)


def test_gaps_twice_out_of_order_and_restarts(tmp_path):
    log = DataflashWriter("IMU")
    first = [t for t in range(0, 10_000_000, 10_000) if not 3_000_000 < t < 3_200_000]  # a gap that is bridged
    first[500], first[501] = first[501], first[500]
    first.insert(600, first[599])
    second = [t + 15_000_000 for t in range(0, 4_000_000, 10_000)]  # after a gap that is too long
    third = list(range(1_000_000, 3_000_000, 10_000))  # after a restart
    for t in (*first, *second, *third):
        log.add("IMU", t, 0, *REST)
    path = tmp_path / "flight.BIN"
    path.write_bytes(log.data)
    found = load(path)
    assert (found.imu_time[0], found.imu_time[-1]) == (pytest.approx(0.01), pytest.approx(9.99))
    assert found.gaps.count == 1 and found.gaps.samples == 19
    assert (np.diff(found.imu_time) > 0).all()
    assert any("2 samples are repeated or out of order" in note for note in found.notes)
    assert any(note.startswith("3 segments between restarts and gaps longer than 1 s: the longest") for note in found.notes)
    assert load(described(path, "start_s = 12.0")).imu_time[-1] == pytest.approx(18.99)
