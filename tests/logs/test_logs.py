"""Recorded logs: formats, units, axes, bridging, every kind of bad input, and the real car log checked
against physics."""

from __future__ import annotations

import gzip
import importlib.util
import math
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from text_logs import RATE, Folder, G, N, as_text, gnss_rows, imu_rows, increments, si

from insenv.errors import InputError
from insenv.logs import GnssFixes, load
from insenv.logs.inertial import bridge
from insenv.logs.readers import read_table
from insenv.logs.sampling import Sampling, missing_samples
from insenv.logs.units import axes_matrix


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    return Folder(tmp_path)


# --- formats, units, axes --------------------------------------------------------------------------


def test_rates_over_the_interval_before_the_stamp(folder: Folder) -> None:
    log = folder.load()
    rows = imu_rows()
    gyro, accel = si(rows)
    np.testing.assert_allclose(log.imu_time, rows[:, 0], rtol=1e-11)
    np.testing.assert_allclose(log.dt, 1 / RATE, rtol=1e-9)
    np.testing.assert_allclose(log.delta_angle, gyro / RATE, rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(log.delta_velocity, accel / RATE, rtol=1e-8, atol=1e-12)
    assert log.gaps.count == 0 and not log.bridged.any() and log.notes == ()
    assert log.rate_hz == pytest.approx(RATE) and log.duration_s == pytest.approx(N / RATE)
    fixes = gnss_rows()
    np.testing.assert_allclose(log.gnss.latitude, np.radians(fixes[:, 1]), rtol=1e-10)
    np.testing.assert_allclose(log.gnss.longitude, np.radians(fixes[:, 2]), rtol=1e-10)
    np.testing.assert_allclose(log.gnss.position_sigma, fixes[:, 4:7])
    np.testing.assert_array_equal(log.lever_arm_b, [1, 2, -3])
    assert log.gnss.velocity_n is None and log.reference is None
    assert [(s.section, s.rows_used) for s in log.sources] == [("imu", N), ("gnss", 3)]


def test_rates_over_the_interval_after_the_stamp(folder: Folder) -> None:
    folder.change('"interval_end"', '"interval_start"')
    log = folder.load()
    rows = imu_rows()
    np.testing.assert_allclose(log.imu_time, rows[:, 0] + 1 / RATE, rtol=1e-11)
    np.testing.assert_allclose(log.delta_angle, si(rows)[0] / RATE, rtol=1e-8, atol=1e-14)


def test_instantaneous_rates_by_the_trapezoid(folder: Folder) -> None:
    folder.change('"interval_end"', '"instant"')
    log = folder.load()
    gyro, _ = si(imu_rows())
    assert log.imu_time.size == N - 1
    np.testing.assert_allclose(log.imu_time, imu_rows()[1:, 0], rtol=1e-11)
    np.testing.assert_allclose(log.delta_angle, (gyro[1:] + gyro[:-1]) / 2 / RATE, rtol=1e-8, atol=1e-14)


def test_increments_in_degrees_semicolons_and_numbers_for_columns(folder: Folder) -> None:
    rows = increments(imu_rows())
    rows[:, 1:4] = np.degrees(rows[:, 1:4])
    folder.write("imu.csv", as_text(rows, sep=";"))
    for old, new in (
        ('"t"', "0"),
        ('["gx", "gy", "gz"]', "[1, 2, 3]"),
        ('["ax", "ay", "az"]', "[4, 5, 6]"),
        ('"rate"', '"increment"'),
        ('"deg/s"', '"deg"'),
        ('"g"', '"m/s"'),
    ):
        folder.change(old, new)
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, increments(imu_rows())[:, 1:4], rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(log.delta_velocity, increments(imu_rows())[:, 4:7], rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize(("unit", "factor"), [("rad/s", math.pi / 180), ("deg/h", 3600.0), ("rad/h", 3600.0 * math.pi / 180)])
def test_gyro_units_mean_the_same(folder: Folder, unit: str, factor: float) -> None:
    expected = folder.load().delta_angle
    rows = imu_rows()
    rows[:, 1:4] *= factor
    folder.write("imu.csv", as_text(rows, "t,gx,gy,gz,ax,ay,az"))
    folder.change('"deg/s"', f'"{unit}"')
    np.testing.assert_allclose(folder.load().delta_angle, expected, rtol=1e-9, atol=1e-14)


def test_time_in_milliseconds_with_an_offset(folder: Folder) -> None:
    rows = imu_rows()
    rows[:, 0] = 1000 * (rows[:, 0] - 4)
    folder.write("imu.csv", as_text(rows, "t,gx,gy,gz,ax,ay,az"))
    folder.change("[imu]", '[imu]\ntime_unit = "ms"\ntime_offset_s = 4.0\nrate_hz = 50.0')
    np.testing.assert_allclose(folder.load().imu_time, imu_rows()[:, 0], rtol=1e-11)


@pytest.mark.parametrize(
    ("axes", "matrix"),
    [
        ("FRD", np.eye(3)),
        ("FLU", np.diag([1.0, -1.0, -1.0])),
        ("RFU", [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
        ("+x-y-z", np.diag([1.0, -1.0, -1.0])),
        ("-z+y+x", [[0, 0, -1], [0, 1, 0], [1, 0, 0]]),
        ([[0, 1, 0], [1, 0, 0], [0, 0, -1]], [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    ],
)
def test_axes(folder: Folder, axes: object, matrix: object) -> None:
    body = folder.load()
    c_bs = np.array(matrix, dtype=float)
    np.testing.assert_array_equal(axes_matrix(axes), c_bs)  # type: ignore[arg-type]
    rows = imu_rows()
    rows[:, 1:4] = rows[:, 1:4] @ c_bs  # v_s = C_sb v_b
    rows[:, 4:7] = rows[:, 4:7] @ c_bs
    folder.write("imu.csv", as_text(rows, "t,gx,gy,gz,ax,ay,az"))
    folder.change(
        'axes = "FRD"',
        "axes = " + str(axes).replace("'", '"') if not isinstance(axes, str) else f'axes = "{axes}"',
    )
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, body.delta_angle, rtol=1e-8, atol=1e-13)
    np.testing.assert_allclose(log.delta_velocity, body.delta_velocity, rtol=1e-8, atol=1e-12)


def test_notes_on_a_sensor_upside_down_and_on_wrong_units(folder: Folder) -> None:
    folder.change('axes = "FRD"', 'axes = "FLU"')
    assert "points down" in folder.load().notes[0]
    folder.change('axes = "FLU"', 'axes = "FLU"\naccel_axes = "BRD"')
    folder.change('accel_unit = "g"', 'accel_unit = "m/s2"')
    assert "expected about 9.8" in folder.load().notes[0]


def test_kf_gins_files(folder: Folder) -> None:
    folder.write("imu.txt", as_text(increments(imu_rows()), sep="  "))
    fixes = np.column_stack([gnss_rows(), [[1, 2, 3]] * 3, [[0.1, 0.2, 0.3]] * 3])
    folder.write("gnss7.txt", as_text(fixes[:, :7], sep=" "))
    folder.write("gnss13.txt", as_text(fixes, sep=" "))
    r = gnss_rows()
    nav = np.column_stack([[2155] * 3, r[:, :4], [[1, 2, 3]] * 3, [[1, -2, 350]] * 3])
    folder.write("truth.nav", as_text(nav, sep=" "))
    folder.toml = (
        'title = "kf"\n[imu]\nfile = "imu.txt"\nformat = "kf-gins"\n'
        '[gnss]\nfile = "gnss7.txt"\nformat = "kf-gins"\nlever_arm_m = [0, 0, 0]\n'
        '[reference]\nfile = "truth.nav"\nformat = "kf-gins"\n'
    )
    log = folder.load()
    np.testing.assert_allclose(log.delta_angle, increments(imu_rows())[:, 1:4], rtol=1e-10, atol=1e-14)
    assert log.gnss.velocity_n is None
    np.testing.assert_allclose(log.gnss.latitude, np.radians(r[:, 1]), rtol=1e-10)
    np.testing.assert_allclose(log.reference.time, r[:, 0])
    np.testing.assert_allclose(log.reference.velocity_n[0], [1, 2, 3])
    attitude = [log.reference.roll[0], log.reference.pitch[0], log.reference.heading[0]]
    np.testing.assert_allclose(np.degrees(attitude), [1, -2, -10])
    folder.change("gnss7", "gnss13")
    log = folder.load()
    np.testing.assert_allclose(log.gnss.velocity_n, [[1, 2, 3]] * 3)
    np.testing.assert_allclose(log.gnss.velocity_sigma, [[0.1, 0.2, 0.3]] * 3)
    folder.write("gnss13.txt", as_text(fixes[:, :9], sep=" "))
    assert "9 columns, this format has 7 or 13" in folder.error()


def test_archives_comments_blank_lines_and_a_byte_order_mark(folder: Folder) -> None:
    expected = folder.load().delta_angle
    text = "\ufeff# a remark\n" + (folder.path / "imu.csv").read_text().replace("\n", "\r\n").replace("t,gx", '"t", "gx"')
    lines = text.split("\r\n")
    lines[5:5] = ["", "# another"]
    raw = "\r\n".join(lines).encode()
    folder.write("imu.csv", raw)
    np.testing.assert_array_equal(folder.load().delta_angle, expected)
    folder.write("imu.csv.gz", gzip.compress(raw))
    folder.change('"imu.csv"', '"imu.csv.gz"')
    np.testing.assert_array_equal(folder.load().delta_angle, expected)
    with zipfile.ZipFile(folder.path / "imu.zip", "w") as archive:
        archive.writestr("imu.csv", raw)
    folder.change('"imu.csv.gz"', '"imu.zip"')
    np.testing.assert_array_equal(folder.load().delta_angle, expected)


def test_rows_kept_joined_skipped_and_the_window(folder: Folder) -> None:
    rows = gnss_rows()
    folder.write(
        "gnss.csv",
        "t,lat,lon,h,ok\n" + "".join(f"{a[0]},{a[1]},{a[2]},{a[3]},{k}\n" for k, a in enumerate(rows)),
    )
    folder.write("std.csv", "t,sn,se,sd\n" + "".join(f"{a[0]},{k},1,1\n" for k, a in enumerate(rows)))
    folder.change(
        'file = "gnss.csv"',
        'file = ["gnss.csv", "std.csv"]\nkeep_where = { ok = [1, 2] }\nheight_offset_m = -30.0',
    )
    log = folder.load()
    np.testing.assert_array_equal(log.gnss.position_sigma[:, 0], [1, 2])
    np.testing.assert_allclose(log.gnss.height, rows[1:, 3] - 30)
    folder.change('title = "test"', 'title = "test"\nstart_s = 11.0\nstop_s = 11.8')
    log = folder.load()
    assert log.imu_time[0] >= 11.0 and log.imu_time[-1] <= 11.8 and log.gnss.time.size == 1
    folder.change("11.5,", "11.6,", "std.csv")
    folder.change("12.0,", "12.1,", "std.csv")
    assert "only 1 rows have the same time" in folder.error()


def test_gnss_columns_in_the_imu_file_empty_between_fixes(folder: Folder) -> None:
    lines = as_text(imu_rows()).splitlines()
    text = ["t,gx,gy,gz,ax,ay,az,lat,lon,h"] + [s + (",45,-93,200" if k % 25 == 0 else ",,,") for k, s in enumerate(lines)]
    folder.write("imu.csv", "\n".join(text) + "\n")
    folder.change('file = "gnss.csv"', 'file = "imu.csv"\nskip_empty = true')
    folder.change('position_sigma = ["sn", "se", "sd"]', "position_sigma_m = [1.0, 1.0, 2.0]")
    log = folder.load()
    assert log.imu_time.size == N and log.gnss.time.size == 4
    np.testing.assert_array_equal(log.gnss.position_sigma[-1], [1, 1, 2])


# --- bridging --------------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(
    drop=st.sets(st.integers(3, 396), min_size=1, max_size=25),
    jitter=st.floats(0, 0.1),
    frequency=st.floats(0.1, 1.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_bridging_brings_back_smooth_signals(drop: set[int], jitter: float, frequency: float, seed: int) -> None:
    n, rate = 400, 100.0
    rng = np.random.default_rng(seed)
    time = (np.arange(n) + jitter * rng.uniform(-1, 1, n)) / rate
    omega = 2 * math.pi * frequency
    keep = np.setdiff1d(np.arange(n), list(drop))
    signal = np.column_stack([np.sin(omega * time), np.cos(omega * time), time])
    result = bridge(time[keep], signal[keep], Sampling(1 / rate), 1.0)
    assert result.time.size == n
    assert result.gaps.samples == len(drop)
    np.testing.assert_array_equal(np.flatnonzero(result.original), keep)
    np.testing.assert_array_equal(result.rates[result.original], signal[keep])
    assert np.all(np.diff(result.time) > 0)
    longest = (result.gaps.longest_s + 2 / rate) * 1.2
    bound = (omega * longest) ** 2 / 8 + 1e-12  # linear interpolation: h^2/8 max|f''|
    truth = np.column_stack([np.sin(omega * result.time), np.cos(omega * result.time), result.time])
    assert np.abs(result.rates - truth).max() <= bound


def test_a_late_stamp_is_jitter_not_a_gap() -> None:
    steps = np.array([1, 1, 1.9, 0.1, 1, 1, 3.0, 1, 1, 1.7, 0.8, 0.8, 1, 2.0, 1.0]) * 0.01
    missing = missing_samples(np.concatenate(([0.0], np.cumsum(steps))), 0.01)
    assert missing.tolist() == [0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 1, 0]


@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_gaps_in_a_file_are_bridged_and_counted(folder: Folder, kind: str) -> None:
    whole = folder.load()
    rows = imu_rows()
    if kind == "increment":
        rows = increments(rows)
        for old, new in (('"rate"', '"increment"'), ('"deg/s"', '"rad"'), ('"g"', '"m/s"')):
            folder.change(old, new)
    kept = np.delete(rows, [20, 21, 22, 60], axis=0)
    folder.write("imu.csv", as_text(kept, "t,gx,gy,gz,ax,ay,az"))
    log = folder.load()
    assert (log.gaps.count, log.gaps.samples) == (2, 4)
    assert log.gaps.longest_s == pytest.approx(0.06)
    assert np.flatnonzero(log.bridged).tolist() == [20, 21, 22, 60]
    np.testing.assert_allclose(log.imu_time, whole.imu_time, rtol=1e-9)
    np.testing.assert_allclose(log.delta_angle, whole.delta_angle, atol=2e-6)
    np.testing.assert_allclose(log.delta_velocity, whole.delta_velocity, atol=5e-5)
    folder.change("[imu]", "[imu]\nmax_gap_s = 0.05")
    message = folder.error()
    assert "between 10.400000 s and 10.480000 s" in message and "imu.max_gap_s = 0.05 s" in message


# --- bad input: the files --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "line", "text", "expected"),
    [
        (
            "imu.csv",
            5,
            "10.08,0,-1e6,0,0,0,-1",
            "imu.csv: line 5, column 'gy': gyro is -1e+06 deg/s, allowed -1e+05 to 1e+05 deg/s",
        ),
        ("imu.csv", 5, "10.08,0,0,0,0,0,1e300", "line 5, column 'az': accel is 1e+300 g, allowed -2e+05 to 2e+05 g"),
        ("imu.csv", 5, "10.08,nan,0,0,0,0,-1", "imu.csv: line 5, column 'gx': value is nan"),
        ("imu.csv", 5, "10.08,0,0,inf,0,0,-1", "line 5, column 'gz': value is inf"),
        ("imu.csv", 5, "10.03,0,0,0,0,0,-1", "line 5: time goes backwards from 10.06 s (line 4) to 10.03 s"),
        ("imu.csv", 5, "10.06,0,0,0,0,0,-1", "line 5: time 10.06 s twice (also line 4)"),
        ("imu.csv", 5, "10.08,0,0,0,0,0", "line 5 has 6 fields, expected 7 as in the header"),
        ("imu.csv", 5, "10.08,0,0,0,0,0,-1,5", "line 5 has 8 fields, expected 7"),
        ("imu.csv", 5, "10.08,0,abc,0,0,0,-1", "line 5, column 'gy': 'abc' is not a number"),
        ("imu.csv", 5, "10.08,0,,0,0,0,-1", "line 5, column 'gy': the value is missing"),
        ("imu.csv", 1, "t,gx,gy,gz,ax,ay,up", "no column 'az'; did you mean 'gz'? (allowed: t, gx, gy"),
        (
            "gnss.csv",
            3,
            "11.5,45,-93,200,1,0,1",
            "line 3, column 'se': standard deviation is 0 m, must be above 0",
        ),
        ("gnss.csv", 3, "11.5,45,-93,200,1,1,-2", "line 3, column 'sd': standard deviation is -2 m"),
        (
            "gnss.csv",
            3,
            "11.5,95,-93,200,1,1,1",
            "line 3, column 'lat': latitude is 95 deg, allowed -90 to 90 deg",
        ),
        ("gnss.csv", 3, "11.5,45,-393,200,1,1,1", "longitude is -393 deg"),
        ("gnss.csv", 3, "9.5,45,-93,200,1,1,1", "gnss.csv: line 3: time goes backwards from 10.5 s"),
        ("gnss.csv", 3, "11.5,45,nan,200,1,1,1", "gnss.csv: line 3, column 'lon': value is nan"),
    ],
)
def test_bad_rows(folder: Folder, name: str, line: int, text: str, expected: str) -> None:
    folder.line(name, line, text)
    assert expected in folder.error()


def test_an_increment_that_no_gyro_measures(folder: Folder) -> None:
    folder.change('"rate"', '"increment"')
    folder.change('"deg/s"', '"deg"')
    folder.change('accel_unit = "g"', 'accel_unit = "m/s"')
    folder.line("imu.csv", 5, "10.08,0,0,2001,0,0,-1")
    assert "line 5, column 'gz': gyro is 2001 deg, allowed -2000 to 2000 deg" in folder.error()  # in 20 ms


@pytest.mark.parametrize("cut", [3, 20, 31])
def test_a_file_cut_off_in_mid_row(folder: Folder, cut: int) -> None:
    text = (folder.path / "imu.csv").read_text()
    last = text.rstrip("\n").rfind("\n") + 1
    folder.write("imu.csv", text[: last + cut])
    message = folder.error()
    assert f"line {N + 1} has" in message and "expected 7" in message and "cut off in mid-row" in message


def test_a_file_cut_off_in_its_last_number_is_noted(folder: Folder) -> None:
    text = (folder.path / "imu.csv").read_text()
    folder.write("imu.csv", text[:-8])
    assert "is the file cut off?" in folder.load().notes[0]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "the file is empty"),
        (b"\n \n", "the file is empty"),
        (b"t,gx,gy,gz,ax,ay,az\n", "no data rows"),
        (b"t,gx\0\0\1", "not a text file"),
        (b"t,gx,gy,gz,ax,ay,az\n1,0,0,0,0,0,-1\n2,0,0,0,0,0,-1\n", "at least 3"),
    ],
)
def test_empty_and_binary_files(folder: Folder, content: bytes, expected: str) -> None:
    folder.write("imu.csv", content)
    assert expected in folder.error()


def test_files_that_cannot_be_read(folder: Folder) -> None:
    (folder.path / "gnss.csv").unlink()
    assert "gnss.csv: file not found" in folder.error()
    (folder.path / "gnss.csv").mkdir()
    assert "gnss.csv: cannot be read" in folder.error()
    folder.change('"gnss.csv"', '"x.zip"')
    folder.write("x.zip", "no zip")
    assert "cannot be unpacked" in folder.error()
    folder.change('"x.zip"', '"x.csv.gz"')
    folder.write("x.csv.gz", gzip.compress(b"1,2,3\n" * 99)[:-9])
    assert "cannot be unpacked" in folder.error()
    folder.change('"x.csv.gz"', '"package:no_such_package/a.csv"')
    assert "'no_such_package' is not installed: pip install no_such_package" in folder.error()
    folder.change("no_such_package/a.csv", "insenv/../a.csv")
    assert "must be package:NAME/path" in folder.error()
    folder.change("insenv/../a.csv", "insenv/a.csv")
    assert "holds no such file" in folder.error()


def test_spans_rates_and_windows_that_do_not_fit(folder: Folder) -> None:
    good = folder.toml
    folder.change("[gnss]", "[gnss]\ntime_offset_s = 100.0")
    assert "do not overlap" in folder.error()
    folder.toml = good.replace("[imu]", "[imu]\nrate_hz = 100.0")
    assert "imu.rate_hz = 100 Hz, but the median step" in folder.error()
    folder.toml = good.replace("[imu]", '[imu]\ntime_unit = "ms"')
    assert "imu: 100 samples in 0.00198 s are 50000 Hz: allowed is up to 10000 Hz" in folder.error()
    folder.toml = good.replace('title = "test"', 'title = "test"\nstart_s = 99.0')
    assert "no imu rows between start_s = 99.0 s" in folder.error()
    folder.toml = good.replace("[gnss]", "[gnss]\nkeep_where = { h = 7 }")
    assert "no row is left by gnss.keep_where" in folder.error()
    folder.toml = good.replace('position_unit = "deg"', 'position_unit = "rad"')
    assert "rad, allowed -1.5708 to 1.5708 rad; is position_unit = 'rad' right?" in folder.error()


# --- bad input: the description --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('kind = "rate"', 'kind = "rates"', "imu.kind = 'rates': must be 'rate' or 'increment'"),
        ('kind = "rate"\n', "", "imu.kind is missing: rate: angular rate"),
        ("[imu]", "[imu]\nrate = 3", "imu.rate: unknown key; did you mean"),
        ("[imu]", "[imu]\nrate_hz = -3.0", "imu.rate_hz = -3.0 [Hz]: must be greater than 0"),
        ("[imu]", "[imu]\nmax_gap_s = nan", "imu.max_gap_s = nan [s]"),
        ("[imu]", '[imu]\nmax_gap_s = "1"', "imu.max_gap_s = '1' [s]: must be a number"),
        ("[imu]", "[imu]\nmax_gap_s = 1e9", "must be less than or equal to 60"),
        ('axes = "FRD"', 'axes = "FLD"', "imu.axes = 'FLD': the axes are left-handed"),
        ('axes = "FRD"', 'axes = "XYZ"', "imu.axes = 'XYZ': must be three letters"),
        ('axes = "FRD"', "axes = [[1, 0], [0, 1]]", "a mounting matrix must have three rows of three"),
        ('axes = "FRD"', "axes = [[2, 0, 0], [0, 1, 0], [0, 0, 1]]", "orthonormal"),
        ('gyro_unit = "deg/s"', 'gyro_unit = "deg"', "imu.gyro_unit = 'deg': does not go with kind = 'rate'"),
        ('["gx", "gy", "gz"]', '["gx", "gy"]', "imu.gyro = ['gx', 'gy']: must be a list of three"),
        ('["gx", "gy", "gz"]', '["gx", "gy", -1]', "imu.gyro[2] = -1: must be a column name"),
        ("[1.0, 2.0, -3.0]", "[1.0, 2.0]", "gnss.lever_arm_m = [1.0, 2.0] [m]: must be a list of three"),
        ("lever_arm_m = [1.0, 2.0, -3.0]", "", "gnss.lever_arm_m is missing"),
        ('position_sigma = ["sn", "se", "sd"]', "", "position_sigma"),
        (
            'position_sigma = ["sn", "se", "sd"]',
            "position_sigma_m = [0, 1, 1]",
            "gnss.position_sigma_m[0] = 0 [m]: must be greater",
        ),
        ('title = "test"', "", "title is missing"),
        ('title = "test"', 'title = "test"\nwidth = 3', "width: unknown key"),
        (
            'title = "test"',
            'title = "test"\nstart_s = 5\nstop_s = 4',
            "stop_s = 4 [s]: must be after start_s = 5 s",
        ),
        ('title = "test"', "title = test", "not valid TOML"),
        (
            "[gnss]",
            "[initial]\nlatitude_deg = 95.0\n[gnss]",
            "initial.latitude_deg = 95.0 [deg]: must be less than or equal to 90",
        ),
    ],
)
def test_bad_descriptions(folder: Folder, old: str, new: str, expected: str) -> None:
    folder.change(old, new)
    message = folder.error()
    assert expected in message
    assert message.startswith(str(folder.path / "log.toml"))


