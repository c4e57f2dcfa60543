"""Magnetometer, barometer and two-antenna heading of flight logs, against what was written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flight_writers import DataflashWriter, UlogWriter

from insenv.logs import load
from insenv.logs.units import standard_height
from insenv.mavlink import Vehicle
from insenv.mavlink.simulation import Simulation
from insenv.mavlink.stream import Stream
from insenv.mavlink.wire.opening import open_link
from insenv.mavlink.wire.tlog import TlogWriter
from insenv.scenario import load as load_scenario

REST = (0.0, 0.0, 0.0, 0.0, 0.0, -9.81)
FIELD_G = (0.2, 0.01, 0.44)


def readings(log: Any) -> dict[str, Any]:
    return {each.id: each for each in log.instruments}


def ulog(path: Path) -> Path:
    log, stamp = UlogWriter(), ("uint64_t", "timestamp")
    sampled = ("uint64_t", "timestamp_sample")
    log.formats({
        "sensor_combined": [stamp, ("float[3]", "gyro_rad"), ("uint32_t", "gyro_integral_dt"),
                            ("int32_t", "accelerometer_timestamp_relative"), ("float[3]", "accelerometer_m_s2"),
                            ("uint32_t", "accelerometer_integral_dt")],
        "vehicle_magnetometer": [stamp, sampled, ("float[3]", "magnetometer_ga")],
        "vehicle_air_data": [stamp, sampled, ("float", "baro_alt_meter")],
        "vehicle_gps_position": [
            stamp, sampled, ("double", "latitude_deg"), ("double", "longitude_deg"), ("double", "altitude_msl_m"),
            ("double", "altitude_ellipsoid_m"), ("float", "s_variance_m_s"), ("float", "eph"), ("float", "epv"),
            ("float", "vel_n_m_s"), ("float", "vel_e_m_s"), ("float", "vel_d_m_s"), ("float", "heading"),
            ("float", "heading_accuracy"), ("uint8_t", "fix_type"), ("bool", "vel_ned_valid"),
        ],
    })  # fmt: skip
    for i in range(1000):
        at = 10_000 * (i + 1)
        log.add("sensor_combined", at, REST[:3], 10_000, 0, REST[3:], 10_000)
        if i % 5 == 0:
            log.add("vehicle_magnetometer", at + 900, at, np.array(FIELD_G) * (1 + 1e-3 * i))
        if i % 10 == 0:
            log.add("vehicle_air_data", at + 900, at - 4000, 430.0 + 0.01 * i)
        if i % 20 == 0:
            heading = 1.25 if i % 40 else float("nan")
            log.add("vehicle_gps_position", at, at, 47.0, 8.0, 430.0, 478.0, 0.1, 1.0, 2.0, 0, 0, 0, heading, 0.02, 3, True)
    path.write_bytes(log.data)
    return path


def test_ulog(tmp_path: Path) -> None:
    log = load(ulog(tmp_path / "a.ulg"))
    found = readings(log)
    np.testing.assert_allclose(found["magnetometer"].values[-1], np.array(FIELD_G) * 1e-4 * 1.995, rtol=1e-6)
    np.testing.assert_allclose(np.diff(found["magnetometer"].time), 0.05, atol=1e-9)
    # at its time of validity, and above the ellipsoid by the undulation of the receiver, 48 m
    np.testing.assert_allclose(found["barometer"].values[:, 0], 478.0 + 0.01 * np.arange(0, 1000, 10), atol=1e-4)
    assert found["barometer"].time[0] == pytest.approx(0.006, abs=1e-9)
    np.testing.assert_allclose(found["heading"].values, np.tile([1.25, 0.02], (25, 1)), rtol=1e-6)
    assert log.told["magnetometer_hard_iron_sigma"] == pytest.approx(500e-9), "the default grade, calibrated"
    assert 2.0e-5 < np.hypot(*log.told["magnetic_field_n"][:2]) < 2.3e-5, "of the place of the fixes"


def test_dataflash(tmp_path: Path) -> None:
    log = DataflashWriter()
    log.define("IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.define("GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U")
    log.define("MAG", "QBhhh", "TimeUS,I,MagX,MagY,MagZ")
    log.define("BARO", "QBff", "TimeUS,I,Alt,Press")
    for i in range(1000):
        at = 10_000 * (i + 1)
        log.add("IMU", at, 0, *REST)
        if i % 10 == 0:
            for instance in (0, 1):
                log.add("MAG", at, instance, 200 + instance, -10, 440)
            log.add("BARO", at, 0, 3.0, 95_000.0)
        if i % 20 == 0:
            log.add("GPS", at, 0, 3, 0, 0, 12, 0.8, 47.0, 8.0, 430.0, 0, 0, 0, 0, 1)
    (tmp_path / "a.bin").write_bytes(log.data)
    found = readings(load(tmp_path / "a.bin"))
    assert sorted(found) == ["barometer", "magnetometer"]
    np.testing.assert_allclose(found["magnetometer"].values, np.tile([2e-5, -1e-6, 4.4e-5], (100, 1)), rtol=1e-9)
    # the pressure, not the height above the place of arming; ICAO Doc 7488: 540.3 m at 950 hPa
    np.testing.assert_allclose(found["barometer"].values, 540.3, atol=0.2)


@pytest.mark.parametrize(("pressure", "height"), [(101_325.0, 0.0), (89_874.6, 1000.157), (26_436.3, 10_015.76)])
def test_heights_of_the_standard_atmosphere(pressure: float, height: float) -> None:
    """Tables of ICAO Doc 7488 by geopotential height, as geometric heights."""
    assert float(standard_height(np.array(pressure))) == pytest.approx(height, abs=0.2)
    assert np.isnan(standard_height(np.array([0.0]))).all()


def test_own_telemetry_holds_what_the_instruments_showed(tmp_path: Path) -> None:
    scenario, path = load_scenario("multirotor-hover"), tmp_path / "flight.tlog"
    vehicle = Vehicle(scenario, "loosely-coupled", speed=0.0, start_unix=1.8e9)
    with open_link("udpout:127.0.0.1:14598") as link, TlogWriter(path) as log:
        Stream(vehicle, link, log).run(10.0)
    again = Simulation(scenario, "loosely-coupled")
    shown: dict[str, list[Any]] = {"magnetometer": [], "barometer": []}
    for _ in range(2000):
        again.advance()
        for id, row in (("magnetometer", "magnetometer_field_b"), ("barometer", "barometer_height")):
            if again.truth[f"{id}_new"]:
                shown[id].append((again.time, *np.ravel(again.truth[row])))
    found = readings(load(path))
    for id, rows in shown.items():
        written = np.array(rows)[:150]
        np.testing.assert_allclose(found[id].time[:150], written[:, 0], atol=1e-6)
        np.testing.assert_allclose(found[id].values[:150], written[:, 1:], rtol=1e-6, atol=1e-11)
