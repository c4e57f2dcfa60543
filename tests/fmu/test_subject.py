"""What an FMU holds: an estimator, a plant, or both as a loop; settings."""

import numpy as np
import pytest

from insenv.cli.fmu import _settings
from insenv.fmu.reading import read_description
from insenv.fmu.subject import subject


def test_settings_are_start_values(bare):
    settings = {"heading_sigma_deg": 2.0, "antenna_lever_arm": [1.0, 2.0, 3.0], "sample_interval": 0.01}
    what = subject("loosely-coupled", settings)
    rows = what.model.parameters.unpack(what.parameters)
    assert rows["heading_sigma"] == pytest.approx(np.radians(2.0), rel=1e-15)
    read = read_description(bare("loosely-coupled", settings=settings))
    start = {v.name: v.start for v in read.modelVariables}
    assert float(start["parameters.antenna_lever_arm[2]"]) == 2.0
    assert start["dt"] == start["sample_interval"] == "0.01" and read.defaultExperiment.stepSize == "0.01"


def test_settings_of_a_loop_are_those_of_both(bare):
    what = subject("ship-swaying", {"seed": 7, "estimator.latitude": 0.7, "estimator.arw_deg_sqrt_h": 0.01}, "qakf-improved")
    rows = what.model.parameters.unpack(what.parameters)
    assert rows["seed"] == 7.0 and rows["estimator_latitude"] == 0.7
    assert rows["estimator_angle_random_walk"] == pytest.approx(np.radians(0.01) / 60, rel=1e-15)
    read = read_description(bare("ship-swaying", estimator="qakf-improved"))
    tunable = {v.name for v in read.modelVariables if v.variability == "tunable"}
    assert "estimator.parameters.angle_random_walk" in tunable
    assert all(name.startswith("estimator.") for name in tunable)  # the plant is not


def test_states_and_aids_of_an_fmu_are_chosen_as_in_a_run():
    made = subject("fusion", _settings(['fusion.aids=["odometer", "gnss"]', 'states=["odometer_scale"]']))
    assert made.model.title == "16 states: navigation, biases, odometer_scale; aids: gnss, odometer"
    loop = subject("car-odometer", {"estimator.aids": ["gnss"], "estimator.states": []}, "fusion")
    outputs = loop.model.outputs.names
    assert "estimator_odometer_count" not in outputs and "estimator_fix_count" in outputs
