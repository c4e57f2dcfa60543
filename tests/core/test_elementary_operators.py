"""The quick operators of a model's equations make the nodes of CasADi's own."""

import operator

import casadi as ca
import numpy as np
import pytest

from insenv.core.elementary import quick_operators, select

X, V, W, M = ca.SX.sym("x"), ca.SX.sym("v", 3), ca.SX.sym("w", 3), ca.SX.sym("m", 3, 3)
OPERATORS = "add", "sub", "mul", "truediv", "lt", "le", "gt", "ge", "eq", "ne"
PAIRS = [
    (X, V[1]), (V, W), (X, V), (ca.SX.eye(3), M), (X, 0.3), (0.3, V), (V, 2), (2, X), (X, 0.0), (1, X),
    (V, ca.DM([1.0, 2.0, 3.0])), (V, np.array([1.0, 2.0, 3.0])), (X, np.float64(0.5)), (np.float64(0.5), X),
]  # fmt: skip


@pytest.mark.parametrize("name", OPERATORS)
def test_the_result_is_that_of_casadi(name):
    apply = getattr(operator, name)
    for pair in PAIRS:
        usual = apply(*pair)
        with quick_operators():
            quick = apply(*pair)
        assert type(quick) is type(usual) and quick.shape == usual.shape, pair
        assert ca.is_equal(quick, usual, 9) and str(quick) == str(usual), pair


def test_afterwards_operators_are_the_usual_ones():
    usual = {name: getattr(ca.SX, f"__{name}__") for name in (*OPERATORS, "radd", "rsub", "rmul", "rtruediv")}
    with pytest.raises(ZeroDivisionError), quick_operators():
        assert all(getattr(ca.SX, f"__{name}__") is not function for name, function in usual.items())
        raise ZeroDivisionError
    assert all(getattr(ca.SX, f"__{name}__") is function for name, function in usual.items())


@pytest.mark.parametrize("values", [(X, V), (V, 0.0), (0.0, X), (1, W), (1.0, 2.0), (0.0, 0.0), (ca.DM([1, 2, 3]), V)], ids=str)
@pytest.mark.parametrize("condition", [ca.SX.sym("c"), X < 1.0, V > W], ids=["symbol", "comparison", "elements"])
def test_select_is_if_else(condition, values):
    usual, found = ca.if_else(condition, *values), select(condition, *values)
    assert found.shape == usual.shape and ca.is_equal(found, usual, 9) and str(found) == str(usual)
