"""Long functions in loops: the same bits as in one, natively and in a batch; a place of w holds one value at a time."""

from functools import partial

import casadi as ca
import numpy as np
import pytest

from insenv.core import codegen, functions
from insenv.core import compile as compiling
from insenv.core.batch import make_batch
from insenv.core.instructions import instructions
from insenv.core.loops import plan
from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.estimators import get

FILTER = get("loosely-coupled").model


@pytest.mark.parametrize("longest", [1, 100, 10**6])
@pytest.mark.parametrize("least", [2, 6, 10**6])
def test_every_instruction_runs_once_on_its_own_sources(least: int, longest: int) -> None:
    steps = instructions(FILTER.kernels["gnss"].function)
    written = plan(steps, least, longest)
    held: dict[int, int] = {}
    done: set[int] = set()
    for piece in written.pieces:
        assert len(piece) == 1 or sum(unit.statements for unit in piece) <= longest
        known: set[int] = set()
        for unit in piece:
            assert len(unit.roots) == 1 or len(unit.roots) >= least
            alone = len(unit.roots) == 1
            for number, root in enumerate(unit.roots):
                work = {k: _same(steps, unit, k, number) for k in unit.work}  # of this expression
                assert work[unit.roots[0]] == root
                for k, own in work.items():
                    sources = zip(steps[k].sources, unit.operands[k], steps[own].sources, strict=True)
                    for first, operand, source in sources:
                        assert source == (work[first] if operand is None else unit.columns[operand][number])
                        if operand is not None and not steps[source].is_leaf and not (alone and source in known):
                            assert held[written.places[source]] == source
                    assert (steps[own].name, steps[own].value) == (steps[k].name, steps[k].value)
                    assert own not in done
                    done.add(own)
                if root in written.places:
                    held[written.places[root]] = root
            known |= set(unit.roots) | unit.sources if alone else set()
    assert done == {k for k, step in enumerate(steps) if not step.is_leaf}
    assert max(written.places.values(), default=-1) < max(written.size, 1) < len(done)


def _same(steps, unit, k: int, number: int) -> int:
    """The instruction of expression `number` that stands where k stands in the first one."""
    way = []
    while k != unit.roots[0]:
        above = next(j for j in unit.work if k in steps[j].sources)
        way.append(steps[above].sources.index(k))
        k = above
    at = unit.roots[number]
    for source in reversed(way):
        at = steps[at].sources[source]
    return at


def test_the_update_of_a_covariance_is_a_tenth_of_its_length():
    P, H, R = ca.SX.sym("P", 40, 40), ca.SX.sym("H", 1, 40), ca.SX.sym("R")
    column = P @ H.T
    steps = instructions(ca.Function("update", [P, H, R], [P - (column / (H @ column + R)) @ column.T]))
    assert sum(unit.statements for piece in plan(steps).pieces for unit in piece) < len(steps) / 10


def _long(p, x, u):
    """Sums and products that use values from far before, and forty of the same form."""
    values = [x.a[0], x.a[1], x.a[2]]
    for k in range(200):
        values.append(0.5 * values[-1] - values[k // 2] * 0.7 + values[k // 3] * values[-3] * 0.01)
    alike = [ca.sqrt(1.0 + x.b[k] * values[2]) - x.b[39 - k] / 3.0 for k in range(40)]
    turned = [alike[k] * values[-1] + alike[(k * 7) % 40] for k in range(40)]
    return {"a": ca.vertcat(*values[-3:]), "b": ca.vertcat(*turned)}


def test_loops_and_pieces_give_the_same_bits(monkeypatch):
    b = tuple(0.01 * k for k in range(40))
    rows = Table((Row("a", "Numbers", shape=(3,), start=(0.3, -0.2, 0.9)), Row("b", "Numbers", shape=(40,), start=b)))
    steps = {"tick": Step(lambda p, x, u: {"due": 1.0}), "many": Step(_long, when="due")}
    state = rows + Table((Row("due", "1", start=1.0),))
    model = Model("long", "long", Table(), state, Table(), rows, steps, lambda p, x: {"a": x.a, "b": x.b})
    slow = make_runner(model, None, "interpreter").run(20)
    monkeypatch.setattr(compiling, "WRITER", "pieces of 40")  # other libraries than those of the code as it stands
    monkeypatch.setattr(functions, "LONG", 50)
    monkeypatch.setattr(functions, "plan", partial(plan, longest=40))
    codegen._functions.cache_clear()
    source = codegen.native_source(model)
    assert "PIECE void many_3(" in source
    for form in ("t[i][0]", "+1*i]"):  # by a table, and one after the other
        assert form in source
    np.testing.assert_array_equal(make_runner(model, None, "native").run(20), slow)
    for row in make_batch(model, 3, threads=1).run(20, every=1):
        np.testing.assert_array_equal(row, slow)
