"""Long functions in pieces: the same bits as in one, natively and in a batch; a place of w holds one value at a time."""

from functools import partial

import casadi as ca
import numpy as np
import pytest

from insenv.core import codegen
from insenv.core import compile as compiling
from insenv.core.batch import make_batch
from insenv.core.instructions import instructions, ordering
from insenv.core.model import Model, Step
from insenv.core.pieces import pieces
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.estimators import get

FILTER = get("loosely-coupled").model


def test_a_place_is_read_before_it_holds_another_value():
    """Every value is there when a piece uses it, for a real function and several lengths."""
    steps = instructions(FILTER.kernels["gnss"].function)
    order = ordering(steps, {})
    for longest in (1, 7, 100, 10**6):
        parts, size = pieces(steps, order, longest)
        work = [k for k in order if not steps[k].is_leaf]
        assert len(parts) == -(-len(work) // longest)
        held: dict[int, int] = {}
        done = []
        for piece in parts:
            known = set()
            for kind, k, place in piece.statements:
                if kind == "load":
                    assert held[place] == k and place < size
                    known.add(k)
                elif kind == "do":
                    assert set(steps[k].sources) <= known
                    known.add(k)
                    done += [] if steps[k].is_leaf else [k]
                else:
                    held[place] = k
        assert done == work
        assert size < len(work) / 2 or longest == 1 or size == 0


def _long(p, x, u):
    """Sums and products that use values from far before."""
    values = [x.a[0], x.a[1], x.a[2]]
    for k in range(200):
        values.append(0.5 * values[-1] - values[k // 2] * 0.7 + values[k // 3] * values[-3] * 0.01)
    return {"a": ca.vertcat(*values[-3:])}


def test_pieces_give_the_same_bits(monkeypatch):
    rows = Table((Row("a", "Numbers", "1", (3,), start=(0.3, -0.2, 0.9)),))
    model = Model(
        id="long-function", title="long", parameters=Table(), state=rows + Table((Row("due", "1", start=1.0),)), inputs=Table(),
        outputs=rows, steps={"tick": Step(lambda p, x, u: {"due": 1.0}), "many": Step(_long, when="due")},
        output=lambda p, x: {"a": x.a},
    )  # fmt: skip
    slow = make_runner(model, None, "interpreter").run(20)
    monkeypatch.setattr(compiling, "WRITER", "pieces of 40")  # other libraries than those of the code as it stands
    monkeypatch.setattr(codegen, "LONG", 50)
    monkeypatch.setattr(codegen, "pieces", partial(pieces, longest=40))
    assert "PIECE void many_3(" in codegen.native_source(model)
    np.testing.assert_array_equal(make_runner(model, None, "native").run(20), slow)
    for row in make_batch(model, 3, threads=1).run(20, every=1):
        np.testing.assert_array_equal(row, slow)


@pytest.mark.parametrize("source", [codegen.native_source, codegen.embedded_source, codegen.batch_source])
def test_short_functions_stay_in_one(source):
    assert "PIECE" not in source(get("q-method").model)
