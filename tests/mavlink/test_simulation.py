"""The live simulation: agreement with `insenv run`, lost samples, a receiver that is off, new alignments."""

import numpy as np
import pytest
from changed_scenario import changed
from streamed_vehicle import ACCEPTED, DENIED, command, quiet, steps, texts

from insenv import attitude, run
from insenv.base.errors import InputError
from insenv.mavlink import Simulation
from insenv.scenario import load


@pytest.mark.parametrize("scenario, estimator, samples", [
    ("car-city-drive", "loosely-coupled", 1000),
    ("ship-swaying", "qakf", 1000),
    pytest.param("car-odometer", "fusion", 500, marks=pytest.mark.slow),
])  # fmt: skip
def test_estimates_are_those_of_a_run(scenario, estimator, samples):
    result = run(load(scenario), [estimator], duration_s=5.0).results[0]
    vehicle, found = quiet(scenario, estimator=estimator), []
    for _ in range(samples):
        vehicle.step()
        found.append(vehicle.simulation.estimate["q_nb"].copy())
    every = round(samples / len(result.time))
    np.testing.assert_array_equal(np.array(found)[every - 1 :: every], result.outputs["q_nb"])
    assert vehicle.simulation.time == pytest.approx(result.time[-1])


def test_a_lost_sample_is_bridged_by_the_one_before():
    vehicle = quiet()
    vehicle.parameters.all[vehicle.parameters.find("S_IMU_DROP_PROB")].set(0.2)
    simulation, truth = vehicle.simulation, vehicle.simulation.truth
    before = simulation.increments.copy()
    for _ in range(400):
        held = simulation.last_increment.copy()
        vehicle.step()
        shown = held if not truth["imu_valid"] else np.concatenate([truth["delta_angle"], truth["delta_velocity"]])
        np.testing.assert_array_equal(simulation.last_increment, shown)
        np.testing.assert_allclose(simulation.increments - before, shown, rtol=0, atol=1e-12)
        before = simulation.increments.copy()
    assert 40 < simulation.bridged < 130


def test_a_stuck_axis_repeats_its_latest_value_until_it_is_freed():
    vehicle, twin = quiet(hz=20), quiet(hz=20)
    simulation = vehicle.simulation
    steps(vehicle, 1.0)
    held = simulation.last_increment.copy()
    assert command(vehicle, 420, 0.0, 2.0, 3.0)[0] == ACCEPTED and command(vehicle, 420, 1.0, 2.0, 0.0)[0] == ACCEPTED
    assert texts(vehicle)[-2:] == ["axis 3 of the gyros: stuck", "accelerometers: stuck"] and simulation.changed
    steps(vehicle, 1.0)
    steps(twin, 2.0)
    np.testing.assert_array_equal(simulation.last_increment, [*twin.simulation.last_increment[:2], *held[2:]])
    assert command(vehicle, 420, 0.0, 0.0, 0.0)[0] == command(vehicle, 420, 1.0, 0.0, 0.0)[0] == ACCEPTED
    assert not simulation.stuck.any()
    for wrong in ((4.0, 2.0, 0.0), (0.0, 1.0, 0.0), (0.0, 2.0, 4.0), (0.0, 2.0, 0.5), (float("nan"), 2.0, 0.0)):
        assert command(vehicle, 420, *wrong)[0] == DENIED and "allowed is" in texts(vehicle)[-1]
    assert not simulation.stuck.any()


@pytest.mark.parametrize(("estimator", "message"), [("smoother", "loosely-coupled"), ("q-method", "in place")])
def test_estimators_that_cannot_run_live_are_refused(estimator, message):
    with pytest.raises(InputError, match=message):
        Simulation(load("car-city-drive"), estimator)


def test_a_receiver_that_is_off_is_an_outage_to_the_estimator():
    """The estimate is bit-identical to that of an outage window of the scenario."""
    cut = quiet(hz=20)
    steps(cut, 5.5)
    cut.set_gnss(False)
    steps(cut, 4.0)
    other = quiet(changed("car-city-drive", gnss={"outages_s": ((5.5, 9.5),)}), hz=20)
    steps(other, 9.5)
    np.testing.assert_array_equal(cut.simulation.estimate["q_nb"], other.simulation.estimate["q_nb"])
    assert float(cut.simulation.estimate["height"]) == float(other.simulation.estimate["height"])


def test_a_new_alignment_starts_with_the_errors_of_the_first():
    vehicle = quiet(hz=20)
    simulation, truth, estimate = vehicle.simulation, vehicle.simulation.truth, vehicle.simulation.estimate

    def error():
        return np.linalg.norm(attitude.numeric.error_rotation_vector(estimate["q_nb"], truth["q_nb"]))

    first = error()
    steps(vehicle, 60.0)
    assert np.hypot(*truth["velocity_n"][:2]) > 5
    assert command(vehicle, 31010)[0] == ACCEPTED and simulation.alignments == 2
    assert error() == pytest.approx(first, rel=0.2) and error() > 1e-3
    assert np.linalg.norm(estimate["velocity_n"] - truth["velocity_n"]) < 1.0
    steps(vehicle, 30.0)
    assert vehicle.view.state == "navigating"
