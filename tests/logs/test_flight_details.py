"""Flight logs: old clocks, lever arms by parameters, attitude without position, one sign of offsets, damaged ULog files."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from flight_writers import DataflashWriter, UlogWriter

from insenv import replay
from insenv.errors import InputError
from insenv.logs import RecordedLog, load

DATA = Path(__file__).parent / "data" / "px4"


def dataflash(path: Path, parameters: dict[str, float] | None = None, attitude: bool = False) -> DataflashWriter:
    """Ten seconds at rest as ArduPilot writes them, fixes at 5 Hz."""
    log = DataflashWriter()
    log.define("IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "QBIHBcLLeffffB", "TimeUS,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    log.define("PARM", "QNf", "TimeUS,Name,Value")
    log.define("ATT", "Qccc", "TimeUS,Roll,Pitch,Yaw")
    for name, value in (parameters or {}).items():
        log.add("PARM", 0, name.encode(), value)
    for i in range(1000):
        log.add("IMU", i * 10_000, 0, 0, 0, 0, 0, -9.8)
        if i % 20 == 0:
            log.add("GPS", i * 10_000, 3, 0, 0, 12, 0.8, 47.0, 15.0, 400.0, 0.0, 0.0, 0.0, 0, 1)
        if attitude and i % 10 == 0:
            log.add("ATT", i * 10_000, 1.0, 2.0, 90.0)
    path.write_bytes(log.data)
    return log


def test_fixes_of_2014_are_stamped_by_t(tmp_path: Path) -> None:
    """ArduPilot 3.2: TimeMS of a GPS message is the time of the GPS week, T that since boot; of an IMU message since boot."""
    log = DataflashWriter()
    log.define("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "BIHBcLLeeEefI", "Status,TimeMS,Week,NSats,HDop,Lat,Lng,RelAlt,Alt,Spd,GCrs,VZ,T")
    log.define("ATT", "Iccc", "TimeMS,Roll,Pitch,Yaw")
    for i in range(1000):
        t = 50_000 + i * 20
        log.add("IMU", t, 0, 0, 0, 0, 0, -9.8)
        log.add("ATT", t, 0, 0, 0)
        if i % 10 == 0:
            log.add("GPS", 3, 345_600_000 + i * 20, 1800, 9, 1.2, 47.0, 15.0, 0.0, 400.0, 0.0, 0.0, 0.0, t)
    (tmp_path / "old.BIN").write_bytes(log.data)
    found = load(tmp_path / "old.BIN")
    assert found.gnss is not None
    np.testing.assert_allclose(found.gnss.time, 50.0 + 0.2 * np.arange(100), atol=1e-9)
    assert found.gnss.latitude[0] == pytest.approx(np.radians(47.0))


def px4(path: Path, parameters: dict[str, float] | None = None) -> None:
    log = UlogWriter()
    for name, value in (parameters or {}).items():
        log.parameter(name, value)
    stamp = ("uint64_t", "timestamp")
    log.formats(
        {
            "sensor_combined": [
                stamp, ("float[3]", "gyro_rad"), ("uint32_t", "gyro_integral_dt"),
                ("int32_t", "accelerometer_timestamp_relative"), ("float[3]", "accelerometer_m_s2"),
                ("uint32_t", "accelerometer_integral_dt"),
            ],
            "vehicle_gps_position": [
                stamp, ("double", "latitude_deg"), ("double", "longitude_deg"), ("double", "altitude_msl_m"),
                ("double", "altitude_ellipsoid_m"), ("float", "s_variance_m_s"), ("float", "eph"), ("float", "epv"),
                ("float", "vel_n_m_s"), ("float", "vel_e_m_s"), ("float", "vel_d_m_s"), ("uint8_t", "fix_type"),
                ("bool", "vel_ned_valid"),
            ],
        }
    )  # fmt: skip
    for i in range(1, 1001):
        log.add("sensor_combined", i * 10_000, (0.0, 0.0, 0.0), 10_000, 0, (0.0, 0.0, -9.8), 10_000)
        if i % 20 == 0:
            log.add("vehicle_gps_position", i * 10_000, 47.0, 15.0, 400.0, 445.0, 0.3, 1.0, 2.0, 0.0, 0.0, 0.0, 3, True)
    path.write_bytes(log.data)


def arm(log: RecordedLog) -> list[float]:
    return [round(float(value), 6) for value in log.lever_arm_b]


def test_the_lever_arm_comes_from_the_parameters_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "flight.BIN"
    dataflash(path, {"GPS_POS1_X": 0.5, "GPS_POS1_Y": 0.0, "GPS_POS1_Z": -0.25, "INS_POS1_X": 0.125})
    log = load(path)
    assert arm(log) == [0.375, 0.0, -0.25] and any("GPS_POS1_X, Y, Z less INS_POS1_X" in note for note in log.notes)
    dataflash(path, {"GPS1_POS_X": 0.0, "GPS1_POS_Y": 0.0, "GPS1_POS_Z": 0.0})  # never set
    log = load(path)
    assert arm(log) == [0.0, 0.0, 0.0] and not any("lever arm" in note for note in log.notes)
    px4(tmp_path / "flight.ulg", {"EKF2_GPS_POS_X": 0.25, "EKF2_GPS_POS_Y": -0.5, "EKF2_GPS_POS_Z": -1.0})
    assert arm(load(tmp_path / "flight.ulg")) == [0.25, -0.5, -1.0]
    (tmp_path / "log.toml").write_text('flight = "flight.ulg"\nlever_arm_m = [0.0, 0.0, 0.5]\n')
    assert arm(load(tmp_path / "log.toml")) == [0.0, 0.0, 0.5]


def test_attitude_alone_is_a_reference(tmp_path: Path) -> None:
    path = tmp_path / "flight.BIN"
    dataflash(path, attitude=True)
    log = load(path)
    assert log.reference is not None and log.reference.latitude is None and log.reference.heading is not None
    assert any("ATT: attitude without position and velocity" in note for note in log.notes)
    result = replay(log, "q-method").results[0]
    assert set(result.errors) == {"roll_deg", "pitch_deg", "heading_deg"}
    assert result.errors["pitch_deg"][-1] == pytest.approx(-2.0, abs=0.05)
    with pytest.raises(InputError, match="must give position, velocity and attitude"):
        replay(log, "loosely-coupled", start="reference")


def test_an_offset_is_added_as_in_every_log(tmp_path: Path) -> None:
    dataflash(tmp_path / "flight.BIN")
    (tmp_path / "log.toml").write_text('flight = "flight.BIN"\ngnss_time_offset_s = -0.25\n')
    gnss = load(tmp_path / "log.toml").gnss
    assert gnss is not None and gnss.time[0] == pytest.approx(-0.25)
    (tmp_path / "log.toml").write_text('flight = "flight.BIN"\ngnss_delay_s = 0.25\n')
    with pytest.raises(InputError, match=r"gnss_delay_s = 0.25 s: .* write gnss_time_offset_s = -0.25"):
        load(tmp_path / "log.toml")


def test_a_ulog_file_that_is_cut_off_says_so(tmp_path: Path) -> None:
    whole = gzip.decompress((DATA / "rest.ulg.gz").read_bytes())
    path = tmp_path / "rest.ulg"
    path.write_bytes(whole)
    assert not any("cut off" in note or "damaged" in note for note in load(path).notes)
    for size in (len(whole) - 1, len(whole) * 2 // 3):
        path.write_bytes(whole[:size])
        notes = [note for note in load(path).notes if "the file is cut off within its last message" in note]
        assert len(notes) == 1, size


def test_a_ulog_file_with_foreign_bytes_says_so(tmp_path: Path) -> None:
    """A block of the card with other bytes: the messages after it are read."""
    whole = gzip.decompress((DATA / "rest.ulg.gz").read_bytes())
    path = tmp_path / "rest.ulg"
    begin = len(whole) // 2
    path.write_bytes(whole[:begin] + bytes(4096) + whole[begin + 4096 :])
    log = load(path)
    (note,) = [note for note in log.notes if "the file is damaged" in note]
    lost = int(note.split("damaged: ")[1].split(" bytes")[0])
    assert 3900 < lost < 4400 and log.imu_time[-1] > 26.0
