"""Magnetometer, barometer and air of the streamed vehicle."""

import numpy as np
import pytest
from pygeomag import GeoMag
from streamed_vehicle import quiet, steps

from insenv import attitude
from insenv.core.runner import make_runner
from insenv.mavlink import Vehicle
from insenv.mavlink.surroundings import air_data
from insenv.scenario import build, load, parse


def test_the_stream_shows_the_instruments_of_the_scenario():
    """As they measure, with the errors that the scenario states, and at their own rates."""
    hard_iron, field = [1000.0, -2000.0, 500.0], [2e4, 0.0, 4e4]
    given = {
        "title": "t", "duration_s": 60.0, "start": {"latitude_deg": 50, "longitude_deg": 8, "height_m": 200.0},
        "vehicle": {"kind": "car"}, "barometer": {"grade": "perfect", "bias_m": 25.0, "interval_s": 0.2},
        "magnetometer": {"grade": "perfect", "hard_iron_nt": hard_iron, "interval_s": 0.1, "field_nt": field},
    }  # fmt: skip
    vehicle = Vehicle(parse(given), "q-method")
    steps(vehicle, 1.0)
    air = vehicle.view.air
    assert vehicle.simulation.readings == {"magnetometer": 10, "barometer": 5}
    np.testing.assert_allclose(air.magnetic_b * 1e9, np.add(field, hard_iron), atol=1e-6)
    assert air.pressure_height == pytest.approx(225.0, abs=1e-9)
    assert vehicle.make("HIGHRES_IMU").xmag == pytest.approx(0.21, abs=1e-6)


def test_without_them_it_has_a_field_of_the_date_and_no_number_of_the_run_changes():
    given = load("car-city-drive")
    vehicle = quiet(start_unix=1.8e9)
    steps(vehicle, 2.0)
    exact = GeoMag().calculate(given.start.latitude_deg, given.start.longitude_deg, given.start.height_m / 1e3, 2027.04)
    C_nb = attitude.numeric.to_dcm(vehicle.simulation.truth["q_nb"])
    np.testing.assert_allclose(C_nb @ vehicle.view.air.magnetic_b * 1e9, [exact.x, exact.y, exact.z], atol=5 * 50.0)
    alone = build(given)
    shown = alone.model.outputs.unpack(make_runner(alone.model, alone.parameters).run(400))
    for name, values in shown.items():
        np.testing.assert_array_equal(vehicle.simulation.truth[name], values[-1], err_msg=name)


@pytest.mark.parametrize("height, pressure, kelvin", [(0.0, 101325.0, 288.15), (10_000.0, 26_436.3, 223.15)])
def test_pressure_is_that_of_the_standard_atmosphere(height, pressure, kelvin):
    """Table of the U.S. Standard Atmosphere, 1976, at geopotential heights; 50 m of undulation."""
    geometric = 6356766.0 * height / (6356766.0 - height)
    truth = {"velocity_n": np.array([100.0, 0, 0]), "height": geometric + 50.0, "barometer_height": geometric + 50.0}
    air = air_data({**truth, "magnetometer_field_b": np.zeros(3)}, 50.0, 1, seed=1)
    assert air.pressure == pytest.approx(pressure, rel=2e-5) and air.temperature == pytest.approx(kelvin, abs=2e-3)
    assert air.pressure_height == pytest.approx(geometric, abs=1e-9)
    assert air.density == pytest.approx(pressure / (287.05287 * kelvin), rel=1e-4)
    assert air.dynamic_pressure == pytest.approx(0.5 * pressure / (287.05287 * kelvin) * 1e4, abs=6.0)  # of 1 Pa of noise
