"""Logs of phones as GnssLogger 3.0 and 2.0 write them."""

import numpy as np
from text_logs import G, imu_rows

SENSOR = (
    "{kind},utcTimeMillis,elapsedRealtimeNanos,{kind}X{unit},{kind}Y{unit},{kind}Z{unit},BiasX{unit},BiasY{unit},BiasZ{unit}"
)
FIX = (
    "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis,"
    "SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters,MockLocation"
)
UNIX_MS = 1_700_000_000_000


def phone(fixes, heading=FIX):
    """The samples of `imu_rows` in the axes of a phone, accelerometer 5 ms late; and lines of fixes."""
    lines = ["# Version: v3.0.0.1", heading, *fixes, "Raw,1,2,3"]
    for kind, unit, columns, factor, late in (
        ("UncalGyro", "RadPerSec", (1, 2, 3), np.pi / 180, 0.0),
        ("UncalAccel", "Mps2", (4, 5, 6), G, 0.005),
    ):
        lines.append("# " + SENSOR.format(kind=kind, unit=unit))
        for row in imu_rows():
            forward, right, down = row[list(columns)] * factor
            stamp = row[0] + late
            values = ",".join(f"{v:.12g}" for v in (right, forward, -down, 0, 0, 0))
            lines.append(f"{kind},{UNIX_MS + stamp * 1000:.0f},{stamp * 1e9:.0f},{values},3")
    return "\n".join(lines) + "\n"


def fix(second, provider="GPS", **changed):
    given = {"speed": "5.0", "accuracy": 3.02, "bearing": "90.0", "speed_sigma": "0.3", "vertical": "4.0", **changed}
    motion = f"{given['speed']},{given['accuracy']},{given['bearing']}"
    stamps = f"{UNIX_MS + 1000 * second:.0f},{given['speed_sigma']},,{second * 1e9:.0f}"
    return f"Fix,{provider},45.0,-93.0,200.0,{motion},{stamps},{given['vertical']},0"


def test_sensors_and_fixes_on_the_phone_s_own_clock(folder):
    expected = folder.load()
    log = phone([fix(10.5), fix(11.0, "FLP"), fix(11.5, bearing="0.0", vertical="")])
    folder.write("gnss_log_2023_11_14.txt", log)
    name = 'file = "gnss_log_2023_11_14.txt"\n'
    folder.toml = f'title = "phone"\n[imu]\n{name}[gnss]\n{name}lever_arm_m = [0, 0, 0]\n'
    log = folder.load()
    assert len(log.imu_time) == 98  # instants, less the one before the accelerometer's first
    midpoints = (expected.delta_angle[2:] + expected.delta_angle[1:-1]) / 2
    np.testing.assert_allclose(log.delta_angle, midpoints, rtol=1e-7, atol=1e-11)
    early = np.array([np.interp(imu_rows()[1:, 0], imu_rows()[:, 0] + 0.005, each) for each in (imu_rows()[:, 4:] * G).T]).T
    np.testing.assert_allclose(log.delta_velocity, (early[1:] + early[:-1]) / 100, rtol=1e-7)
    np.testing.assert_allclose(log.gnss.time, [10.5, 11.5])
    np.testing.assert_allclose(log.gnss.position_sigma, [[2.0, 2.0, 4.0], [2.0, 2.0, 4.0]], rtol=1e-3)
    np.testing.assert_allclose(log.gnss.velocity_n, [[0, 5, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(log.gnss.velocity_sigma[:, 0], [0.3, 100.0])  # 0 is a course that is not known
    assert any("1 fixes state no vertical accuracy" in note for note in log.notes)


def test_old_fixes_have_unix_times_alone(folder):
    old = [",".join(["Fix", "gps", "45.0", "-93.0", "200", "5", "3", f"{UNIX_MS + 1000 * s:.0f}"]) for s in (10.5, 11.5)]
    folder.write("phone.txt", phone(old, "# Fix,Provider,Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs"))
    name = 'file = "phone.txt"\nformat = "gnss-logger"\n'
    folder.toml = f'title = "phone"\n[imu]\n{name}[gnss]\n{name}lever_arm_m = [0, 0, 0]\n'
    log = folder.load()
    np.testing.assert_allclose(log.gnss.time, [1.7e9 + 10.5, 1.7e9 + 11.5], rtol=1e-12)
    assert log.gnss.velocity_n is None and log.imu_time[0] > 1.7e9
    folder.toml += f"[barometer]\n{name}"
    folder.error("format 'gnss-logger' has no columns for [barometer]: allowed in [imu], [gnss], [magnetometer], [reference]")
    folder.write("phone.txt", phone([]))
    folder.error("phone.txt: no lines Fix for [gnss] (it has UncalGyro, UncalAccel)")
