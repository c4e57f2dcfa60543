"""Columns of several files side by side, by their times."""

import numpy as np
import pytest
from text_logs import N, as_text, gnss_rows, imu_rows


def split_files(folder, accel_rows):
    folder.write("gyro.csv", as_text(imu_rows()[:, :4], "t,gx,gy,gz"))
    folder.write("accel.csv", as_text(accel_rows, "t,ax,ay,az"))
    folder.change(('file = "imu.csv"', 'file = ["gyro.csv", "accel.csv"]'))


def test_files_with_other_rows_are_joined_by_time(folder):
    whole = folder.load()
    split_files(folder, imu_rows()[[*range(0, 40), *range(41, N)]][:, [0, 4, 5, 6]])
    log = folder.load()
    assert len(log.imu_time) == N and log.gaps.samples == 1  # the row that one of them lacks
    np.testing.assert_allclose(np.delete(log.delta_velocity, 40, axis=0), np.delete(whole.delta_velocity, 40, axis=0))
    assert any(f"imu: joined by time: {N - 1} rows have the same time" in note for note in log.notes)


def test_columns_of_the_same_name_are_named_with_their_file(folder):
    whole, rows = folder.load(), imu_rows()
    for name, columns in (("gyro", [0, 1, 2, 3]), ("accel", [0, 4, 5, 6])):
        (folder.path / name).mkdir()
        folder.write(f"{name}/1.csv", as_text(rows[:, columns], "t,x,y,z"))
    folder.change(('"imu.csv"', '["gyro/1.csv", "accel/1.csv"]'), ('"gx", "gy", "gz"', '"x", "y", "z"'))
    folder.error("imu: several files have the column 'x': allowed is a name with its file, 'gyro/1.csv:x' or 'accel/1.csv:x'")
    for name, old in (("gyro", '"x", "y", "z"'), ("accel", '"ax", "ay", "az"')):
        folder.change((old, ", ".join(f'"{name}/1.csv:{axis}"' for axis in "xyz")))
    np.testing.assert_array_equal(folder.load().delta_velocity, whole.delta_velocity)
    np.testing.assert_array_equal(folder.load().delta_angle, whole.delta_angle)


def test_rates_at_other_times_are_interpolated(folder):
    """An accelerometer of 200 Hz beside a gyro of 50 Hz; over its gap nothing is interpolated."""
    t = 10.0013 + np.arange(0, 8 * N) / 400
    accel = np.column_stack([t, 0.1 * np.cos(t), 0.2 * np.sin(t), -1.0 + 0.01 * np.cos(2 * t)])
    whole = folder.load()
    split_files(folder, accel)
    log = folder.load()
    same = np.isin(np.round(whole.imu_time, 6), np.round(log.imu_time, 6))
    np.testing.assert_allclose(log.delta_velocity, whole.delta_velocity[same], atol=2e-6)
    assert same.sum() > N - 3 and any("interpolated at the" in note for note in log.notes)
    folder.write("accel.csv", as_text(accel[(t < 10.5) | (t > 10.7)], "t,ax,ay,az"))
    assert folder.load().gaps.samples == pytest.approx(10, abs=1)
    folder.hold_increments("deg")
    folder.error("joined files must have the same clock and the same times")


def test_rows_kept_and_joined_and_the_window(folder):
    rows = gnss_rows()
    folder.write("gnss.csv", "t,lat,lon,h,ok\n" + "".join(f"{a[0]},{a[1]},{a[2]},{a[3]},{k}\n" for k, a in enumerate(rows)))
    folder.write("std.csv", "t,sn,se,sd\n" + "".join(f"{a[0]},{k},1,1\n" for k, a in enumerate(rows)))
    more = 'file = ["gnss.csv", "std.csv"]\nkeep_where = { ok = [1, 2] }\nheight_offset_m = -30.0'
    folder.change(('file = "gnss.csv"', more))
    log = folder.load()
    np.testing.assert_array_equal(log.gnss.position_sigma[:, 0], [1, 2])
    np.testing.assert_allclose(log.gnss.height, rows[1:, 3] - 30)
    folder.change(('title = "test"', 'title = "test"\nstart_s = 11.0\nstop_s = 11.8'))
    log = folder.load()
    assert log.imu_time[0] >= 11.0 and log.imu_time[-1] <= 11.8 and log.gnss.time.size == 1
    folder.write("std.csv", "t,sn,se,sd,ok\n-1,9,9,9,0\n11.5,2,1,1,2\n-1,9,9,9,0\n12.0,3,1,1,1\n")  # -1: no fix
    np.testing.assert_array_equal(folder.load().gnss.position_sigma[:, 0], [2])
    folder.write("std.csv", "t,sn,se,sd\n10.5,1,1,1\n11.6,1,1,1\n12.1,1,1,1\n")
    folder.error("only 0 rows have the same time")
