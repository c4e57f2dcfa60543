"""Every interface gives the numbers of the interpreter to the bit, on one table of short runs with every step of every model.

The interfaces: native code at each level of optimisation, batch, FMU of FMI 2 and 3, WebAssembly of pages, campaign and
environment.  `make test` takes the first run of the table, on which every estimator runs, natively, but for estimators whose
models no other test of it compiles; `make test-all` the rest.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from changed_scenario import car_of_any_heading

import insenv
from insenv.bench.page_machine import PageMachine
from insenv.core import compile
from insenv.core.batch import make_batch
from insenv.core.model import Model
from insenv.core.runner import InterpreterRunner, NativeRunner
from insenv.core.tables import Vector
from insenv.envs import AlignmentEnv, NavigationEnv
from insenv.estimators import registered
from insenv.evaluation.errors import CHANNELS
from insenv.fmu import export_fmu
from insenv.fmu.running import run
from insenv.fmu.subject import subject
from insenv.scenario import Plant, Scenario, build, load
from insenv.scenario.inputs import input_rows
from insenv.studies.campaign import make_plan
from insenv.studies.campaign.block import run_block
from insenv.web.live import live

FUSED = "fusion", "fusion-smoother"
ANY_HEADING = "car-of-any-heading"
TABLE: dict[str, tuple[float, float, tuple[str, ...]]] = {
    # scenario: rate, Hz; duration, s; estimators, whose model or composition is another one than in the lines above
    "large-misalignment": (10.0, 300.0, (*registered(),)),
    "ship-swaying": (20.0, 20.0, ("q-method",)),
    "ship-moored-paper": (20.0, 20.0, ("inertial-fir",)),
    "ship-irregular-sea": (20.0, 20.0, ("q-method",)),
    "ship-slow-surge": (20.0, 20.0, ("fusion",)),
    "ship-underway": (20.0, 30.0, FUSED),
    "ship-at-sea": (20.0, 40.0, FUSED),
    "ship-dvl": (20.0, 30.0, FUSED),
    "ship-log-alignment": (20.0, 40.0, ("velocity-integration", *FUSED)),
    "static-ecef": (20.0, 20.0, ("ecef-kf",)),
    "car-parked": (100.0, 20.0, ("gyrocompass", *FUSED)),
    "car-city-drive": (100.0, 20.0, ("loosely-coupled", *FUSED)),
    "car-odometer": (100.0, 20.0, FUSED),
    "car-survey": (100.0, 20.0, FUSED),
    "car-unknown-heading": (100.0, 20.0, FUSED),
    ANY_HEADING: (60.0, 50.0, FUSED),
    "car-unknown-receiver": (100.0, 20.0, FUSED),
    "aircraft-parked": (20.0, 20.0, FUSED),
    "aircraft-survey": (100.0, 20.0, ("wander-sins", *FUSED)),
    "aircraft-free-inertial": (100.0, 20.0, ("wander-sins-plain", *FUSED)),
    "aircraft-inflight-alignment": (20.0, 60.0, FUSED),
    "multirotor-hover": (200.0, 10.0, FUSED),
    "turntable-calibration": (20.0, 30.0, FUSED),
    "turntable-indexing": (20.0, 30.0, FUSED),
    "turntable-quaternion": (20.0, 20.0, ("qakf",)),
}
SEED = 6
RARE = ("aqe-ekf", "aqe-sukf-printed", "ecef-kf-printed", "fusion-smoother", "qakf-improved-printed", "qakf-printed")
RUNS = [("large-misalignment", RARE), *(pytest.param(name, (), marks=pytest.mark.slow) for name in TABLE)]


def scenario_of(name: str) -> Scenario:
    """That of a line of the table."""
    scenario = car_of_any_heading() if name == ANY_HEADING else load(name)
    return scenario.model_copy(update={"rate_hz": TABLE[name][0]})


class Counting(InterpreterRunner):
    """An interpreter that notes which steps have run."""

    def __init__(self, *given: Any) -> None:
        self.ran: set[str] = set()
        super().__init__(*given)

    def _step(self, name: str) -> None:
        self.ran.add(name)
        super()._step(name)


class Case(NamedTuple):
    """One model of a run, with what the interpreter made of it.

    label: in messages.  parameters, inputs (samples, inputs.size): what it was given.  shown (samples, outputs.size): its
    outputs.  forced: steps that did not run by themselves and ran once after the end.  x: its state after those.
    """

    label: str
    model: Model
    parameters: Vector
    inputs: Vector
    shown: Vector
    forced: tuple[str, ...]
    x: Vector


def case(label: str, model: Model, parameters: Vector, inputs: Vector) -> Case:
    runner = Counting(model, parameters)
    shown = runner.run(len(inputs), inputs)
    if label.startswith(ANY_HEADING) and "plant" not in label:
        (seeking,) = (runner.state[row] for row in model.state.names if row.endswith("alignment_seeking"))
        assert "every-heading" in model.title and not seeking, f"{label}: the heading is not found"
    forced = tuple(name for name in model.steps if name not in runner.ran)
    for name in forced:
        runner.step(name)
    assert np.isfinite(shown).all(), label
    return Case(label, model, parameters, inputs, shown, forced, runner.x.copy())


@cache
def drive(name: str, *left_out: str) -> tuple[Plant, tuple[Case, ...]]:
    """The plant of a line of the table, and the cases of the plant and its estimators, but for those left out."""
    _, duration, ids = TABLE[name]
    scenario = scenario_of(name)
    if name == "large-misalignment":  # fixes 0.2 s late, and times at which the vehicle is known to be at rest
        late = scenario.gnss.model_copy(update={"latency_s": 0.2, "epoch_offset_s": 0.03})
        scenario = scenario.model_copy(update={"gnss": late})
    plant = build(scenario, seed=SEED, duration_s=duration, driven=True)
    still = np.tile(plant.model.inputs.start_vector(), (plant.samples, 1))
    cases = [case(f"{name}, plant", plant.model, plant.model.parameters.pack(plant.parameters), still)]
    columns = plant.model.outputs.unpack(cases[0].shown)
    standing = (np.arange(plant.samples) % 1000 > 990).astype(float)
    columns |= {"dt": np.full(plant.samples, plant.sample_interval), "standing": standing, "smoothed": standing}
    for id in (id for id in ids if id not in left_out):
        # as on a ship that is moored and under way in turn, every estimator takes the first drive
        estimator = registered()[id] if name == "large-misalignment" else plant.adapted(id)
        given = estimator.parameters(plant.knowledge, plant.tunings)
        model = estimator.model
        rows = input_rows(model, columns, plant.samples)
        for more in ({"moving": 0.0}, {"moving": 1.0}) if id == "ecef-kf" else ({},):  # which has other steps on a moving base
            cases.append(case(f"{name}, {id}", model, model.parameters.pack({**given, **more}), rows))
    return plant, tuple(cases)


@pytest.mark.parametrize("level", ["0", pytest.param("2", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("name", "left_out"), RUNS)
def test_native_code_at_any_level_of_optimisation(monkeypatch, name, left_out, level):
    monkeypatch.setenv("INSENV_OPTIMIZATION", level)
    monkeypatch.setattr(compile, "_library", compile._Library)  # which a process keeps by model, whatever the level
    for one in drive(name, *left_out)[1]:
        runner = NativeRunner(one.model, one.parameters)
        assert runner.run(len(one.inputs), one.inputs).tobytes() == one.shown.tobytes(), one.label
        for step in one.forced:
            runner.step(step)
        assert runner.x.tobytes() == one.x.tobytes(), one.label


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLE)
def test_rows_of_a_batch(name):
    for one in drive(name)[1]:
        p = np.tile(one.parameters, (3, 1))
        if one.model.is_random:
            p[::2, one.model.parameters.slice("seed")] += 5.0  # a row is not moved by its neighbours
        batch = make_batch(one.model, 3, p, backend="native")
        shown = batch.run(len(one.inputs), np.tile(one.inputs, (3, 1, 1)), every=1)
        assert shown[1].tobytes() == one.shown.tobytes(), one.label


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", TABLE)
def test_fmus(tmp_path, name, fmi):
    """Of each estimator on the first line of the table; on the others of the plant with each estimator behind it."""
    plant, cases = drive(name)
    columns = {**plant.model.outputs.unpack(cases[0].shown), "dt": np.full(plant.samples, plant.sample_interval)}
    for id in TABLE[name][2]:
        estimator = registered()[id]
        if name == "large-misalignment" and estimator.adapt is None:  # a family is exported with the start of its own scenario
            settings = {"sample_interval": plant.sample_interval, "step_is_one_increment": True}
            settings |= estimator.parameters(plant.knowledge, plant.tunings)
            made = subject(id, settings)
            fmu = export_fmu(id, tmp_path / f"{id}.fmu", fmi=fmi, settings=settings)
        elif name == "large-misalignment" or estimator.smooths:
            continue
        else:
            made = subject(plant.scenario, {}, id)
            fmu = export_fmu(plant.scenario, tmp_path / f"{id}.fmu", fmi=fmi, estimator=id)
        rows = input_rows(made.model, columns, plant.samples)
        one = case(f"{name}, {id}", made.model, made.parameters, rows)
        fed = made.model.inputs.unpack(rows) if made.kind == "estimator" else None
        found = run(fmu, fed, stop_time=None if fed else plant.duration_s).named()
        for row, values in made.model.outputs.unpack(one.shown).items():
            if row == "time":  # an FMU's own
                continue
            shown = found[row.replace("estimator_", "estimator.")]
            assert np.array_equal(np.ravel(shown), np.ravel(values)), (one.label, row)


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLE)
def test_pages_campaigns_and_environments(name):
    """The whole loop, of plant and estimator: `insenv.run` beside a page, a campaign's run of its seed, and an environment."""
    _, duration, ids = TABLE[name]
    scenario = scenario_of(name)
    able = [id for id in ids if not registered()[id].smooths and not registered()[id].refusal(scenario.drive())]
    duration = min(duration, 60.0)
    report = insenv.run(scenario, able, seed=SEED, duration_s=duration)
    assert name != ANY_HEADING or any("heading found" in note for note in report.results[0].notes)
    made = live(scenario, able, duration_s=duration)
    machine = PageMachine(made)
    machine.begin(SEED)
    shown = machine.named(machine.run(made.plant.samples // made.every * made.every, made.every))
    assert shown["q_nb"].tobytes() == report.truth.q_nb.tobytes()
    for member, result in zip(made.page.members, report.results, strict=True):
        for row, values in result.outputs.items():
            assert np.ascontiguousarray(shown[member.prefix + row]).tobytes() == values.tobytes(), (result.estimator, row)

    plan = make_plan(scenario, able[-1], 2, first_seed=SEED - 1, duration_s=duration)
    arrays, result = run_block(plan, 0), report.results[-1]
    for place, channel in enumerate(c for c in CHANNELS if c in result.errors):  # formed in the core there, in NumPy here
        values = result.errors[channel][plan.evaluations - 1 :: plan.evaluations]
        np.testing.assert_allclose(arrays["error"][1, :, place], values, rtol=1e-9, atol=1e-9)

    if not (scenario.vehicle.in_place or scenario.gnss is not None):
        return  # no environment takes it
    kind = NavigationEnv if scenario.gnss is not None else AlignmentEnv
    env = kind(scenario, samples_per_step=10, duration_s=duration)
    observation, _ = env.reset(seed=0, options={"run_seed": SEED})
    columns = drive(name)[0].model.outputs.unpack(drive(name)[1][0].shown)
    action = np.zeros(env.action_space.shape)
    action[0], action[4:] = 1.0, -1.0 if kind is AlignmentEnv else 0.0  # level, heading north, not yet declared
    for step in range(3):
        observation, *_ = env.step(action)
        seen = env.named(observation)["imu"]
        if name != "large-misalignment":  # whose receiver here is another one
            part = slice(10 * step, 10 * step + 10)
            assert np.array_equal(seen[:, :3], columns["delta_angle"][part])
            assert np.array_equal(seen[:, 3:6], columns["delta_velocity"][part])
