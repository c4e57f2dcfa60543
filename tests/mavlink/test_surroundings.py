"""Magnetometer, barometer and air of the streamed vehicle; jamming and spoofing of its receiver."""

from math import nan

import numpy as np
import pytest
from pygeomag import GeoMag
from streamed_vehicle import ACCEPTED, DENIED, command, quiet, steps, texts

from insenv import attitude, geodesy
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


def fixes_and_errors(vehicle, twin, seconds):
    """The fixes delivered in `seconds` to a vehicle and to an undisturbed twin, and how far they are apart (3, m, n)."""
    for _ in range(round(seconds / vehicle.simulation.interval)):
        before = vehicle.simulation.fixes
        vehicle.step(), twin.step()
        if vehicle.simulation.fixes > before:
            fix, clean = vehicle.simulation.fix, twin.simulation.fix
            place = (clean.latitude, clean.longitude, clean.height)
            moved = np.ravel(geodesy.numeric.ned_offset(fix.latitude, fix.longitude, fix.height, *place))
            yield vehicle.simulation.time, moved, fix, clean


def test_spoofing_and_drift_displace_the_fixes():
    vehicle, twin = quiet(hz=20), quiet(hz=20)
    steps(vehicle, 10.5), steps(twin, 10.5)
    assert command(vehicle, 31014, 2.0, 3.0, -4.0, 1.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: spoofing"
    for _, moved, fix, clean in fixes_and_errors(vehicle, twin, 5.0):
        np.testing.assert_allclose(moved, [3.0, -4.0, 1.0], atol=1e-3)
        np.testing.assert_array_equal(fix.position_sigma, clean.position_sigma)  # the receiver does not notice
    begun = vehicle.simulation.time
    assert command(vehicle, 31014, 3.0, 0.0, 0.5, 0.0)[0] == ACCEPTED
    for time, moved, fix, clean in fixes_and_errors(vehicle, twin, 5.0):
        np.testing.assert_allclose(moved, [0.0, 0.5 * (time - begun), 0.0], atol=1e-3)
        np.testing.assert_allclose(fix.velocity_n - clean.velocity_n, [0.0, 0.5, 0.0], atol=1e-12)
    assert vehicle.simulation.fixes == 20
    assert command(vehicle, 31014, 0.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: undisturbed"
    assert [np.any(moved) for _, moved, _, _ in fixes_and_errors(vehicle, twin, 3.0)] == [False] * 3


def test_jamming_loses_fixes_and_lost_satellites_make_them_worse():
    jammed, again, few = (quiet(hz=20) for _ in range(3))
    for vehicle in (jammed, again):
        assert command(vehicle, 31014, 1.0, 0.5)[0] == ACCEPTED
        steps(vehicle, 100.0)
    assert 30 < jammed.simulation.fixes < 70
    before = again.simulation.fixes
    assert jammed.simulation.fixes == before  # a function of seed and fix number
    command(jammed, 31014, 1.0, 1.0)
    steps(jammed, 5.0)
    assert jammed.simulation.fixes == before and not jammed.view.has_lock
    assert command(few, 31014, 4.0, 10.0)[0] == ACCEPTED
    found = list(fixes_and_errors(few, quiet(hz=20), 60.0))
    for _, _, fix, clean in found:
        np.testing.assert_allclose(fix.position_sigma, 10.0 * clean.position_sigma)
    scaled = np.array([moved / (np.sqrt(99.0) * clean.position_sigma) for _, moved, _, clean in found])
    assert 0.8 < np.std(scaled) < 1.2 and len(found) >= 58


def test_wrong_interference_is_refused():
    vehicle = quiet()
    for values in ((5.0,), (1.0, 1.5), (2.0, 1e9), (4.0, 0.5), (3.0, 1.0, nan)):
        assert command(vehicle, 31014, *values)[0] == DENIED and vehicle.simulation.interference is None, values
        assert "allowed is" in texts(vehicle)[-1]
    assert command(quiet("ship-swaying"), 31014, 1.0, 1.0)[0] == DENIED
