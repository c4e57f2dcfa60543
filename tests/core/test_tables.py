"""Tables: layout, checks, symbols."""

import casadi as ca
import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.core.tables import Row, Table

TABLE = Table((
    Row("speed", "Speed", "m/s", start=1.0, lower=0.0, upper=10.0),
    Row("q", "Attitude", shape=(4,), start=(1, 0, 0, 0)),
    Row("M", "Matrix", shape=(2, 3), start=((1, 2, 3), (4, 5, 6))),
))  # fmt: skip


def test_layout_is_row_after_row_and_matrices_row_major():
    assert TABLE.start_vector().tolist() == [1, 1, 0, 0, 0, 1, 2, 3, 4, 5, 6]
    assert TABLE.unpack(TABLE.start_vector())["M"].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert TABLE.unpack(np.zeros((5, 7, 11)))["M"].shape == (5, 7, 2, 3)
    flat = ca.SX.sym("x", TABLE.size)
    values = TABLE.symbols(flat)
    matrix, again = ca.Function("f", [flat], [values.M, TABLE.assemble(vars(values))])(np.arange(11.0))
    assert np.array_equal(matrix.full(), TABLE.unpack(np.arange(11.0))["M"])
    assert again.full().ravel().tolist() == list(range(11))


@pytest.mark.parametrize(("values", "said"), [
    ({"speed": 11}, "speed = 11 m/s"), ({"speed": float("nan")}, "speed = nan m/s"),
    ({"q": (1, 0, float("inf"), 0)}, r"q\[2\] = inf"), ({"q": (1, 0, 0)}, "shape"), ({"sped": 1}, "did you mean 'speed'"),
])  # fmt: skip
def test_a_wrong_value_is_named_with_what_is_allowed(values, said):
    with pytest.raises(InputError, match=said):
        TABLE.pack(values)


@pytest.mark.parametrize(("fields", "said"), [
    ({"shape": (4,), "start": (1, 0)}, r"row 'a': start = \(1, 0\): .* of shape \(4,\)"),
    ({"start": float("inf")}, "row 'a': start = inf"),
    ({"lower": 2, "upper": 1}, "row 'a': lower = 2 exceeds upper = 1"),
    ({"name": "a b"}, "row 'a b'"), ({"start": 3, "upper": 2}, "row 'a': start = 3: allowed is -inf to 2"),
])  # fmt: skip
def test_a_fault_of_a_row_is_named(fields, said):
    with pytest.raises(InputError, match=said):
        Row(**{"name": "a", "meaning": "m", **fields})


def test_faults_of_tables_and_of_what_they_assemble_are_named():
    with pytest.raises(ValueError, match="two rows"):
        Table((Row("a", ""), Row("a", "")))
    with pytest.raises(ValueError, match="missing"):
        TABLE.assemble({"speed": 1})
    with pytest.raises(ValueError, match="shape"):
        TABLE.assemble({"speed": 1, "q": ca.SX.zeros(3), "M": ca.SX.zeros(2, 3)})
