"""Near a pole, where vehicles that steer relative to north cannot be simulated: exact up to 100 m, refused beyond."""

import gymnasium
import numpy as np
import pytest
from driven import columns_of, fed_outputs

import insenv
from insenv.base.errors import InputError
from insenv.estimators import get
from insenv.geodesy import POLAR_RADIUS
from insenv.mavlink.simulation import Simulation
from insenv.scenario import build, load


def ship(latitude_deg=89.995, heading_deg=0.0, duration_s=100.0, speed=6.0, **more):
    return load({
        "title": "near a pole", "duration_s": duration_s, "rate_hz": 20.0, **more,
        "estimators": ["loosely-coupled"], "gnss": {},
        "start": {"latitude_deg": latitude_deg, "longitude_deg": 10.0, "heading_deg": heading_deg},
        "vehicle": {"kind": "ship", "start_speed_mps": speed},
    })  # fmt: skip


@pytest.mark.parametrize(("latitude", "heading", "pole"), [(89.995, 0.0, "north"), (-89.995, 180.0, "south")])
def test_a_course_over_a_pole_is_refused_with_the_time(latitude, heading, pole):
    scenario = ship(latitude, heading)
    time_s = (0.005 * np.pi / 180 * POLAR_RADIUS - 100.0) / 6.0  # at which the way along the meridian has 100 m left
    said = rf"latitude_deg = {latitude:g}, comes within 100 m of the {pole} pole at {time_s:.1f}"[:-1]
    for use in (
        build,
        lambda s: insenv.campaign(s, "loosely-coupled", 2),
        lambda s: insenv.export_fmu(s, "never.fmu"),
        Simulation,
    ):
        with pytest.raises(InputError, match=said):
            use(scenario)
    for away in (ship(duration_s=70.0), ship(heading_deg=180.0), ship(heading_deg=90.0), ship(speed=0.0)):
        assert build(away).samples > 0


def test_an_environment_refuses_a_start_from_which_the_vehicle_may_come_there_and_a_stream_ends_there():
    with pytest.raises(InputError, match=r"is 2\.23 km from the north pole, and in 60 s at up to .* m/s it may come"):
        gymnasium.make("insenv/ShipNavigation-v0", scenario=ship(89.98, heading_deg=180.0), duration_s=60.0)
    gymnasium.make("insenv/ShipNavigation-v0", scenario=ship(89.0, heading_deg=180.0), duration_s=60.0)
    simulation = Simulation(ship(89.9985, duration_s=5.0))
    with pytest.raises(InputError, match=r"comes within 100 m of the north pole at 1[01]\.[0-9]+ s"):
        for _ in range(400):
            simulation.advance()


@pytest.mark.parametrize(("latitude", "heading", "largest"), [(89.98, 90.0, 1e-7), (89.999, 200.0, 1e-5)])
def test_the_truth_is_exact_as_near_as_it_is_allowed(latitude, heading, largest):
    """Against a mechanization in a frame that does not turn at the pole, fed with the increments; m in 60 s."""
    plant = build(ship(latitude, heading, 60.0, rate_hz=100.0, knowledge={"draw_errors": False}))
    shown, free = columns_of(plant), get("wander-sins")
    found = fed_outputs(free.model, shown, free.parameters(plant.knowledge))

    def level(place):  # in the plane of the equator, m
        away = (np.pi / 2 - place["latitude"]) * POLAR_RADIUS
        return np.stack([away * np.cos(place["longitude"]), away * np.sin(place["longitude"])], axis=1)

    assert np.linalg.norm(level(found) - level(shown), axis=1).max() < largest
