"""One instance of a model: steps in order, inputs, snapshots, cycles, the backends, and what they refuse."""

import numpy as np
import pytest
from exactness import inexact_operations

from insenv.core import runner as runner_module
from insenv.core.runner import BACKENDS, make_runner, resolve_backend
from insenv.errors import InputError
from insenv.estimators import registered

HELD = np.array([0.1, -0.2, 0.3, 0.0])
backends = pytest.mark.parametrize("backend", BACKENDS)


def inputs(count, seed=0):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(size=(count, 3)), rng.integers(0, 2, (count, 1))], axis=1)


@backends
def test_the_steps_run_in_order(toy, backend):
    runner = make_runner(toy, {"seed": 4}, backend)
    begin = runner.x.copy()
    runner.run(10, np.zeros(4))
    assert runner.state["step"] == 10
    assert runner.state["rare"] == 3  # at 3, 6 and 9
    runner.advance({"kick": 1})
    assert runner.state["kicks"] == 1
    runner.step("kick")
    assert runner.state["kicks"] == 2 and runner.state["untouched"] == 7
    runner.start()
    assert np.array_equal(runner.x, begin)


def test_interpreter_and_native_are_bit_identical(toy):
    runners = [make_runner(toy, {"seed": 4}, backend) for backend in ("interpreter", "native")]
    first, second = (r.run(300, inputs(300), 7) for r in runners)
    assert first.shape == (42, toy.outputs.size)
    assert np.array_equal(first, second) and np.array_equal(runners[0].x, runners[1].x)


@backends
def test_a_copy_of_the_state_is_a_complete_snapshot(toy, backend):
    runner = make_runner(toy, {"seed": 8}, backend)
    runner.run(5, inputs(5))
    snapshot = runner.x.copy()
    first = runner.run(20, inputs(20, 1))
    runner.x[:] = snapshot
    assert np.array_equal(first, runner.run(20, inputs(20, 1)))


@backends
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


@backends
def test_a_seed_set_later_is_the_one_that_is_drawn_from(toy, backend):
    runner, other = make_runner(toy, {"seed": 4}, backend), make_runner(toy, {"seed": 5}, backend)
    start = other.x.copy()
    runner.run(3, HELD)
    runner.p[:], runner.x[:] = other.p, start
    assert np.array_equal(runner.run(20, HELD), other.run(20, HELD))


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda r: r.run(3, np.zeros((4, 4))), "shape"),
        (lambda r: r.run(3, np.array([0, 0, np.nan, 0])), "nan"),
        (lambda r: r.advance({"shove": 1}), "shove"),
        (lambda r: r.step("samples"), "did you mean 'sample'"),
    ],
)
def test_wrong_calls_are_named(toy, call, said):
    with pytest.raises(InputError, match=said):
        call(make_runner(toy, None, "interpreter"))


def test_backend_is_chosen_by_argument_then_environment(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")
    assert resolve_backend() == "interpreter" and resolve_backend("native") == "native"
    monkeypatch.setenv("INSENV_BACKEND", "quick")
    with pytest.raises(InputError, match="INSENV_BACKEND"):
        resolve_backend()


def test_without_a_compiler_it_says_so_once_and_interprets(toy, monkeypatch):
    monkeypatch.delenv("INSENV_BACKEND", raising=False)
    monkeypatch.setattr(runner_module, "find_compiler", lambda: None)
    runner_module._warn_interpreter.cache_clear()
    with pytest.warns(RuntimeWarning, match="no C compiler") as said:
        assert make_runner(toy).backend == "interpreter"
        make_runner(toy)
    assert len(said) == 1
    with pytest.raises(InputError, match="needs a C compiler"):
        make_runner(toy, backend="native")


# --- every estimator


@pytest.mark.parametrize("id", sorted(registered()))
def test_models_hold_only_exactly_rounded_operations(id):
    model = registered()[id].model
    found = {name: inexact_operations(kernel.function) for name, kernel in model.kernels.items()}
    assert set().union(*found.values()) == set(), found
