"""C source of a model: results written in place, short functions in one, exactly rounded operations alone."""

import casadi as ca
import pytest

from insenv.core.batch import make_batch
from insenv.core.codegen import native_source
from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table


@pytest.mark.parametrize("rows", [1, 7])
def test_rows_that_change_places_are_read_before_they_are_written(rows):
    state = Table(tuple(Row(name, name, start=value) for name, value in (("a", 1.0), ("b", 2.0), ("c", 3.0))))
    turn = Step(lambda p, x, u: {"a": x.b, "b": x.c, "c": x.a + 0.0 * x.b})
    model = Model("ring", "ring", Table(), state, Table(), state, {"turn": turn}, lambda p, x: vars(x))
    batch = make_batch(model, rows, backend="native")
    assert make_runner(model, backend="native").run(2).tolist() == [[2.0, 3.0, 1.0], [3.0, 1.0, 2.0]]
    assert batch.run(2, every=1).tolist() == [[[2.0, 3.0, 1.0], [3.0, 1.0, 2.0]]] * rows


@pytest.mark.parametrize("name", ["sin", "cos", "tan", "atan2", "asin", "exp", "log", "sinh", "tanh", "erf", "fmod", "power"])
def test_an_operation_that_is_not_exactly_rounded_is_refused(name):
    """Whose result may differ between machines."""
    of = getattr(ca, name)
    go = Step(lambda p, x, u: {"a": of(x.a, x.b) if name in ("atan2", "fmod", "power") else of(x.a)})
    state = Table((Row("a", "a"), Row("b", "b")))
    model = Model("one", "one", Table(), state, Table(), state, {"go": go}, lambda p, x: vars(x))
    with pytest.raises(RuntimeError, match=r"'go' of a model uses \w+: not an exactly rounded operation"):
        native_source(model)