def test_a_description_that_is_not_there_or_not_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="file not found"):
        load(tmp_path / "none.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path)
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        load(tmp_path / "x.toml")


@settings(max_examples=150, deadline=None)
@given(
    st.binary(max_size=200)
    | st.lists(
        st.sampled_from(
            [
                "t,a,b\n",
                "1,2,3\n",
                "1,2\n",
                "x",
                ",",
                "\n",
                "#",
                "nan,1,2\n",
                "3,,1\n",
                "4,-,null\n",
                " ",
                "\r",
                '"',
                ";",
                "1e400,0,0\n",
            ]
        )
    ).map(lambda parts: "".join(parts).encode())
)
def test_whatever_the_bytes_a_table_or_an_input_error(raw: bytes) -> None:
    for columns in ([0, 1], ["t", "b"]):
        for skip_empty, optional in ((False, []), (True, []), (False, columns[1:]), (True, columns[1:])):
            try:
                table = read_table("f", raw, columns, skip_empty=skip_empty, optional=optional)
            except InputError as error:
                assert str(error).startswith("f:")
            else:
                assert table.values.shape == (table.lines.size, 2)


# --- the examples and the page ---------------------------------------------------------------------


def example_files() -> dict[str, str]:
    """A car that turns: a right turn at 6 deg/s and 10 m/s (Earth rate and curvature left out; it shows the
    format)."""
    w, v, lat0, lon0 = math.radians(6.0), 10.0, 45.0, 9.0
    imu = ["time_s,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z"]
    for k in range(1, 501):
        imu.append(f"{k * 0.02:.2f},0,0,{-math.degrees(w):.4f},{v * w / G:.6f},0,1.000000")
    gnss = ["time_s,lat_deg,lon_deg,height_m,std_n,std_e,std_d"]
    for t in range(11):
        north, east = v / w * math.sin(w * t), v / w * (1 - math.cos(w * t))
        lat, lon = (
            lat0 + math.degrees(north / 6.3675e6),
            lon0 + math.degrees(east / (6.3888e6 * math.cos(math.radians(lat0)))),
        )
        gnss.append(f"{t},{lat:.9f},{lon:.9f},100.000,0.5,0.5,1.0")
    return {"plain-imu.csv": "\n".join(imu) + "\n", "plain-gnss.csv": "\n".join(gnss) + "\n"}


def test_the_log_of_a_turning_car() -> None:
    for name, text in example_files().items():
        assert (ROOT / "tests/logs/data" / name).read_text() == text
    log = load(ROOT / "tests/logs/data/plain.toml")
    assert np.degrees(log.delta_angle[:, 2].sum()) == pytest.approx(60.0)
    assert log.delta_velocity[:, 2].mean() * 50 == pytest.approx(-G)
    assert log.delta_velocity[:, 1].mean() * 50 == pytest.approx(10 * math.radians(6), rel=1e-5)
    assert log.notes == ()


# --- the real car log ------------------------------------------------------------------------------

needs_onavdata = pytest.mark.skipif(
    importlib.util.find_spec("onavdata") is None,
    reason="onavdata is not installed (pip install onavdata==0.2.5)",
)


@pytest.fixture(scope="module")
def car():
    return load(ROOT / "examples/n380-car.toml")


@needs_onavdata
def test_car_log_shape(car) -> None:
    assert car.imu_time.shape == (69144,) and car.gnss.time.shape == (673,) and car.reference.time.shape == (66946,)
    assert car.rate_hz == pytest.approx(100.0, abs=0.01) and car.duration_s == pytest.approx(691.4, abs=0.1)
    assert (car.gaps.count, car.gaps.samples) == (1, 1)
    assert car.gaps.intervals[0][0] == pytest.approx(38.188, abs=1e-3)
    np.testing.assert_allclose(np.median(car.gnss.position_sigma, axis=0), [0.51, 0.47, 1.04], atol=0.01)
    assert car.notes == ()
    assert car.description.estimator["loosely-coupled"]["arw_deg_sqrt_h"] == 0.3


def _gravity(latitude: float, height: float) -> float:
    """WGS-84 normal gravity [m/s2] with the free-air gradient."""
    s2 = math.sin(latitude) ** 2
    return 9.7803253359 * (1 + 0.00193185265241 * s2) / math.sqrt(1 - 0.00669437999013 * s2) - 3.086e-6 * height


@needs_onavdata
def test_car_log_gravity_at_rest(car) -> None:
    """A car at rest: specific force -g on the down axis (bias 2 mg found), pitch and roll from it as the unit
    says."""
    rest = (car.imu_time > 60) & (car.imu_time < 150)
    force = car.delta_velocity[rest].sum(axis=0) / car.dt[rest].sum()
    g = _gravity(car.reference.latitude[0], car.reference.height[0])
    assert g == pytest.approx(9.8057, abs=1e-4)
    assert np.linalg.norm(force) == pytest.approx(g, abs=0.025)
    assert force[2] < -9.8
    at = np.searchsorted(car.reference.time, 100.0)
    assert math.degrees(math.asin(force[0] / g)) == pytest.approx(math.degrees(car.reference.pitch[at]), abs=0.1)
    assert math.degrees(math.asin(-force[1] / g)) == pytest.approx(math.degrees(car.reference.roll[at]), abs=0.1)


@needs_onavdata
def test_car_log_turns_and_moves_as_its_reference(car) -> None:
    """Down-gyro increments sum to the heading change; positions change by the velocity; the stamp ends the
    interval."""
    ref, psi = car.reference, np.unwrap(car.reference.heading)
    rest = (car.imu_time > 60) & (car.imu_time < 150)
    bias = car.delta_angle[rest, 2].sum() / car.dt[rest].sum()
    angle = np.cumsum(car.delta_angle[:, 2] - bias * car.dt)
    for start, stop in ((165, 200), (300, 400), (500, 600)):
        turned = np.interp(stop, car.imu_time, angle) - np.interp(start, car.imu_time, angle)
        assert math.degrees(turned) == pytest.approx(
            math.degrees(np.interp(stop, ref.time, psi) - np.interp(start, ref.time, psi)), abs=0.6
        )
    # heading rate is the down-gyro rate of the same interval, not of the one before or after
    k = np.searchsorted(car.imu_time, ref.time)
    turn = np.diff(psi)
    moving = np.flatnonzero((ref.time[1:] > 165) & (ref.time[1:] < 700))
    rms = {lag: np.std(turn[moving] - car.delta_angle[k[1:][moving] + lag, 2]) for lag in (-1, 0, 1)}
    assert rms[0] < 0.7 * min(rms[-1], rms[1])
    for fix in (ref, car.gnss):
        north = (fix.latitude - fix.latitude[0]) * 6.3678e6
        east = (fix.longitude - fix.longitude[0]) * 6.3889e6 * math.cos(fix.latitude[0])
        mean = 0.5 * (fix.velocity_n[1:] + fix.velocity_n[:-1]) * np.diff(fix.time)[:, None]
        for axis, position in enumerate((north, east)):
            assert np.polyfit(mean[:, axis], np.diff(position), 1)[0] == pytest.approx(1.0, abs=0.01)
    down = -(ref.height - ref.height[0])
    assert np.corrcoef(np.diff(down), 0.5 * (ref.velocity_n[1:, 2] + ref.velocity_n[:-1, 2]))[0, 1] > 0.7


@needs_onavdata
def test_car_log_lever_arm(car) -> None:
    """Antenna minus IMU position in body axes, averaged over the drive, is the lever arm of the
    description."""
    ref, fix = car.reference, car.gnss
    use = (fix.time > 165) & (fix.time < 700)
    t = fix.time[use]
    lat, lon, h, psi = (np.interp(t, ref.time, x) for x in (ref.latitude, ref.longitude, ref.height, np.unwrap(ref.heading)))
    north, east = (fix.latitude[use] - lat) * 6.3678e6, (fix.longitude[use] - lon) * 6.3889e6 * np.cos(lat)
    forward = np.mean(north * np.cos(psi) + east * np.sin(psi))
    right = np.mean(-north * np.sin(psi) + east * np.cos(psi))
    np.testing.assert_allclose([forward, right, -np.mean(fix.height[use] - h)], car.lever_arm_b, atol=0.05)


@pytest.mark.parametrize("name, unit", [("position_sigma", "m"), ("velocity_sigma", "m/s")])
@pytest.mark.parametrize("value", [0.0, -1.0, 1e-9])
def test_a_fix_with_a_sigma_of_zero_is_refused(name, unit, value):
    """Also one that is made in Python: an estimator would take such a fix as exact."""
    three, sigmas = np.ones(3), {"position_sigma": np.ones((3, 3)), "velocity_sigma": np.ones((3, 3))}
    sigmas[name][1, 2] = value
    with pytest.raises(InputError) as error:
        GnssFixes(np.arange(3.0), three, three, three, velocity_n=np.zeros((3, 3)), **sigmas)
    assert f"{name} of the fix at 1 s, D: {value:g} {unit}: allowed is from 1e-06 to 1e+09 {unit}" in str(error.value)
