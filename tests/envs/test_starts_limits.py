"""The limit of an episode is that of its scenario, whatever the episode draws, and that of the unit it draws."""

import gymnasium
import numpy as np
import pytest

import insenv
from insenv.envs.starts import between, episode_limits
from insenv.scenario import load, plant_of

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"


def test_the_limit_is_that_of_the_scenario_at_the_end_or_over_the_episode():
    _, info = gymnasium.make_vec(SHIP, 3, duration_s=10.0, initial_error=None).reset(seed=4)
    assert np.array_equal(info["limit"], np.tile(insenv.limit("ship-swaying", duration_s=10.0).rotation[-1], (3, 1)))
    _, info = gymnasium.make_vec(DRIVE, 2, duration_s=10.0).reset(seed=4)
    found = insenv.limit("car-city-drive", duration_s=10.0).rms(np.arange(1.0, 11.0))
    assert np.array_equal(info["limit"][0], info["limit"][1])
    names = ("vn_mps", "ve_mps", "vd_mps", "north_m", "east_m", "down_m")
    assert info["limit"][0, 3:] == pytest.approx([found[name] for name in names], rel=1e-12)


@pytest.mark.parametrize(("id", "name"), [(SHIP, "ship-swaying"), (DRIVE, "car-city-drive")])
def test_the_limit_of_a_drawn_unit_is_interpolated_to_three_percent(id, name):
    """Units between a marine and a tactical one, against the limit of the unit itself."""
    scenario, task = load(name), gymnasium.make(id).unwrapped.setup.task
    grades = [scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": g})}) for g in ("marine", "tactical")]
    plant = plant_of(scenario)[0]
    bases = tuple(plant.parameters.pack(plant_of(grade)[1]) for grade in grades)
    drawn = between(*bases, np.array([0.003, 0.37, 0.9]), plant.parameters)
    found = episode_limits(task, plant, scenario, bases, 15.0)(drawn)
    for vector, limit in zip(drawn, found, strict=True):
        exact = episode_limits(task, plant, scenario, (vector,), 15.0)(vector[None])[0]
        assert limit == pytest.approx(exact, rel=0.03)
