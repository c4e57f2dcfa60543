"""One model in three runners with bit-identical results."""

import shutil

import numpy as np
import pytest
from exactness import inexact_operations

from insenv.core import runner as runner_module
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner, resolve_backend
from insenv.errors import InputError
from insenv.estimators import registered
from insenv.scenario import build, load

has_compiler = shutil.which("cc") is not None
native = pytest.mark.skipif(not has_compiler, reason="no C compiler on the path")


def inputs(count, seed=0):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.normal(size=(count, 3)), rng.integers(0, 2, (count, 1))], axis=1)


def test_interpreter_runs_the_steps_in_order(toy):
    runner = make_runner(toy, {"seed": 4}, "interpreter")
    runner.run(10, np.array([0.0, 0, 0, 0]))
    assert runner.state["step"] == 10
    assert runner.state["rare"] == 3  # at 3, 6 and 9
    runner.advance({"kick": 1})
    assert runner.state["kicks"] == 1
    runner.step("kick")
    assert runner.state["kicks"] == 2
    assert runner.state["untouched"] == 7


@native
def test_interpreter_and_native_are_bit_identical(toy):
    runners = [make_runner(toy, {"seed": 4}, backend) for backend in ("interpreter", "native")]
    u = inputs(300)
    first, second = (r.run(300, u, 7) for r in runners)
    assert first.shape == (42, toy.outputs.size)
    assert np.array_equal(first, second)
    assert np.array_equal(runners[0].x, runners[1].x)


@native
@pytest.mark.parametrize("rows", [1, 7, 8, 9, 1000])
@pytest.mark.parametrize("threads", [1, 2])
def test_row_i_equals_the_single_run_of_seed_plus_i(toy, rows, threads):
    rng = np.random.default_rng(rows)
    u = np.concatenate([rng.normal(size=(rows, 40, 3)), rng.integers(0, 2, (rows, 40, 1))], axis=2)
    batch = make_batch(toy, rows, {"seed": 100}, threads=threads, lanes=8, backend="native")
    shown = batch.run(40, u, every=4)
    assert shown.shape == (rows, 10, toy.outputs.size)
    for i in {0, rows // 2, rows - 1}:
        single = make_runner(toy, {"seed": 100 + i}, "native")
        assert np.array_equal(shown[i], single.run(40, u[i], 4))
        assert np.array_equal(batch.x[i], single.x)
    assert np.array_equal(batch.output()[-1], shown[-1, -1])


@native
@pytest.mark.parametrize("lanes", [1, 2, 4, 8, None])
def test_lanes_do_not_matter(toy, lanes):
    reference = make_batch(toy, 9, {"seed": 5}, backend="interpreter")
    batch = make_batch(toy, 9, {"seed": 5}, lanes=lanes, backend="native")
    held = inputs(9)
    assert np.array_equal(batch.run(30, held, every=10), reference.run(30, held, every=10))


@native
def test_the_plant_of_a_scenario_is_bit_equal_on_all_runners():
    plant = build(load("ship-swaying"), seed=11, duration_s=2.0)
    runs = [make_runner(plant.model, plant.parameters, b).run(plant.samples) for b in ("interpreter", "native")]
    assert np.array_equal(*runs)
    batch = make_batch(plant.model, 9, {**plant.parameters, "seed": 8}, threads=2, backend="native")
    assert np.array_equal(batch.run(plant.samples, every=1)[3], runs[0])


@native
@pytest.mark.parametrize("id", sorted(registered()))
def test_estimators_are_bit_equal_on_all_runners(id):
    model = registered()[id].model
    rng = np.random.default_rng(3)
    u = np.tile(model.inputs.start_vector(), (60, 1))
    u[:, model.inputs.slice("delta_angle")] = rng.normal(size=(60, 3)) * 1e-3
    u[:, model.inputs.slice("delta_velocity")] = rng.normal(size=(60, 3)) * 1e-2 + [0, 0, -0.049]
    if "gnss_valid" in model.inputs:
        u[::20, model.inputs.slice("gnss_valid")] = 1
        u[::20, model.inputs.slice("gnss_velocity_valid")] = 1
        u[::20, model.inputs.slice("gnss_age")] = 0.003
    if "standing" in model.inputs:
        u[45:50, model.inputs.slice("standing")] = 1
    runs = [make_runner(model, None, b).run(60, u) for b in ("interpreter", "native")]
    assert np.isfinite(runs[0]).all()
    assert np.array_equal(*runs)
    batch = make_batch(model, 5, None, backend="native").run(60, np.broadcast_to(u, (5, *u.shape)), every=1)
    assert np.array_equal(batch[4], runs[0])


@pytest.mark.parametrize("id", sorted(registered()))
def test_models_hold_only_exactly_rounded_operations(id):
    model = registered()[id].model
    assert {name: inexact_operations(k.function) for name, k in model.kernels.items() if inexact_operations(k.function)} == {}


@pytest.mark.parametrize("backend", ["interpreter", pytest.param("native", marks=native)])
def test_a_copy_of_the_state_is_a_complete_snapshot(toy, backend):
    runner = make_runner(toy, {"seed": 8}, backend)
    runner.run(5, inputs(5))
    snapshot = runner.x.copy()
    first = runner.run(20, inputs(20, 1))
    runner.x[:] = snapshot
    assert np.array_equal(first, runner.run(20, inputs(20, 1)))


def test_start_returns_to_the_start(toy):
    runner = make_runner(toy, {"seed": 8}, "interpreter")
    begin = runner.x.copy()
    runner.run(5, inputs(5))
    runner.start()
    assert np.array_equal(runner.x, begin)


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
    assert resolve_backend() == "interpreter"
    monkeypatch.setenv("INSENV_BACKEND", "quick")
    with pytest.raises(InputError, match="INSENV_BACKEND"):
        resolve_backend()


def test_without_a_compiler_it_says_so_once_and_interprets(toy, monkeypatch):
    monkeypatch.delenv("INSENV_BACKEND", raising=False)
    monkeypatch.setattr(runner_module, "find_compiler", lambda: None)
    runner_module._warn_no_compiler.cache_clear()
    with pytest.warns(RuntimeWarning, match="no C compiler") as said:
        assert make_runner(toy).backend == "interpreter"
        make_runner(toy)
    assert len(said) == 1
    with pytest.raises(InputError, match="needs a C compiler"):
        make_runner(toy, backend="native")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"rows": 0}, "rows = 0"),
        ({"rows": 2, "threads": 0}, "threads = 0"),
        ({"rows": 2, "parameters": np.zeros((3, 3))}, "shape"),
    ],
)
def test_wrong_batches_are_named(toy, arguments, said):
    with pytest.raises(InputError, match=said):
        make_batch(toy, **arguments, backend="interpreter")
