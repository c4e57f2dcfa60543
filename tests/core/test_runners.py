"""One model in three runners with bit-identical results."""

import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from exactness import inexact_operations

from insenv.core import runner as runner_module
from insenv.core.batch import make_batch
from insenv.core.runner import make_runner, resolve_backend
from insenv.core.tables import Row, Table
from insenv.errors import InputError
from insenv.estimators import registered
from insenv.plant.feeding import input_rows
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


SAMPLES = 6000


@cache
def swaying_ship():
    """A plant at 10 Hz, and its columns of ten minutes: fixes 0.2 s late, and some samples known to be at rest."""
    scenario = load("large-misalignment")
    late = scenario.gnss.model_copy(update={"latency_s": 0.2, "epoch_offset_s": 0.03})
    plant = build(scenario.model_copy(update={"rate_hz": 10.0, "gnss": late}), seed=6, duration_s=SAMPLES / 10)
    columns = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters, "interpreter").run(SAMPLES))
    standing = (np.arange(SAMPLES) % 1000 > 990).astype(float)
    return plant, {**columns, "dt": np.full(SAMPLES, 0.1), "standing": standing, "smoothed": standing}


def counted(model):
    """The model with a counter of the calls of each conditional step as a further state row, and the counters' names."""
    rare = {name: f"calls_of_{name}" for name, step in model.steps.items() if step.when is not None}

    def counting(step, row):
        return replace(step, function=lambda p, x, u: {**step.function(p, x, u), row: getattr(x, row) + 1})

    steps = {name: counting(step, rare[name]) if name in rare else step for name, step in model.steps.items()}
    rows = Table(tuple(Row(row, "Number of calls") for row in rare.values()))
    return replace(model, id=f"{model.id}-counted", state=model.state + rows, steps=steps), rare


@native
@pytest.mark.parametrize("id", sorted(registered()))
def test_estimators_are_bit_equal_on_all_runners(id):
    """Ten minutes on a ship, long enough for every conditional step of every estimator: fixes, outputs of FIR cascades,
    answers of the machine, the end of the coarse alignment, rest.
    """
    estimator = registered()[id]
    model, (plant, columns) = estimator.model, swaying_ship()
    # ecef-kf has other steps on a moving base
    cases = [{"moving": 0.0}, {"moving": 1.0}] if id == "ecef-kf" else [{}]
    u = input_rows(model, columns, SAMPLES)
    p = np.array([model.parameters.pack({**estimator.parameters(plant.knowledge), **case}) for case in cases])
    batch = make_batch(model, len(cases) + 2, p[np.arange(len(cases) + 2) % len(cases)], backend="native")
    shown = batch.run(SAMPLES, np.broadcast_to(u, (len(cases) + 2, *u.shape)), every=10)
    with_counters, rare = counted(model)
    calls = dict.fromkeys(rare, 0.0)
    for case, parameters in enumerate(p):
        runs = [make_runner(model, parameters, backend) for backend in ("interpreter", "native")]
        one, other = (runner.run(SAMPLES, u, 10) for runner in runs)
        assert np.isfinite(one).all()
        assert np.array_equal(one, other) and np.array_equal(runs[0].x, runs[1].x)
        assert np.array_equal(shown[case], one) and np.array_equal(shown[case + len(cases)], one)
        runner = make_runner(with_counters, parameters, "interpreter")
        runner.run(SAMPLES, u, 0)
        assert np.array_equal(runner.x[: model.state.size], runs[0].x)
        calls = {name: count + float(runner.state[rare[name]]) for name, count in calls.items()}
    assert {name: count for name, count in calls.items() if count < 1} == {}


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
    runner_module._warn_interpreter.cache_clear()
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
