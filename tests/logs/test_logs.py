"""Recorded logs: formats, units, axes, bridging."""

from __future__ import annotations

import gzip
import math
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT
from text_logs import RATE, Folder, G, N, as_text, gnss_rows, imu_rows, increments, si

from insenv.errors import InputError
from insenv.logs import GnssFixes, load
from insenv.logs.inertial import bridge
from insenv.logs.sampling import Sampling, missing_samples
from insenv.logs.units import axes_matrix


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
    for old, new in (('"t"', "0"), ('["gx", "gy", "gz"]', "[1, 2, 3]"), ('["ax", "ay", "az"]', "[4, 5, 6]")):
        folder.change(old, new)
    folder.hold_increments("deg")
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
        folder.hold_increments("rad")
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


@pytest.mark.parametrize("name, unit", [("position_sigma", "m"), ("velocity_sigma", "m/s")])
@pytest.mark.parametrize("value", [0.0, -1.0, 1e-9])
def test_a_fix_with_a_sigma_of_zero_is_refused(name, unit, value):
    """Also one that is made in Python: an estimator would take such a fix as exact."""
    three, sigmas = np.ones(3), {"position_sigma": np.ones((3, 3)), "velocity_sigma": np.ones((3, 3))}
    sigmas[name][1, 2] = value
    with pytest.raises(InputError) as error:
        GnssFixes(np.arange(3.0), three, three, three, velocity_n=np.zeros((3, 3)), **sigmas)
    assert f"{name} of the fix at 1 s, D: {value:g} {unit}: allowed is from 1e-06 to 1e+09 {unit}" in str(error.value)
