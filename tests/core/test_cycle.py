"""Cycles (a step, some advances with watched rows, the outputs) and restarted rows of a batch."""

import shutil

import numpy as np
import pytest

from insenv.core.batch import make_batch
from insenv.core.runner import BACKENDS, make_runner

has_compiler = shutil.which("cc") is not None
backends = [
    pytest.param(b, marks=pytest.mark.skipif(b == "native" and not has_compiler, reason="no compiler")) for b in BACKENDS
]
HELD = np.array([0.1, -0.2, 0.3, 0.0])


@pytest.mark.parametrize("backend", backends)
@pytest.mark.parametrize("n", [0, 1, 5, 60])
def test_a_cycle_is_a_step_then_advances_then_the_outputs(toy, backend, n):
    one, other = (make_runner(toy, {"seed": 4}, backend) for _ in range(2))
    one.advance(HELD), other.advance(HELD)
    call, buffer = one.cycle("kick", ("position", "rare"), n)
    for _ in range(2):
        call()
        other.step("kick")
        rows = []
        for _ in range(n):
            other.advance()
            rows.append([*other.state["position"], other.state["rare"]])
        assert np.array_equal(buffer[: 4 * n], np.ravel(rows))
        assert np.array_equal(buffer[4 * n :], other.output())


@pytest.mark.parametrize("backend", backends)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_batch_runs_the_cycles_of_its_rows(toy, backend, threads):
    rows, watched = 11, ("position", "rare_due", "rare")
    u = np.random.default_rng(1).normal(size=(rows, 4)) * [1, 1, 1, 0]
    batch = make_batch(toy, rows, {"seed": 9}, threads=threads, lanes=4, backend=backend)
    call, inputs = batch.cycle("kick", watched, 7)
    inputs[:] = u
    found = [call() for _ in range(3)][-1]
    for i in range(rows):
        single = make_runner(toy, {"seed": 9 + i}, backend)
        single.advance(u[i])
        single.start()
        once, buffer = single.cycle("kick", watched, 7)
        for _ in range(3):
            once()
        assert np.array_equal(found[i], buffer)


@pytest.mark.parametrize("backend", backends)
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
    for row, parameters in zip(chosen, p, strict=True):
        assert np.array_equal(shown[row], make_runner(toy, parameters, backend).run(4, HELD, 4)[0])
    batch.set_parameters(chosen[:1], toy.parameters.pack({"seed": 50, "gain": 0.0})[None])
    moved = batch.run(1, HELD, every=1)[2, 0], make_runner(toy, {"seed": 50, "gain": 3.0}, backend)
    moved[1].run(4, HELD)
    moved[1].p[:] = toy.parameters.pack({"seed": 50, "gain": 0.0})
    assert np.array_equal(moved[0], moved[1].run(1, HELD, 1)[0])


@pytest.mark.parametrize("backend", backends)
def test_a_seed_set_later_is_the_one_that_is_drawn_from(toy, backend):
    runner, other = make_runner(toy, {"seed": 4}, backend), make_runner(toy, {"seed": 5}, backend)
    start = other.x.copy()
    runner.run(3, HELD)
    runner.p[:], runner.x[:] = other.p, start
    assert np.array_equal(runner.run(20, HELD), other.run(20, HELD))
