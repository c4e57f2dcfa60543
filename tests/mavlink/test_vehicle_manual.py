"""The streamed vehicle is driven by the sticks of a client."""

import numpy as np
import pytest
from streamed_vehicle import answered, quiet, sent, steps, texts

from insenv.mavlink.vehicle import AXIS_UNUSED, Sticks
from insenv.scenario import build, load
from insenv.vehicles import AircraftSection, CarSection, ShipSection


def steer(vehicle, x, y, z, r):
    assert not answered(vehicle, sent("MANUAL_CONTROL", 1, x, y, z, r, 0))


def test_a_car_is_driven_by_manual_control_and_stops_without_it():
    vehicle = quiet(hz=40)
    scale, truth, said = vehicle.sticks.full_scale, vehicle.simulation.truth, []
    for _ in range(80):  # 10 s at 8 Hz
        steer(vehicle, 0, 0, 600, 500)
        said += steps(vehicle, 0.125)
    assert np.hypot(*truth["velocity_n"][:2]) == pytest.approx(0.6 * scale["SPEED"], rel=0.02)
    rates = []
    for _ in range(40):
        said += vehicle.step()
        rates.append(np.degrees(float(vehicle.view.values["true_rate_nb_b"][2])))
    assert abs(np.mean(rates) - 0.5 * scale["TURN"]) < 0.5
    said += steps(vehicle, 12.0)
    assert np.hypot(*truth["velocity_n"][:2]) < 0.05
    assert [m.text for m in said] == ["manual control: the script has ended", "manual control lost"]


@pytest.mark.parametrize(
    ("scenario", "why"), [("ship-swaying", "aligning in place"), ("large-misalignment", "motion is prescribed")]
)
def test_vehicles_that_cannot_be_steered_announce_it_once(scenario, why):
    vehicle = quiet(scenario)
    for _ in range(5):
        steer(vehicle, 0, 0, 1000, 0)
    assert texts(vehicle) == [f"no manual control: {why}"]


def test_missing_axes_command_nothing():
    car, ship, aircraft = (Sticks(section.traits.sticks) for section in (CarSection, ShipSection, AircraftSection))
    assert car.commanded(0, AXIS_UNUSED, AXIS_UNUSED, AXIS_UNUSED) == {}
    assert car.commanded(0, 500, 0, 0) == {"speed": 0.0, "yaw_rate": pytest.approx(np.radians(10.0))}
    assert ship.commanded(0, 500, -300, -1000) == {"speed": 0.0, "turn_rate": pytest.approx(-np.radians(3.0))}
    full = {"speed": 80.0, "bank": pytest.approx(np.radians(30.0)), "climb_rate": 5.0}
    assert aircraft.commanded(-32768, 32766, 9999, 0) == full
    assert aircraft.released() == {"bank": 0.0, "climb_rate": 0.0} and car.released() == {"speed": 0.0, "yaw_rate": 0.0}


def test_every_stick_command_is_a_command_of_its_vehicle():
    for scenario in ("ship-underway", "car-city-drive", "aircraft-survey"):
        plant = build(load(scenario))
        commands = {f"command_{stick.command}" for stick in plant.scenario.vehicle.traits.sticks}
        assert commands <= set(plant.model.inputs.names)
