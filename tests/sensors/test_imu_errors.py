"""The true errors of a unit are those that take its increments back to the truth."""

import numpy as np
import pytest
from sensor_plant import plant

from insenv.core.runner import make_runner
from insenv.sensors.imu import true_unit_errors


def test_what_is_taken_out_of_the_increments_leaves_the_truth():
    """Every error of a unit that is turned in the body, warms up and has no noise."""
    rows = {"q_bs": (0.5, 0.5, -0.5, 0.5), "mounting_error": (0.01, -0.02, 0.03), "imu_temperature_initial": 310.0, "seed": 5}
    for name, size in (("gyro", 1e-3), ("accel", 1e-1)):
        rows |= {f"{name}_{row}": size for row in ("bias", "bias_sigma", "temperature_slope")}
        rows |= {f"{name}_scale_factor_slope": 1e-4}
        rows |= {f"{name}_{row}": 0.02 for row in ("scale_factor", "scale_factor_sigma", "misalignment_sigma")}
    model = plant()
    runner = make_runner(model, rows | {"gnss_interval": 1e9})
    true = np.array([0.02, -0.03, 0.01]), np.array([0.05, 0.01, -0.04])
    inputs = {f"set_{name}": value for name, value in zip(("true_delta_angle", "true_delta_velocity"), true, strict=True)}
    shown = model.outputs.unpack(runner.run(3, np.tile(model.inputs.pack(inputs), (3, 1))))
    parameters = model.parameters.unpack(runner.p)
    found = true_unit_errors(runner.state, parameters)
    assert abs(runner.state["imu_temperature"] - parameters["imu_temperature_reference"]) > 1.0
    for triad, row, exact in (("gyro", "delta_angle", true[0]), ("accel", "delta_velocity", true[1])):
        unbiased = shown[row][-1] - found[f"{triad}_bias"] * parameters["sample_interval"]
        kept = np.eye(3) - np.diag(found[f"{triad}_scale"])  # I - S - M
        kept[~np.eye(3, dtype=bool)] -= found[f"{triad}_misalignment"]
        assert kept @ unbiased == pytest.approx(exact, rel=1e-12)
        assert np.abs(found[f"{triad}_misalignment"]).min() > 1e-3


def test_g_sensitivity_is_in_body_axes():
    """The unit's first axis is the second of the body."""
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    rows = {"q_bs": quarter, "gyro_g_sensitivity": np.diag([1e-4, 2e-4, 3e-4]), "gnss_interval": 1e9}
    runner = make_runner(plant(), rows)
    found = true_unit_errors(runner.state, plant().parameters.unpack(runner.p))["gyro_g_sensitivity"]
    assert found == pytest.approx([2e-4, 1e-4, 3e-4])
