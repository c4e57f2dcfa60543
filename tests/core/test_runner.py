"""One instance of a model: steps in order, inputs, cycles, the choice of a backend, and what it refuses."""

import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.core import runner as runner_module
from insenv.core.runner import BACKENDS, make_runner, resolve_backend

HELD = np.array([0.1, -0.2, 0.3, 0.0])
backends = pytest.mark.parametrize("backend", BACKENDS)


@backends
def test_the_steps_run_in_order_and_a_seed_set_later_is_drawn_from(toy, backend):
    runner, other = make_runner(toy, {"seed": 4}, backend), make_runner(toy, {"seed": 5}, backend)
    begin = other.x.copy()
    runner.run(10, np.zeros(4))
    assert runner.state["step"] == 10
    assert runner.state["rare"] == 3  # at 3, 6 and 9
    runner.advance({"kick": 1})
    assert runner.state["kicks"] == 1
    runner.step("kick")
    assert runner.state["kicks"] == 2 and runner.state["untouched"] == 7
    runner.p[:] = other.p
    runner.start()
    assert np.array_equal(runner.x, begin)
    assert np.array_equal(runner.run(20, HELD), other.run(20, HELD))


@backends
@pytest.mark.parametrize("n", [0, 60])
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
