"""The files of a log: archives, comments, missing values, and every kind of wrong file and row."""

import gzip
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from text_logs import N, as_text, imu_rows

from insenv.base.errors import InputError
from insenv.logs.formats.csv_table import read_table


@pytest.mark.parametrize(("name", "line", "text", "said"), [
    ("imu.csv", 5, "10.08,0,-1e6,0,0,0,-1", "imu.csv: line 5, column 'gy': gyro is -1e+06 deg/s, allowed -1e+05 to 1e+05"),
    ("imu.csv", 5, "10.08,nan,0,0,0,0,-1", "imu.csv: line 5, column 'gx': value is nan"),
    ("imu.csv", 5, "10.03,0,0,0,0,0,-1", "line 5: time goes backwards from 10.06 s (line 4) to 10.03 s"),
    ("imu.csv", 5, "10.08,0,0,0,0,0", "line 5 has 6 fields, expected 7"),
    ("imu.csv", 5, "10.08,0,abc,0,0,0,-1", "line 5, column 'gy': 'abc' is not a number"),
    ("imu.csv", 1, "t,gx,gy,gz,ax,ay,up", "no column 'az'"),
    ("gnss.csv", 3, "11.5,45,-393,200,1,1,1", "longitude is -393 deg"),
])  # fmt: skip
def test_wrong_rows(folder, name, line, text, said):
    folder.line(name, line, text)
    folder.error(said)


def test_a_wrong_delimiter_is_one_line_that_names_the_right_one():
    with pytest.raises(InputError, match=r"a.csv: the header is one column, 't,gx': allowed is delimiter = ',', or 'auto'$"):
        read_table("a.csv", b"t,gx\n1,2\n", ["t", "gx"], delimiter=";", header_rows=1)


def test_a_file_that_is_cut_off(folder):
    text = (folder.path / "imu.csv").read_text()
    last = text.rstrip("\n").rfind("\n") + 1
    folder.write("imu.csv", text[: last + 20])
    folder.error(f"line {N + 1} has", "cut off in mid-row")
    folder.write("imu.csv", text[:-8])
    assert "is the file cut off?" in folder.load().notes[0]


@pytest.mark.parametrize(("name", "said"), [
    ("x.csv.gz", "cannot be unpacked"),
    ("package:no_such_package/a.csv", "'no_such_package' is not installed"),
    ("package:insenv/a.csv", "holds no such file"),
])  # fmt: skip
def test_files_that_cannot_be_read(folder, name, said):
    folder.write("x.csv.gz", gzip.compress(b"1,2,3\n" * 99)[:-9])
    folder.change(('"gnss.csv"', f'"{name}"'))
    folder.error(said)


def test_archives_comments_blank_lines_and_a_byte_order_mark(folder):
    expected = folder.load().delta_angle
    text = "\ufeff# a remark\n" + (folder.path / "imu.csv").read_text().replace("\n", "\r\n").replace("t,gx", '"t", "gx"')
    lines = text.split("\r\n")
    lines[5:5] = ["", "# another"]
    raw = "\r\n".join(lines).encode()
    folder.write("raw.csv", raw)
    folder.write("raw.csv.gz", gzip.compress(raw))
    with zipfile.ZipFile(folder.path / "raw.zip", "w") as archive:
        archive.writestr("imu.csv", raw)
    good = folder.toml
    for name in ("raw.csv", "raw.csv.gz", "raw.zip"):
        folder.toml = good.replace('"imu.csv"', f'"{name}"')
        np.testing.assert_array_equal(folder.load().delta_angle, expected)


def test_fixes_in_the_rows_of_the_samples_with_text_for_missing_values(folder):
    words = ["nan,nan,nan", ",,", "NaN,-93,200", "null,null,null", "45,-93,n/a"]
    text = ["t,gx,gy,gz,ax,ay,az,lat,lon,h"]
    for k, line in enumerate(as_text(imu_rows()).splitlines()):
        text.append(line + "," + ("45,-93,200" if k % 25 == 0 else words[k % len(words)]))
    folder.write("imu.csv", "\n".join(text) + "\n")
    folder.fixes_in_the_imu_file("\nskip_empty = true")
    log = folder.load()
    assert len(log.gnss.time) == 4 and len(log.imu_time) == N
    np.testing.assert_array_equal(log.gnss.position_sigma[-1], [1, 1, 2])
    folder.change(("skip_empty = true", "skip_empty = false"))
    folder.error("skip_empty = true skips such rows")


PARTS = ["t,a,b\n", "1,2,3\n", "1,2\n", "x", ",", "\n", "#", "nan,1,2\n", "3,,1\n", "4,-,null\n", "\r", '"', ";", "1e400,0,0\n"]


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=200) | st.lists(st.sampled_from(PARTS)).map(lambda parts: "".join(parts).encode()))
def test_whatever_the_bytes_a_table_or_an_input_error(raw):
    for columns in ([0, 1], ["t", "b"]):
        for skip_empty, optional in ((False, []), (True, []), (False, columns[1:]), (True, columns[1:])):
            try:
                table = read_table("f", raw, columns, skip_empty=skip_empty, optional=optional)
            except InputError as error:
                assert str(error).startswith("f:")
            else:
                assert table.values.shape == (table.lines.size, 2)
