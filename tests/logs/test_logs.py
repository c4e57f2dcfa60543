"""Recorded logs: formats, units, axes, references."""

import math

import numpy as np
import pytest
from text_logs import RATE, N, as_text, gnss_rows, imu_rows, increments, si

from insenv.logs.units import axes_matrix


def test_rates_over_the_interval_before_and_after_the_stamp_and_of_instants(folder):
    log, rows, fixes = folder.load(), imu_rows(), gnss_rows()
    gyro, accel = si(rows)
    np.testing.assert_allclose(log.imu_time, rows[:, 0], rtol=1e-11)
    np.testing.assert_allclose(log.dt, 1 / RATE, rtol=1e-9)
    np.testing.assert_allclose(log.delta_angle, gyro / RATE, rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(log.delta_velocity, accel / RATE, rtol=1e-8, atol=1e-12)
    assert log.gaps.count == 0 and not log.bridged.any() and log.notes == ()
    assert log.rate_hz == pytest.approx(RATE) and log.duration_s == pytest.approx(N / RATE)
    np.testing.assert_allclose(np.degrees([log.gnss.latitude, log.gnss.longitude]), fixes[:, 1:3].T, rtol=1e-10)
    np.testing.assert_allclose(log.gnss.position_sigma, fixes[:, 4:7])
    np.testing.assert_array_equal(log.lever_arm_b, [1, 2, -3])
    assert log.gnss.velocity_n is None and log.reference is None
    assert [(s.section, s.rows_used) for s in log.sources] == [("imu", N), ("gnss", 3)]
    folder.change(('"interval_end"', '"interval_start"'))
    log = folder.load()
    np.testing.assert_allclose(log.imu_time, rows[:, 0] + 1 / RATE, rtol=1e-11)
    np.testing.assert_allclose(log.delta_angle, gyro / RATE, rtol=1e-8, atol=1e-14)
    folder.change(('"interval_start"', '"instant"'))
    log = folder.load()
    np.testing.assert_allclose(log.imu_time, rows[1:, 0], rtol=1e-11)
    np.testing.assert_allclose(log.delta_angle, (gyro[1:] + gyro[:-1]) / 2 / RATE, rtol=1e-8, atol=1e-14)


def test_increments_in_degrees_semicolons_and_numbers_for_columns(folder):
    expected = increments(imu_rows())
    folder.write("imu.csv", as_text(np.column_stack([expected[:, 0], np.degrees(expected[:, 1:4]), expected[:, 4:]]), sep=";"))
    folder.change(('"t"', "0"), ('["gx", "gy", "gz"]', "[1, 2, 3]"), ('["ax", "ay", "az"]', "[4, 5, 6]"))
    folder.hold_increments("deg")
    log = folder.load()
    np.testing.assert_allclose(np.hstack([log.delta_angle, log.delta_velocity]), expected[:, 1:], rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize(("unit", "factor"), [("rad/s", math.pi / 180), ("deg/h", 3600.0), ("rad/h", 3600.0 * math.pi / 180)])
def test_gyro_units_and_milliseconds_mean_the_same(folder, unit, factor):
    expected, rows = folder.load(), imu_rows()
    rows[:, 1:4] *= factor
    rows[:, 0] = 1000 * (rows[:, 0] - 4)
    folder.imu(rows)
    folder.change(('"deg/s"', f'"{unit}"'), ("[imu]", '[imu]\ntime_unit = "ms"\ntime_offset_s = 4.0\nrate_hz = 50.0'))
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, expected.delta_angle, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(log.imu_time, expected.imu_time, rtol=1e-11)


@pytest.mark.parametrize(("axes", "matrix"), [
    ("RFU", [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    ("-z+y+x", [[0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    ([[0, 1, 0], [1, 0, 0], [0, 0, -1]], [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
])  # fmt: skip
def test_axes(folder, axes, matrix):
    body, c_bs, rows = folder.load(), np.array(matrix, dtype=float), imu_rows()
    np.testing.assert_array_equal(axes_matrix(axes), c_bs)
    rows[:, 1:4] = rows[:, 1:4] @ c_bs  # v_s = C_sb v_b
    rows[:, 4:7] = rows[:, 4:7] @ c_bs
    folder.imu(rows)
    folder.change(('axes = "FRD"', f"axes = {axes!r}"))
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, body.delta_angle, rtol=1e-8, atol=1e-13)
    np.testing.assert_allclose(log.delta_velocity, body.delta_velocity, rtol=1e-8, atol=1e-12)


def test_notes_on_a_sensor_upside_down_and_on_wrong_units(folder):
    folder.change(('axes = "FRD"', 'axes = "FLU"'))
    assert "points down" in folder.load().notes[0]
    folder.change(('axes = "FLU"', 'axes = "FLU"\naccel_axes = "BRD"'), ('accel_unit = "g"', 'accel_unit = "m/s2"'))
    folder.error("imu.accel_unit = 'm/s2': in the median the specific force is 1.0", "fit accel_unit = 'g'")
    folder.change(('accel_unit = "m/s2"', 'accel_unit = "m/s2"\naccel_scale = 5.0'))
    assert "expected about 9.8" in folder.load().notes[0]


@pytest.mark.parametrize("epoch", [0.0, 1.7e9])
def test_start_s_at_the_first_sample_leaves_nothing_out(folder, epoch):
    """Or rounded to behind it: the state in [initial] is then that of the beginning."""
    folder.change(*[(f"[{name}]", f"[{name}]\ntime_offset_s = {epoch}") for name in ("imu", "gnss")])
    described = folder.toml
    for start, count, kept in ((10.02, N, None), (10.025, N - 1, None), (10.05, N - 2, epoch + 10.05)):
        folder.toml = f"start_s = {epoch + start!r}\n{described}"
        log = folder.load()
        assert (len(log.imu_time), log.description.start_s) == (count, kept)


def test_kf_gins_files(folder):
    folder.write("imu.txt", as_text(increments(imu_rows()), sep="  "))
    r = gnss_rows()
    fixes = np.column_stack([r, [[1, 2, 3]] * 3, [[0.1, 0.2, 0.3]] * 3])
    for columns in (7, 13):
        folder.write(f"gnss{columns}.txt", as_text(fixes[:, :columns], sep=" "))
    folder.write("truth.nav", as_text(np.column_stack([[2155] * 3, r[:, :4], [[1, 2, 3]] * 3, [[1, -2, 350]] * 3]), sep=" "))
    folder.toml = (
        'title = "kf"\n[imu]\nfile = "imu.txt"\nformat = "kf-gins"\n'
        '[gnss]\nfile = "gnss7.txt"\nformat = "kf-gins"\nlever_arm_m = [0, 0, 0]\n'
        '[reference]\nfile = "truth.nav"\nformat = "kf-gins"\n'
    )
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, increments(imu_rows())[:, 1:4], rtol=1e-10, atol=1e-14)
    assert log.gnss.velocity_n is None
    np.testing.assert_allclose(log.gnss.latitude, np.radians(r[:, 1]), rtol=1e-10)
    reference = log.reference
    np.testing.assert_allclose(reference.time, r[:, 0])
    np.testing.assert_allclose(reference.velocity_n[0], [1, 2, 3])
    np.testing.assert_allclose(np.degrees([reference.roll[0], reference.pitch[0], reference.heading[0]]), [1, -2, -10])
    folder.change(("gnss7", "gnss13"))
    log = folder.load()
    np.testing.assert_allclose(log.gnss.velocity_n, [[1, 2, 3]] * 3)
    np.testing.assert_allclose(log.gnss.velocity_sigma, [[0.1, 0.2, 0.3]] * 3)


def test_speed_and_course(folder):
    """Knots and degrees; no course at rest, no course under way; the vertical velocity is unknown."""
    lines = as_text(gnss_rows()).splitlines()
    motion = ["10,90", "0.2,", "8,nan"]
    text = "\n".join(["t,lat,lon,h,sn,se,sd,speed,course", *map(",".join, zip(lines, motion, strict=True))]) + "\n"
    folder.write("gnss.csv", text)
    folder.change(("[gnss]", '[gnss]\nspeed = "speed"\nspeed_unit = "kn"\ncourse = "course"\nspeed_sigma_mps = 0.1'))
    gnss = folder.load().gnss
    np.testing.assert_allclose(gnss.velocity_n, [[0.0, 18520 / 3600, 0.0], [0.0] * 3, [0.0] * 3], atol=1e-9)
    np.testing.assert_allclose(gnss.velocity_sigma[:, 0], [0.1, np.hypot(0.1, 0.2 * 1852 / 3600), 100.0])
    np.testing.assert_allclose(gnss.velocity_sigma[:, 2], 100.0)
    folder.write("gnss.csv", text.replace("10,90", "-10,90"))
    folder.error("speed is -10, must be from 0 up")
