"""The quick operators of a model's equations make the nodes of CasADi's own."""

import operator

import casadi as ca
import numpy as np
import pytest

from insenv.core.elementary import select
from insenv.core.operators import quick_operators

X, V, W, M = ca.SX.sym("x"), ca.SX.sym("v", 3), ca.SX.sym("w", 3), ca.SX.sym("m", 3, 3)
OPERATORS = "add", "sub", "mul", "truediv", "lt", "le", "gt", "ge", "eq", "ne"
PAIRS = {
    "elements": (X, V[1]),
    "columns": (V, W),
    "element and column": (X, V),
    "sparse": (ca.SX.eye(3), M),
    "float": (X, 0.3),
    "float on the left": (0.3, V),
    "whole number": (V, 2),
    "whole number on the left": (2, X),
    "zero": (X, 0.0),
    "one": (1, X),
    "number of CasADi": (V, ca.DM([1.0, 2.0, 3.0])),
    "array": (V, np.array([1.0, 2.0, 3.0])),
    "NumPy's number": (X, np.float64(0.5)),
    "NumPy's number on the left": (np.float64(0.5), X),
}


@pytest.mark.parametrize("name", OPERATORS)
def test_the_result_is_that_of_casadi(name):
    apply = getattr(operator, name)
    for kind, pair in PAIRS.items():
        usual = apply(*pair)
        with quick_operators():
            quick = apply(*pair)
        assert type(quick) is type(usual) and quick.shape == usual.shape, kind
        assert ca.is_equal(quick, usual, 9) and str(quick) == str(usual), kind


def test_what_does_not_fit_is_refused_alike():
    with quick_operators():
        with pytest.raises(RuntimeError, match="Dimension mismatch"):
            V + ca.SX.sym("u", 2)
        with pytest.raises((NotImplementedError, TypeError)):
            X + "1"


def test_operators_are_the_usual_ones_afterwards():
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
