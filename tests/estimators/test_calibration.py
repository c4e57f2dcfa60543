"""Self-calibration on the turntable: what is left of each error of the unit, beside the bound."""

import calibration
import numpy as np
import pytest

from insenv.estimators.fusion.available import AIDS
from insenv.evaluation.limits.bound import bound_of_unit
from insenv.scenario import build, load
from insenv.scenario.limits import prior_of

BOUNDED = set(calibration.UNITS) - {"gyro_g_sensitivity"}  # which the limit knows


@pytest.mark.slow
def test_every_error_of_the_unit_reaches_its_bound():
    """Eight runs: three standard deviations of an rms over 24 values are 43 %."""
    rows = {row["state"]: row for row in calibration.table(runs=8, first_seed=40000)}
    assert set(rows) == BOUNDED
    for row in rows.values():
        assert 0.55 < row["after"] / row["bound"] < 1.45, row
        assert 0.9 < row["stated"] / row["bound"] < 1.5 and row["beyond"] <= 0.03, row
    assert all(row["after"] < 0.2 * row["before"] for name, row in rows.items() if "misalignment" not in name)


def test_the_bound_of_a_unit_at_rest_keeps_what_rest_does_not_show():
    """A level unit at rest: gravity shows the bias and the scale factor of the third accelerometer as one."""
    scenario = load("turntable-calibration")
    scenario = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"legs": ()})})
    plant = build(scenario, duration_s=60.0)
    found = bound_of_unit(plant.model, plant.parameters, prior_of(scenario.knowledge), plant.samples, in_place=True)
    assert set(found) == BOUNDED
    assert found["gyro_scale"] == pytest.approx(np.full(3, 500e-6), rel=1e-3)
    assert found["accel_scale"][:2] == pytest.approx(np.full(2, 300e-6), rel=1e-3)
    # of a sum of 300 ppm and 752 ug, known well, the smaller part stays as it was, but for 7 %
    assert found["accel_scale"][2] == pytest.approx(300e-6 * 752 / np.hypot(300, 752), rel=0.01)


@pytest.mark.slow
def test_half_turns_about_the_vertical_show_the_biases_of_the_level_gyros():
    """At rest the heading hides the bias of the east gyro.  Eight runs: three standard deviations of an rms are 75 %."""
    forward, right, down = calibration.table("turntable-indexing", runs=8, first_seed=40000, apart="gyro_bias")
    for row in (forward, right):
        assert 0.25 < row["after"] / row["bound"] < 1.75 and row["beyond"] == 0.0, row
        assert row["stated"] == pytest.approx(row["bound"], rel=0.05) and row["stated"] < 0.0025
    assert down["stated"] > 0.009  # deg/h of 0.01: turned about its own axis, it does not change

    scenario = load("turntable-indexing")
    still = scenario.model_copy(update={"vehicle": scenario.vehicle.model_copy(update={"legs": ()})})
    plant = build(still)
    found = bound_of_unit(plant.model, plant.parameters, prior_of(still.knowledge), plant.samples, in_place=True)["gyro_bias"]
    level = np.degrees(found[:2]) * 3600.0
    assert np.sqrt(np.mean(level**2)) > 3.0 * forward["bound"]


def test_a_fixed_place_needs_no_instrument():
    assert AIDS["in_place"].sensors == ()
