"""A row looked up in a table: the loop in C gives the bits of the written-out sum, alone and in a batch."""

import casadi as ca
import numpy as np

from insenv.core.batch import make_batch
from insenv.core.instructions import instructions, row_of, table_loop
from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table

ROWS = 100


def model():
    parameters = Table((Row("pad", "first", "1", (3,)), Row("table", "a table", "1", (ROWS, 4))))
    state = Table((Row("number", "number of the row"), Row("found", "the row", shape=(4,)), Row("due", "whether to look up")))
    shown = Table((Row("shown", "the row", shape=(4,)),))
    look_up = Step(lambda p, x, u: {"found": ca.vertcat(*row_of(p.table, x.number))}, when="due")
    count = Step(lambda p, x, u: {"due": ca.SX(1), "number": x.number + x.due})
    steps = {"look_up": look_up, "count": count}
    return Model("lookup", "t", parameters, state, Table(), shown, steps, lambda p, x: {"shown": x.found})


def test_every_runner_gives_the_same_row():
    table = np.random.default_rng(1).standard_normal((ROWS, 4))
    table[7] = -0.0
    slow, shown = (make_runner(model(), {"table": table}, backend).run(ROWS + 5) for backend in ("interpreter", "native"))
    assert shown.tobytes() == slow.tobytes()
    assert np.array_equal(shown[1 : ROWS + 1], table)
    assert not shown[ROWS + 1 :].any()  # there is no such row
    vectors = np.tile(model().parameters.pack({"table": table}), (3, 1))
    vectors[1, 3:] *= 2.0
    batch = make_batch(model(), 3, vectors, backend="native")
    every = np.array(batch.run(ROWS + 5, every=1))
    assert every[0].tobytes() == shown.tobytes()
    assert np.array_equal(every[1, 1 : ROWS + 1], 2.0 * table)


def loop_of(expression, *arguments):
    return table_loop(instructions(ca.Function("f", list(arguments), [expression])))


def test_only_a_look_up_is_a_loop():
    p, x = ca.SX.sym("p", 3 + 4 * ROWS), ca.SX.sym("x", 2)
    table = ca.reshape(p[3:], 4, ROWS).T
    found = row_of(table, x[1])
    loop = loop_of(ca.vertcat(*found), p, x)
    assert (loop.count, loop.index, loop.argument, loop.firsts, loop.stride) == (ROWS, (1, 1), 0, (3, 4, 5, 6), 4)
    assert loop_of(ca.vertcat(found[0] + 1.0), p, x) is None
    assert loop_of(ca.vertcat(found[0], row_of(table, x[0])[1]), p, x) is None
    assert loop_of(ca.vertcat(*row_of(table[::-1, :], x[1])), p, x).stride == -4
    mixed = table[:, 0]
    mixed[50] = p[0]
    assert loop_of(ca.vertcat(*row_of(mixed, x[1])), p, x) is None
