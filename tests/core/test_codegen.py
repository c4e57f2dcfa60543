"""Instructions, their order, and results written in place."""

from __future__ import annotations

import shutil

import casadi as ca
import pytest

from insenv.core.batch import make_batch
from insenv.core.codegen import native_source
from insenv.core.instructions import instructions, ordering
from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.estimators import get, registered


@pytest.mark.parametrize("id", registered())
def test_an_order_has_every_instruction_once_and_after_its_sources(id: str) -> None:
    for kernel in get(id).model.kernels.values():
        steps = instructions(kernel.function)
        order = ordering(steps, {})
        place = {k: i for i, k in enumerate(order)}
        used = {source for step in steps for source in step.sources}
        assert len(place) == len(order)
        assert set(range(len(steps))) - set(place) <= {k for k, step in enumerate(steps) if step.is_leaf} - used
        assert all(place[source] < place[k] for k in order for source in steps[k].sources)


def test_a_chain_is_broken_up_and_a_rule_kept() -> None:
    x = ca.SX.sym("x", 2)
    first, second = x[0], x[1]
    for _ in range(20):
        first, second = first * first, ca.sqrt(second)
    steps = instructions(ca.Function("f", [x], [ca.vertcat(first, second)]))
    order = [k for k in ordering(steps, {}) if not steps[k].is_leaf]
    names = [steps[k].name for k in order][:20]
    assert min(names.count("SQ"), names.count("SQRT")) > 2  # the two chains are interleaved
    outputs = [k for k, step in enumerate(steps) if step.name == "OUTPUT"]
    late = next(k for k, step in enumerate(steps) if step.name == "SQ")
    ruled = ordering(steps, {late: [outputs[1]]})
    assert ruled.index(late) > ruled.index(outputs[1])


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on the path")
@pytest.mark.parametrize("rows", [1, 7])
def test_rows_that_change_places_are_read_before_they_are_written(rows: int) -> None:
    state = Table(tuple(Row(name, name, start=value) for name, value in (("a", 1.0), ("b", 2.0), ("c", 3.0))))
    turn = Step(lambda p, x, u: {"a": x.b, "b": x.c, "c": x.a + 0.0 * x.b})
    model = Model("ring", "ring", Table(), state, Table(), state, {"turn": turn}, lambda p, x: vars(x))
    runner = make_runner(model, backend="native")
    batch = make_batch(model, rows, backend="native")
    assert runner.run(2).tolist() == [[2.0, 3.0, 1.0], [3.0, 1.0, 2.0]]
    assert batch.run(2, every=1).tolist() == [[[2.0, 3.0, 1.0], [3.0, 1.0, 2.0]]] * rows


def test_an_operation_that_is_not_exactly_rounded_is_refused() -> None:
    state = Table((Row("a", "a"),))
    model = Model(
        "sine", "sine", Table(), state, Table(), state, {"go": Step(lambda p, x, u: {"a": ca.sin(x.a)})}, lambda p, x: vars(x)
    )

    with pytest.raises(RuntimeError, match="'go' of a model uses SIN: not an exactly rounded operation"):
        native_source(model)
