"""All sensors in one plant: none changes the numbers of another, knowledge has what is told of each."""

import math

import numpy as np
import pytest
from driven import columns_of
from sensor_plant import INSTRUMENTS

from insenv.geodesy.magnetic import world_magnetic_model
from insenv.scenario import build, load
from insenv.sensors.registry import instruments

LEGS = [{"accelerate_to_mps": 15.0}, {"turn_deg": 90.0, "radius_m": 40}, {"drive_s": 60}]


def scenario(*instruments, **sections):
    car = load("car-city-drive").model_dump(mode="json", exclude_unset=True)
    gnss = {"grade": "rtk", "latency_s": 0.4, "delay_sigma_s": 0.1, "lever_arm_sigma_m": 0.3}
    vehicle = {"kind": "car", "legs": LEGS}
    return load({**car, "rate_hz": 100.0, "vehicle": vehicle, "gnss": gnss, **{id: {} for id in instruments}, **sections})


def test_instruments_change_no_number_of_the_others() -> None:
    alone, among = (columns_of(build(scenario(*ids), duration_s=30.0)) for ids in ((), INSTRUMENTS))
    for name, value in alone.items():
        np.testing.assert_array_equal(among[name], value, err_msg=name)
    for id in INSTRUMENTS:
        assert among[f"{id}_new"].sum() > 25 and np.ptp(among[instruments()[id].values[0].name]) > 0


def test_knowledge_has_what_is_told() -> None:
    odometer = {"lever_arm_m": [0.0, 0.8, 1.0], "mounting_deg": [0, 0, 2]}
    made = build(scenario(magnetometer={"year": 2027.0}, odometer=odometer))
    rows, start = made.knowledge.rows, made.scenario.start
    np.testing.assert_allclose(rows["odometer_lever_arm_b"], [0.0, 0.8, 1.0])
    np.testing.assert_allclose(rows["odometer_mounting"], [0, 0, math.radians(2)])
    assert rows["odometer_scale_factor_sigma"] == pytest.approx(0.01)
    assert rows["odometer_noise"] == pytest.approx(math.hypot(0.05, 0.01 / math.sqrt(12)))
    place = math.radians(start.latitude_deg), math.radians(start.longitude_deg), start.height_m
    field, gradient = world_magnetic_model(*place, 2027.0)
    np.testing.assert_array_equal(rows["magnetic_field_n"], field)
    np.testing.assert_array_equal(rows["magnetic_field_gradient"], gradient)
    assert "barometer_noise" not in rows and "dvl_current_time" not in rows, "no such instrument"
