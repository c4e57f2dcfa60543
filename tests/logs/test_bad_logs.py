"""Every kind of bad input of a recorded log: its files and its description."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from text_logs import Folder, N, as_text, imu_rows

from insenv.errors import InputError
from insenv.logs import load
from insenv.logs.readers import read_table


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
    folder.hold_increments("deg")
    folder.line("imu.csv", 5, "10.08,0,0,2001,0,0,-1")
    assert "line 5, column 'gz': gyro is 2001 deg, allowed -2000 to 2000 deg" in folder.error()  # in 20 ms


def test_increments_whose_stamps_come_in_bursts_are_measurable(folder: Folder) -> None:
    folder.hold_increments("deg")
    rows = imu_rows()
    rows[:, 0] = 10.0 + np.repeat(np.arange(N // 5), 5) / 10.0 + np.tile(np.arange(5) * 5e-6, N // 5)
    rows[:, 1:4] = 2.0  # 100 deg/s; within the 5 us between two stamps it would be 4e5 deg/s
    folder.write("imu.csv", as_text(rows, "t,gx,gy,gz,ax,ay,az"))
    np.testing.assert_allclose(folder.load().delta_angle, np.radians(2.0))


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
    assert "no imu rows from start_s = 99 s: its times are" in folder.error()
    folder.toml = good.replace('title = "test"', 'title = "test"\nstop_s = -99.0')
    assert "no imu rows to stop_s = -99 s: its times are" in folder.error()
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
        ('title = "test"', 'title = "test"\nvehicle_kind = "boat"', "vehicle_kind = 'boat': unknown"),
        ('title = "test"', 'title = "test"\nvehicle_kind = "shop"', "did you mean 'ship'?"),
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
