"""C source of a model: results written in place, short functions in one, exactly rounded operations alone."""

import casadi as ca
import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.core.batch import make_batch
from insenv.core.model import Model, Step
from insenv.core.runner import BACKENDS, make_runner
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
    with pytest.raises(InputError, match=r"'one', step 'go': casadi's \w+ is not exactly rounded.* of insenv.core.elementary$"):
        _ = model.kernels


VALUES = np.array([0.0, -0.0, 1.0, -1.0, 1.5, np.nextafter(1.5, 2.0), -2.5, 1e300, 5e-324, -5e-324])
OPERATIONS = {  # by CasADi, and by NumPy
    "less": (ca.lt, np.less), "less_or_equal": (ca.le, np.less_equal), "equal": (ca.eq, np.equal),
    "not_equal": (ca.ne, np.not_equal), "both": (ca.logic_and, np.logical_and), "either": (ca.logic_or, np.logical_or),
    "negation": (lambda a, b: ca.logic_not(a), lambda a, b: np.logical_not(a)),
    "floor": (lambda a, b: ca.floor(a), lambda a, b: np.floor(a)),
    "absolute": (lambda a, b: ca.fabs(a), lambda a, b: np.abs(a)),
    "square": (lambda a, b: a**2, lambda a, b: a * a),
    "root": (lambda a, b: ca.sqrt(ca.fabs(a)), lambda a, b: np.sqrt(np.abs(a))),
    "quotient": (lambda a, b: a / b, lambda a, b: a / b),  # no number and infinities too
    "choice": (lambda a, b: ca.if_else(a, b, 0.0), lambda a, b: np.where(a != 0.0, b, 0.0)),
}  # fmt: skip


@pytest.mark.parametrize("backend", BACKENDS)
def test_operations_are_those_of_ieee_754_at_their_boundaries_too(backend):
    """A row for each pair of values: equal ones, zeros of both signs, neighbours, the smallest numbers and large ones."""
    a, b = (column.ravel() for column in np.meshgrid(VALUES, VALUES))
    inputs = Table(tuple(Row(name, name, lower=-np.inf, upper=np.inf) for name in "ab"))
    state = Table(tuple(Row(name, name) for name in OPERATIONS))
    go = Step(lambda p, x, u: {name: symbolic(u.a, u.b) for name, (symbolic, _) in OPERATIONS.items()})
    model = Model("operations", "operations", Table(), state, inputs, state, {"go": go}, lambda p, x: vars(x))
    batch = make_batch(model, len(a), backend=backend)
    batch.run(1, np.stack([a, b], axis=1)[:, None], every=1)
    with np.errstate(all="ignore"):
        for name, (_, numeric) in OPERATIONS.items():
            found = batch.x[:, state.slice(name)][:, 0]
            np.testing.assert_array_equal(found, numeric(a, b).astype(float), err_msg=name)
