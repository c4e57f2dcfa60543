"""Logs of phones as GnssLogger 3.0 and 2.0 write them."""

import numpy as np
from text_logs import G, imu_rows

FIX = (
    "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis,"
    "SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters,MockLocation"
)
OLD_FIX = "# Fix,Provider,Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs"
UNIX_MS = 1_700_000_000_000


def phone(*lines):
    """Lines of fixes, and the samples of `imu_rows` in the axes of a phone, those of the accelerometer 4 ms late."""
    lines = ["# Version: v3.0.0.1", *lines, "Raw,1,2,3"]
    for kind, unit, of, factor, late in (("Gyro", "RadPerSec", 1, np.pi / 180, 0.0), ("Accel", "Mps2", 4, G, 0.004)):
        lines.append(
            f"# Uncal{kind},utcTimeMillis,elapsedRealtimeNanos," + ",".join(f"Uncal{kind}{axis}{unit}" for axis in "XYZ")
        )
        for row in imu_rows():
            forward, right, down = row[of : of + 3] * factor
            stamps = f"{UNIX_MS + (row[0] + late) * 1000:.0f},{(row[0] + late) * 1e9:.0f}"
            lines.append(f"Uncal{kind},{stamps},{right:.12g},{forward:.12g},{-down:.12g}")
    return "\n".join(lines) + "\n"


def fix(second, provider="GPS", bearing="90.0", vertical="4.0"):
    unix, boot = UNIX_MS + 1000 * second, second * 1e9
    return f"Fix,{provider},45.0,-93.0,200.0,5.0,3.02,{bearing},{unix:.0f},0.3,,{boot:.0f},{vertical},0"


def test_sensors_and_fixes_of_both_versions(folder):
    expected, rows, file = folder.load(), imu_rows(), 'file = "gnss_log_2023.txt"\n'
    folder.write("gnss_log_2023.txt", phone(FIX, fix(10.5), fix(11.0, "FLP"), fix(11.5, bearing="0.0", vertical="")))
    folder.toml = f'title = "phone"\n[imu]\n{file}[gnss]\n{file}lever_arm_m = [0, 0, 0]\n'
    log = folder.load()
    assert len(log.imu_time) == 98  # between instants, less the one before the accelerometer's first
    np.testing.assert_allclose(log.delta_angle, (expected.delta_angle[2:] + expected.delta_angle[1:-1]) / 2, rtol=1e-7,
        atol=1e-11)  # fmt: skip
    early = np.column_stack([np.interp(rows[1:, 0], rows[:, 0] + 0.004, each) for each in (rows[:, 4:] * G).T])
    np.testing.assert_allclose(log.delta_velocity, (early[1:] + early[:-1]) / 100, rtol=1e-7)
    np.testing.assert_allclose(log.gnss.time, [10.5, 11.5])
    np.testing.assert_allclose(log.gnss.position_sigma, [[2.0, 2.0, 4.0]] * 2, rtol=1e-3)
    np.testing.assert_allclose(log.gnss.velocity_n, [[0, 5, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(log.gnss.velocity_sigma[:, 0], [0.3, 100.0])  # a bearing of 0 is none
    assert any("1 fixes state no vertical accuracy" in note for note in log.notes)
    old = [f"Fix,gps,45,-93,200,5,3,{UNIX_MS + 1000 * second:.0f}" for second in (10.5, 11.5)]
    folder.write("gnss_log_2023.txt", phone(OLD_FIX, *old))
    log = folder.load()
    np.testing.assert_allclose([*log.gnss.time, log.imu_time[0]], 1.7e9 + np.array([10.5, 11.5, 10.06]), rtol=1e-11)
    assert log.gnss.velocity_n is None
    folder.toml += f"[barometer]\n{file}"
    folder.error("format 'gnss-logger' has no columns for [barometer]: allowed in [imu], [gnss], [magnetometer], [reference]")
    folder.write("gnss_log_2023.txt", phone(FIX))
    folder.error("no lines Fix for [gnss] (it has UncalGyro, UncalAccel)")
