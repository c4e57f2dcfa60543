"""The loop of a plant and an estimator gives the outputs of the plant followed by the estimator."""

from dataclasses import replace

import numpy as np
import pytest

from insenv.core.model import derived
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.scenario import build, load
from insenv.scenario.inputs import input_rows
from insenv.scenario.loop import loop_model

SAMPLES = 220  # a fix, some tens of covariances, the first windows
QUICK = ("analytic", "ecef-kf", "loosely-coupled", "q-method")
"""One of each kind of conditions and inputs; tests/core/test_bits.py runs the loop of each estimator."""


def scenario_for(estimator):
    return load("car-parked" if estimator.kind == "alignment" else "car-city-drive")


def parameters(plant, estimator):
    return {**plant.parameters, **{f"estimator_{k}": v for k, v in estimator.parameters(plant.knowledge).items()}}


def one_after_the_other(plant, estimator, samples=SAMPLES, lost=False):
    """Outputs of plant and estimator, (samples, ...), by the interpreter."""
    shown = make_runner(plant.model, plant.parameters, "interpreter").run(samples)
    columns = {name: np.array(column) for name, column in plant.model.outputs.unpack(shown).items()}
    columns["dt"] = np.full(samples, plant.sample_interval)
    if lost:
        held = {"delta_angle": np.zeros(3), "delta_velocity": np.array([0.0, 0.0, -9.80665]) * plant.sample_interval}
        for k, valid in enumerate(columns["imu_valid"]):
            for name, latest in held.items():
                if valid:
                    latest[:] = columns[name][k]
                columns[name][k] = latest
    runner = make_runner(estimator.model, estimator.parameters(plant.knowledge), "interpreter")
    return shown, runner.run(samples, input_rows(estimator.model, columns, samples))


@pytest.mark.parametrize("id", QUICK)
def test_the_loop_is_bit_identical_to_plant_then_estimator(id):
    estimator = get(id)
    plant = build(scenario_for(estimator), seed=21)
    model = loop_model(plant.model, estimator.model)
    expected = np.concatenate(one_after_the_other(plant, estimator), axis=1)
    assert np.isfinite(expected).all()
    assert np.array_equal(make_runner(model, parameters(plant, estimator), "interpreter").run(SAMPLES), expected)


@pytest.mark.parametrize("id", ["q-method", "loosely-coupled"])
def test_a_lost_sample_repeats_the_last_that_arrived(id):
    estimator = get(id)
    scenario = scenario_for(estimator)
    scenario = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"drop_probability": 0.4})})
    seen = set()
    for seed in range(6):
        plant = build(scenario, seed=seed)
        shown, found = one_after_the_other(plant, estimator, 60, lost=True)
        seen.add(plant.model.outputs.unpack(shown)["imu_valid"][0])
        model = loop_model(plant.model, estimator.model)
        runner = make_runner(model, parameters(plant, estimator), "interpreter")
        assert np.array_equal(runner.run(60), np.concatenate([shown, found], axis=1))
    assert seen == {0.0, 1.0}  # runs that begin with a lost sample too


def test_conditions_on_inputs_that_the_plant_lacks_are_resolved_when_the_model_is_made():
    plant, ecef_kf = build(load("ship-swaying")).model, get("ecef-kf").model
    steps = loop_model(plant, ecef_kf).steps
    assert ecef_kf.steps["fix"].when == "gnss_valid" and "estimator_fix" not in steps  # there is no receiver
    assert steps["estimator_pair"].when == "estimator_pair_due"
    always = replace(ecef_kf, inputs=derived(ecef_kf.inputs, gnss_valid=1.0))
    assert loop_model(plant, always).steps["estimator_fix"].when is None
    driving = build(load("car-city-drive")).model
    assert loop_model(driving, ecef_kf).steps["estimator_fix"].when == "gnss_valid"
