"""All sensors in one plant: none changes the numbers of another, knowledge has what is told of each."""

import math

import numpy as np
import pytest
from sensor_plant import MODULES

from insenv.core.batch import make_batch
from insenv.core.runner import make_runner
from insenv.geodesy.magnetic import world_magnetic_model
from insenv.instruments import INSTRUMENTS
from insenv.scenario import build, load

EVERY = {id: {} for id in MODULES}


def scenario(**sections):
    """A car that drives, with a receiver that delivers late."""
    return load({
        "title": "Car", "duration_s": 30.0, "rate_hz": 100.0, "seed": 4,
        "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "heading_deg": 30.0},
        "vehicle": {"kind": "car", "legs": [{"accelerate_to_mps": 15.0}, {"turn_deg": 90.0, "radius_m": 40}, {"drive_s": 60}]},
        "imu": {"grade": "tactical"}, "gnss": {"grade": "rtk", "latency_s": 0.2, "lever_arm_m": [1.0, 0.0, -1.0]}, **sections,
    })  # fmt: skip


def outputs(given, backend=None):
    made = build(given)
    return made.model.outputs.unpack(make_runner(made.model, made.parameters, backend).run(made.samples))


def test_instruments_change_no_number_of_the_others() -> None:
    alone, among = outputs(scenario()), outputs(scenario(**EVERY))
    for name, value in alone.items():
        np.testing.assert_array_equal(among[name], value, err_msg=name)
    for id in MODULES:
        assert among[f"{id}_new"].sum() > 25 and np.ptp(among[INSTRUMENTS[id].values[0]]) > 0


@pytest.mark.slow
def test_interpreter_batch_and_native_agree_with_all_instruments() -> None:
    """With a lever arm and a delay that each seed draws, to the bit."""
    gnss = {"grade": "rtk", "latency_s": 0.4, "delay_sigma_s": 0.1, "lever_arm_sigma_m": 0.3}
    given = scenario(**EVERY, duration_s=8.0, gnss=gnss)
    made = build(given)
    batch = make_batch(made.model, 9, {**made.parameters, "seed": 20}, lanes=8, backend="native")
    shown = batch.run(made.samples, every=1)
    for row in (0, 3, 8):
        alone = build(given, seed=20 + row)
        for backend in ("native", "interpreter"):
            np.testing.assert_array_equal(shown[row], make_runner(alone.model, alone.parameters, backend).run(alone.samples))


def test_knowledge_has_what_is_told() -> None:
    odometer = {"lever_arm_m": [0.0, 0.8, 1.0], "mounting_deg": [0, 0, 2]}
    rows = build(scenario(magnetometer={"year": 2027.0}, odometer=odometer)).knowledge.rows
    np.testing.assert_allclose(rows["odometer_lever_arm_b"], [0.0, 0.8, 1.0])
    np.testing.assert_allclose(rows["odometer_mounting"], [0, 0, math.radians(2)])
    assert rows["odometer_scale_factor_sigma"] == pytest.approx(0.01)
    assert rows["odometer_noise"] == pytest.approx(math.hypot(0.05, 0.01 / math.sqrt(12)))
    exact = world_magnetic_model(math.radians(48.0), math.radians(11.0), 500.0, 2027.0)
    np.testing.assert_array_equal(rows["magnetic_field_n"], exact[0])
    np.testing.assert_array_equal(rows["magnetic_field_gradient"], exact[1])
    assert rows["barometer_noise"] == 0.0 and rows["dvl_current_time"] == 600.0, "no such instrument: the start values"
