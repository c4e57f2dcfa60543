"""Long functions in loops: the same bits as in one, natively and in a batch."""

import re
from functools import partial

import casadi as ca
import numpy as np
import pytest

from insenv.core import codegen
from insenv.core import compile as compiling
from insenv.core.batch import make_batch
from insenv.core.loops import plan
from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table


def _long(p, x, u):
    """Sums and products that use values from far before, and forty of the same form."""
    values = [x.a[0], x.a[1], x.a[2]]
    for k in range(200):
        values.append(0.5 * values[-1] - values[k // 2] * 0.7 + values[k // 3] * values[-3] * 0.01)
    alike = [ca.sqrt(1.0 + x.b[k] * values[2]) - x.b[39 - k] / 3.0 for k in range(40)]
    turned = [alike[k] * values[-1] + alike[(k * 7) % 40] for k in range(40)]
    return {"a": ca.vertcat(*values[-3:]), "b": ca.vertcat(*turned)}


@pytest.mark.parametrize(("least", "longest"), [(6, 40), pytest.param(2, 1, marks=pytest.mark.slow), (10**6, 100)])
def test_loops_and_pieces_give_the_same_bits(monkeypatch, least, longest):
    b = tuple(0.01 * k for k in range(40))
    rows = Table((Row("a", "Numbers", shape=(3,), start=(0.3, -0.2, 0.9)), Row("b", "Numbers", shape=(40,), start=b)))
    steps = {"tick": Step(lambda p, x, u: {"due": 1.0}), "many": Step(_long, when="due")}
    state = rows + Table((Row("due", "1", start=1.0),))
    model = Model("long", "long", Table(), state, Table(), rows, steps, lambda p, x: {"a": x.a, "b": x.b})
    slow = make_runner(model, None, "interpreter").run(20)
    monkeypatch.setattr(compiling, "WRITER", f"{least}, {longest}")  # other libraries than those of the code as it stands
    monkeypatch.setattr(codegen, "LONG", 50)
    monkeypatch.setattr(codegen, "plan", partial(plan, least=least, longest=longest))
    codegen._functions.cache_clear()
    source = codegen.native_source(model)
    assert "PIECE void many_3(" in source
    forms = r"t\[i\]\[0\]", r"\[\d+ \+ i\]"  # by a table, and one after the other
    loops = [re.search(form, source) is not None for form in forms]
    assert loops == [least < 40] * 2
    np.testing.assert_array_equal(make_runner(model, None, "native").run(20), slow)
    for row in make_batch(model, 3, threads=1).run(20, every=1):
        np.testing.assert_array_equal(row, slow)
