"""Which operations are in single precision by their effect."""

import casadi as ca
import numpy as np
import pytest

from insenv.core.instructions import instructions
from insenv.core.precision import without_effect

SUM = 1


def in_double(result, tolerated, values=(0.01, 20.0, 3.0, 1.0), known=()):
    """The names of the operations of a function of (dt, sum, rate, far) that stay in double precision."""
    x = ca.SX.sym("x", 4)
    steps = instructions(ca.Function("f", [x], [result(*ca.vertsplit(x))]))
    single = [step.name in known or (step.name == "INPUT" and step.place[1] != SUM) for step in steps]
    chosen = without_effect(steps, single, [np.array([values])], [tolerated])
    return [step.name for k, step in enumerate(steps) if not (step.is_leaf or step.name == "OUTPUT" or chosen[k])]


def test_a_sum_is_in_double_precision_and_its_increment_is_not():
    """20 m/s are rounded by 1e-6, an increment of 0.03 m/s by 2e-9."""
    assert in_double(lambda dt, sum, rate, far: sum + rate * dt, 1e-7) == ["ADD"]
    assert in_double(lambda dt, sum, rate, far: sum + rate * dt, 1e-10) == ["MUL", "ADD"]
    assert in_double(lambda dt, sum, rate, far: sum + rate * dt, 1e-5) == []
    assert in_double(lambda dt, sum, rate, far: sum + rate * dt, np.inf) == []


def test_an_operation_rounds_its_two_operands_and_its_result():
    """0.03 to a share of 2^-24 = 6e-8 each."""
    assert in_double(lambda dt, sum, rate, far: rate * dt, 4.5e-9) == ["MUL"]
    assert in_double(lambda dt, sum, rate, far: rate * dt, 6e-9) == []


@pytest.mark.parametrize("far", [0.0, 1.0])
def test_a_branch_that_is_not_taken_counts_as_one_that_is(far):
    here = in_double(lambda dt, sum, rate, far: ca.if_else(far, sum * rate, sum - rate), 1e-7, (0.01, 20.0, 3.0, far))
    assert {"MUL", "SUB"} <= set(here)


def test_differences_of_large_numbers_need_their_digits_and_their_products_do_not():
    assert in_double(lambda dt, sum, rate, far: (sum - 19.999) * rate / dt, 1e-4) == ["SUB"]


def test_what_is_known_to_be_single_ends_the_way_and_what_single_precision_cannot_hold_stays():
    assert in_double(lambda dt, sum, rate, far: (sum + rate) * far, 1e-7, known=("MUL",)) == []
    assert in_double(lambda dt, sum, rate, far: dt / (far * 1e-35), np.inf) == ["MUL", "DIV"]
