"""Many rows of a model at once: each is the single run of its parameters, its inputs and its seed."""

import numpy as np
import pytest

from insenv.core.batch import make_batch
from insenv.core.runner import BACKENDS, make_runner

HELD = np.array([0.1, -0.2, 0.3, 0.0])
backends = pytest.mark.parametrize("backend", BACKENDS)


def inputs(*shape):
    rng = np.random.default_rng(shape[0])
    return np.concatenate([rng.normal(size=(*shape, 3)), rng.integers(0, 2, (*shape, 1))], axis=-1)


@pytest.mark.parametrize(("rows", "threads", "lanes"), [(1, 1, 8), (8, 1, 1), (9, 2, 8), (1000, 2, None)])
def test_row_i_equals_the_single_run_of_seed_plus_i(toy, rows, threads, lanes):
    u = inputs(rows, 40)
    batch = make_batch(toy, rows, {"seed": 100}, threads=threads, lanes=lanes, backend="native")
    shown = batch.run(40, u, every=4)
    assert shown.shape == (rows, 10, toy.outputs.size)
    for i in {0, rows // 2, rows - 1}:
        single = make_runner(toy, {"seed": 100 + i}, "native")
        assert np.array_equal(shown[i], single.run(40, u[i], 4))
        assert np.array_equal(batch.x[i], single.x)
    assert np.array_equal(batch.output()[-1], shown[-1, -1])


@backends
def test_a_batch_runs_the_cycles_of_its_rows(toy, backend):
    rows, watched = 11, ("position", "rare_due", "rare")
    u = inputs(rows) * [1, 1, 1, 0]
    batch = make_batch(toy, rows, {"seed": 9}, threads=2, lanes=4, backend=backend)
    call, given = batch.cycle("kick", watched, 7)
    given[:] = u
    found = [call() for _ in range(3)][-1]
    for i in range(rows):
        single = make_runner(toy, {"seed": 9 + i}, backend)
        single.advance(u[i])
        single.start()
        once, buffer = single.cycle("kick", watched, 7)
        for _ in range(3):
            once()
        assert np.array_equal(found[i], buffer)


@backends
def test_some_rows_start_afresh_and_the_others_go_on(toy, backend):
    batch = make_batch(toy, 10, {"seed": 1}, lanes=4, backend=backend)
    batch.run(5, HELD)
    before, chosen = batch.x, np.array([2, 9, 3])
    p = np.array([toy.parameters.pack({"seed": s, "gain": 3.0}) for s in (50, 60, 70)])
    states = batch.starts(p)
    assert np.array_equal(batch.x, before)
    batch.start_rows(chosen, p)
    others = np.setdiff1d(np.arange(10), chosen)
    assert np.array_equal(batch.x[others], before[others])
    assert np.array_equal(batch.x[chosen], states)
    shown = batch.run(4, HELD, every=4)[:, 0]
    single = [make_runner(toy, parameters, backend) for parameters in p]
    for row, runner in zip(chosen, single, strict=True):
        assert np.array_equal(shown[row], runner.run(4, HELD, 4)[0])
    single[0].p[:] = toy.parameters.pack({"seed": 50, "gain": 0.0})
    batch.set_parameters(chosen[:1], single[0].p[None])
    assert np.array_equal(batch.run(1, HELD, every=1)[2, 0], single[0].run(1, HELD, 1)[0])
