"""The conformance suite holds for all that insenv ships, and finds what breaks a promise."""

import re
from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import pytest
from places import ROOT

from insenv import run, testing
from insenv.base.errors import InputError
from insenv.base.shipped import ESTIMATORS, SENSORS
from insenv.base.toml import Number, Section, key
from insenv.core.tables import Row, Table
from insenv.estimators import get
from insenv.sensors import registry as sensors
from insenv.vehicles import registry as vehicles

PAGES = ROOT / "docs" / "estimators"
SENSED = {"gnss": {"grade": "spp", "interval_s": 1.0}}
DRIVEN = {
    "ship": {},
    "car": {"legs": [{"wait_s": 1}, {"accelerate_to_mps": 5}, {"turn_deg": 90, "radius_m": 10}]},
    "aircraft": {"legs": [{"fly_s": 3}]},
    "multirotor": {
        "legs": [{"hover_s": 1}, {"fly_s": 3, "forward_mps": 8.0}, {"turn_deg": 180, "duration_s": 4}],
        "engine": [{"frequency_hz": 20.0, "roll_deg": 0.01, "pitch_deg": 0.01, "down_m": 1e-5}],
        "gust_roll_sigma_deg": 1.0, "gust_yaw_sigma_deg": 0.5, "gust_velocity_sigma_mps": 0.3,
    },
    "turntable": {
        "legs": [
            {"duration_s": 3, "heading_deg": 30, "rate_deg_s": 40}, {"duration_s": 5, "roll_deg": 90, "rate_deg_s": 40},
            {"duration_s": 10, "pitch_deg": 340, "rate_deg_s": 60},
        ],
    },
}  # fmt: skip


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("id", ESTIMATORS)
def test_every_estimator(id, compiled):
    testing.check_estimator(id, pages=PAGES, compiled=compiled)


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("id", SENSORS)
def test_every_sensor(id, compiled):
    testing.check_sensor(sensors.get(id), compiled=compiled, **SENSED.get(id, {}))


@pytest.mark.parametrize("compiled", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", DRIVEN)
def test_every_vehicle(kind, compiled):
    testing.check_vehicle(vehicles.get(kind), kind=kind, compiled=compiled, **DRIVEN[kind])


MODEL, STEP = get("analytic").model, get("wander-sins").model.steps["sample"]
ANGLE = MODEL.inputs["delta_angle"]


def with_inputs(*rows):
    """The inputs of the model, of which `rows` replace those of the same names or are added."""
    return {"inputs": Table(tuple({row.name: row for row in (*MODEL.inputs, *rows)}.values()))}


def in_degrees(p, x, u):
    return STEP.function(p, x, SimpleNamespace(**{**vars(u), "delta_angle": u.delta_angle * 57.3}))


@pytest.mark.parametrize(("changes", "promise"), [
    ({"parameters": MODEL.parameters + Table((Row("gain", "Gain."),))}, "row 'gain': meaning = 'Gain.'"),
    ({"parameters": MODEL.parameters + Table((Row("gain", "Gain", "furlong"),))}, "row 'gain': unit = 'furlong'"),
    ({"parameters": MODEL.parameters + Table((Row("arm_b", "Arm", "m", (3,), "n"),))}, "row 'arm_b': frame = 'n'"),
    (
        {"parameters": Table((replace(MODEL.parameters["latitude"], unit="deg"), *list(MODEL.parameters)[1:]))},
        "parameter 'latitude': unit = 'deg': allowed is 'rad', as the start gives it",
    ),
    ({"output": lambda p, x: {**MODEL.output(p, x), "q_nb": ca.SX([2, 0, 0, 0])}}, "q_nb is not of unit norm"),
    (
        {"output": lambda p, x: {**MODEL.output(p, x), "q_nb": ca.sqrt(-(x.first[2] ** 2)) * ca.SX.ones(4)}},
        "output 'q_nb' = nan",
    ),
    ({"output": lambda p, x: {"q_nb": MODEL.output(p, x)["q_nb"]}}, "row 'attitude_sigma' is missing"),
    (with_inputs(replace(ANGLE, unit="deg")), "input 'delta_angle': unit = 'deg': allowed is 'rad', as sensor 'imu' gives"),
    (with_inputs(replace(ANGLE, frame="n")), "input 'delta_angle': frame = 'n': allowed is 'b', as sensor 'imu' gives it"),
    (with_inputs(Row("gnss_valdi", "Misspelt")), "input 'gnss_valdi': nothing feeds it; did you mean 'gnss_valid'"),
    ({"steps": {"sample": replace(STEP, function=in_degrees)}}, "input 'delta_angle': q_nb changes by 57.3 times"),
])  # fmt: skip
def test_an_estimator_that_breaks_a_promise_is_found(changes, promise):
    whole = get("wander-sins" if "steps" in changes else "analytic")
    broken = replace(whole, model=replace(whole.model, id="broken", **changes))
    with pytest.raises(AssertionError, match=f"'broken'.*{re.escape(promise)}"):
        testing.check_estimator(broken, "static-ecef", compiled=False)
    if "inputs" in changes or promise.startswith("parameter"):
        with pytest.raises(InputError, match=f"'broken'.*{re.escape(promise)}"):
            run("static-ecef", broken, duration_s=2.0)


def test_an_estimator_that_runs_on_no_scenario_is_found_with_the_reason():
    with pytest.raises(AssertionError, match=r"needs lidar.*has no \[lidar\].*the other \d+ scenarios"):
        testing.check_estimator(replace(get("analytic"), sensors=("lidar",)))


def test_a_sensor_is_checked_by_its_id_and_what_is_none_is_named():
    testing.check_sensor("barometer", compiled=False)
    testing.check_sensor(sensors.instrument("barometer"), compiled=False)
    for check, wrong, allowed in (
        (testing.check_sensor, int, "<class 'int'>: allowed is the class of a sensor's section, an instrument or its id"),
        (testing.check_vehicle, "car", "'car': allowed is the class of a vehicle's section"),
        (testing.check_keys, "x", "'x': allowed is the class of a section"),
    ):
        with pytest.raises(AssertionError, match=re.escape(allowed)):
            check(wrong)
    with pytest.raises(InputError, match="did you mean 'barometer'"):
        testing.check_sensor("baromter")


class Keyed(Section):
    """Keys."""

    rate: Number = key(1.0, "rate", "Hz", gt=0)
    bare: float = 1.0


def test_a_section_without_meanings_is_found():
    with pytest.raises(AssertionError, match=r"Keyed\.bare has no meaning"):
        testing.check_keys(Keyed)
    with pytest.raises(AssertionError, match="rate"):
        testing.check_keys(Keyed, rate=-1.0)
