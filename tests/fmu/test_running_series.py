"""CSV of sampled inputs and outputs: read back to the bit, FMPy's arrays, wrong files."""

import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.fmu.running import Series, flattened, read_csv, write_csv


def test_csv_reads_back_bit_identical(tmp_path):
    columns = {"a": np.array([0.1, 1e-300, -1 / 3]), "m": np.arange(12.0).reshape(3, 2, 2) / 7}
    flat = flattened(columns)
    write_csv(tmp_path / "x.csv", Series(0.005 * np.arange(3), tuple(flat), np.array(list(flat.values())).T))
    back = read_csv(tmp_path / "x.csv")
    assert back.names == ("a", "m[1,1]", "m[1,2]", "m[2,1]", "m[2,2]")
    np.testing.assert_array_equal(back.time, 0.005 * np.arange(3))
    for name, value in back.named().items():
        np.testing.assert_array_equal(value, columns[name])


def test_csv_of_fmpy_with_blanks_inside_arrays(tmp_path):
    (tmp_path / "x.csv").write_text('"time","a","b"\n0.0,1 2 3,4\n0.005,5 6 7,8\n')
    back = read_csv(tmp_path / "x.csv")
    assert back.names == ("a[1]", "a[2]", "a[3]", "b")
    np.testing.assert_array_equal(back.values, [[1, 2, 3, 4], [5, 6, 7, 8]])


def test_a_csv_without_times_is_named(tmp_path):
    """Wrong rows: tests/logs/formats/test_csv_table.py."""
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="no column 'time'"):
        read_csv(tmp_path / "bad.csv")
