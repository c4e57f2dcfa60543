"""Scenarios: loading, checks, plants, initial conditions, tuning, schema."""

from __future__ import annotations

import copy
import datetime
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from places import ROOT

from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.estimators import registry
from insenv.files.resources import scenario_folder
from insenv.scenario import build, json_schema, load, names, parse, summaries, tuning
from insenv.scenario.sensor_notes import CONSTANT

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

IN_PLACE = {
    "ship-swaying", "ship-irregular-sea", "car-parked", "aircraft-parked", "static-ecef", "turntable-quaternion",
    "large-misalignment", "large-misalignment-extreme", "large-misalignment-training", "ship-moored-paper", "car-parked-paper",
    "turntable-calibration", "turntable-indexing",
}  # fmt: skip
DEG = math.pi / 180.0


def text_of(name: str) -> str:
    return (scenario_folder() / f"{name}.toml").read_text(encoding="utf-8")


def data_of(name: str) -> dict[str, Any]:
    return tomllib.loads(text_of(name))


# --- the scenarios of insenv ------------------------------------------------------------------------


def test_the_list_of_scenarios() -> None:
    assert IN_PLACE | {
        "ship-underway", "car-city-drive", "aircraft-survey", "aircraft-free-inertial", "aircraft-inflight-alignment",
        "car-unknown-heading", "car-odometer", "car-survey", "car-unknown-receiver", "multirotor-hover", "ship-dvl",
        "ship-at-sea", "ship-log-alignment",
    } == set(names())  # fmt: skip


@pytest.mark.parametrize("name", names())
def test_each_scenario_builds_and_runs(name: str) -> None:
    scenario = load(name)
    plant = build(scenario, duration_s=2.0)
    runner = make_runner(plant.model, plant.parameters, backend="interpreter")
    outputs = plant.model.outputs.unpack(runner.run(plant.samples))
    assert all(np.isfinite(values).all() for values in outputs.values())
    assert outputs["time"][-1] == pytest.approx(2.0)
    assert plant.samples == round(2.0 * scenario.rate_hz) and plant.sample_interval == 1.0 / scenario.rate_hz
    assert scenario.name == name and text_of(name).startswith("#:schema ./schema.json\n")
    assert plant.in_place == (name in IN_PLACE) and ("gnss" in plant.sensors) == (scenario.gnss is not None)
    assert scenario.estimators and all(registry.get(id) for id in scenario.estimators)
    for id in scenario.estimators:
        estimator = plant.adapted(registry.get(id))
        rows = plant.parameters_of(estimator)
        estimator.model.parameters.pack(rows)
        assert set(estimator.sensors) <= set(plant.sensors)


def test_summaries() -> None:
    rows = {row["name"]: row for row in summaries()}
    assert list(rows) == names()
    assert rows["ship-swaying"] == {
        "name": "ship-swaying", "title": "Moored ship in a regular sway", "vehicle": "ship", "duration_s": 300.0,
        "rate_hz": 200.0, "gnss": False, "estimators": ["q-method"],
    }  # fmt: skip


def test_parked_vehicles_start_at_their_place_and_stay_there() -> None:
    for name in ("car-parked", "aircraft-parked"):
        plant = build(load(name), duration_s=150.0)
        runner = make_runner(plant.model, plant.parameters)
        start = load(name).start
        assert runner.state["latitude"] == pytest.approx(start.latitude_deg * DEG)
        out = plant.model.outputs.unpack(runner.run(plant.samples, every=100))
        north = geodesy.numeric.ned_offset(
            out["latitude"],
            out["longitude"],
            out["height"],
            start.latitude_deg * DEG,
            start.longitude_deg * DEG,
            start.height_m,
        )
        assert np.abs(north).max() < 1.0
        assert np.ptp(np.array(attitude.numeric.to_euler(out["q_nb"]))[0]) > 1e-4


def test_equal_structures_share_a_model() -> None:
    swaying, turntable = build(load("ship-swaying")), build(load("turntable-quaternion"))
    changed = data_of("ship-swaying")
    changed["vehicle"]["sway"]["roll"][0]["period_s"] = 7.0
    changed["imu"]["grade"] = "consumer"
    assert build(parse(changed)).model is swaying.model
    assert turntable.model is not swaying.model
    assert build(load("car-parked")).model is not build(load("static-ecef")).model  # other numbers of engine waves


def test_static_ecef_has_the_numbers_of_the_paper() -> None:
    plant = build(load("static-ecef"), duration_s=1.0)
    np.testing.assert_allclose(plant.parameters["gyro_bias"], 0.002 * DEG / 3600)
    np.testing.assert_allclose(plant.parameters["accel_bias"], 2e-4)
    assert not np.any(plant.parameters["angle_random_walk"])
    out = make_runner(plant.model, plant.parameters, backend="interpreter").run(1)
    np.testing.assert_allclose(plant.model.outputs.unpack(out)["q_nb"][0], [1, 0, 0, 0], atol=1e-15)
    known = plant.knowledge
    np.testing.assert_allclose(np.degrees([known.roll, known.pitch, known.heading]), [0.1, 0.1, 1.0])
    assert known.latitude == pytest.approx(45 * DEG, abs=1e-15) and not np.any(known.velocity_n)


def test_turntable_is_that_of_the_paper_in_other_axes() -> None:
    """The attitude of the paper in its own axes (right, forward, up; counter-clockwise heading), made with scipy."""
    from scipy.spatial.transform import Rotation

    plant = build(load("turntable-quaternion"), duration_s=3.0)
    runner = make_runner(plant.model, plant.parameters, backend="interpreter")
    q = plant.model.outputs.unpack(runner.run(plant.samples))["q_nb"][-1]
    t = 3.0
    pitch, roll, heading = (a * math.sin(2 * math.pi * f * t) + c for a, f, c in ((8, 0.15, 0), (6, 0.2, 0), (5, 0.125, 45)))
    enu = Rotation.from_euler("ZXY", [heading, pitch, roll], degrees=True).as_matrix()
    swap = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # east-north-up to north-east-down, right-forward-up to FRD
    np.testing.assert_allclose(attitude.numeric.to_dcm(q), swap @ enu @ swap, atol=1e-12)
    np.testing.assert_allclose(swap @ [0.01, 0.01, 0.01], plant.parameters["gyro_bias"] / DEG * 3600)


def test_survey_has_its_outages_on_the_lines() -> None:
    plant = build(load("aircraft-survey"))
    begin = np.cumsum(plant.parameters["segments"][:, 0])[6 + 1]  # wait, taxi, turn (2), take-off, on, climb (2)
    assert begin == pytest.approx(1000.0, abs=1.0)
    np.testing.assert_allclose(plant.parameters["gnss_outage_start"][:4], 1000.0 + 60.0 * np.array([1, 4, 7, 10]))
    length = plant.parameters["gnss_outage_end"] - plant.parameters["gnss_outage_start"]
    np.testing.assert_allclose(length, 60.0 * (np.arange(16) < 4))


# --- initial conditions ----------------------------------------------------------------------------


def _true_start(plant: Any) -> dict[str, Any]:
    return make_runner(plant.model, plant.parameters, backend="interpreter").state


def _known_minus_true(plant: Any) -> np.ndarray:
    """Errors of roll, pitch, heading (rad), position (m), velocity (m/s)."""
    true, known = _true_start(plant), plant.knowledge
    angles = np.array([known.roll, known.pitch, known.heading]) - np.array(attitude.numeric.to_euler(true["q_nb"]))
    position = geodesy.numeric.ned_offset(
        known.latitude, known.longitude, known.height, true["latitude"], true["longitude"], true["height"]
    )
    return np.concatenate([angles, position, known.velocity_n - true["velocity_n"]])


def test_start_errors_given() -> None:
    data = data_of("ship-swaying")
    data["knowledge"] = {
        "roll_error_deg": 1.0, "pitch_error_deg": -2.0, "heading_error_deg": 60.0, "position_error_m": [10.0, -20.0, 5.0],
        "velocity_error_mps": [0.1, 0.2, -0.3], "heading_sigma_deg": 70.0, "position_sigma_m": 30.0,
    }  # fmt: skip
    plant = build(parse(data), seed=5)
    expected = [1 * DEG, -2 * DEG, 60 * DEG, 10, -20, 5, 0.1, 0.2, -0.3]
    np.testing.assert_allclose(_known_minus_true(plant), expected, rtol=1e-9, atol=1e-8)
    assert np.linalg.norm(_true_start(plant)["velocity_n"]) > 0.5  # the ship sways at time 0
    assert plant.knowledge.heading_sigma == pytest.approx(70 * DEG)
    np.testing.assert_array_equal(plant.knowledge.position_sigma, [30.0] * 3)


def test_start_errors_drawn() -> None:
    data = data_of("ship-irregular-sea")
    sigma = {"tilt_sigma_deg": 2.0, "heading_sigma_deg": 5.0, "position_sigma_m": [1.0, 2.0, 4.0], "velocity_sigma_mps": 0.5}
    data["knowledge"] = sigma
    scenario = parse(data)
    errors = np.array([_known_minus_true(build(scenario, seed=seed)) for seed in range(200)])
    unit = errors / np.array([2 * DEG, 2 * DEG, 5 * DEG, 1, 2, 4, 0.5, 0.5, 0.5])
    assert np.abs(unit.mean(0)).max() < 0.3 and np.abs(unit.std(0) - 1).max() < 0.2
    assert np.abs(np.corrcoef(unit.T) - np.eye(9)).max() < 0.3
    # one of them given changes no other; the same seed gives the same
    data["knowledge"] = {**sigma, "pitch_error_deg": 1.0}
    other = _known_minus_true(build(parse(data), seed=7))
    np.testing.assert_allclose(np.delete(other, 1), np.delete(errors[7], 1), atol=1e-12)
    assert other[1] == pytest.approx(1 * DEG)
    data["knowledge"] = {"draw_errors": False}
    np.testing.assert_allclose(_known_minus_true(build(parse(data), seed=7)), 0.0, atol=1e-8)


def test_sensor_notes() -> None:
    data = data_of("ship-swaying")
    notes = build(parse(data)).knowledge.sensors
    assert notes.angle_random_walk == pytest.approx(0.002 * DEG / 60)
    assert notes.gyro_bias_sigma == pytest.approx(0.001 * DEG / 3600) and notes.gyro_correlation_time == pytest.approx(CONSTANT)
    assert notes.accel_bias_sigma == pytest.approx(10e-6 * 9.80665)
    data["imu"] = {"grade": "leador"}  # moored: the scale factor acts on the vertical only
    notes = build(parse(data)).knowledge.sensors
    assert notes.gyro_bias_sigma == pytest.approx(0.027 * DEG / 3600) and notes.gyro_correlation_time == pytest.approx(4 * 3600)
    assert notes.accel_bias_sigma == pytest.approx(15e-5)
    del data["imu"]
    notes = build(parse(data)).knowledge.sensors
    proportional = ("_scale_sigma", "_misalignment_sigma", "_sensitivity_sigma")  # a perfect unit has none
    assert all(value > 0.0 for name, value in vars(notes).items() if not name.endswith(proportional))


def test_the_data_sheet_has_the_thermal_errors_of_the_run() -> None:
    """A unit that warms by 30 K is as uncertain as its slopes make it; at the temperature of reference nothing changes."""
    data = data_of("car-city-drive")
    data["imu"] |= {"gyro_temperature_slope_deg_h_k": -10.0, "accel_scale_factor_slope_ppm_k": 50.0}
    plain, known = (build(parse(each)).knowledge for each in (data_of("car-city-drive"), data))
    assert {n: v for n, v in vars(known.sensors).items() if n in vars(plain.sensors)} == vars(plain.sensors)
    assert (known.rotation_error, known.thrust_error) == (plain.rotation_error, plain.thrust_error)
    data["imu"] |= {"temperature_end_degc": 50.0}
    warm = build(parse(data)).knowledge
    bias, scale = 300.0 * DEG / 3600, 50e-6 * 30.0
    assert warm.sensors.gyro_bias_sigma == pytest.approx(np.hypot(plain.sensors.gyro_bias_sigma, bias))
    assert warm.sensors.accel_scale_sigma == pytest.approx(np.hypot(plain.sensors.accel_scale_sigma, scale))
    assert warm.thrust_error == pytest.approx(np.hypot(plain.thrust_error, scale))
    assert warm.sensors.gyro_correlation_time < 650.0
    data["imu"] |= {"temperature_end_degc": 20.0, "temperature_ramp_k_h": 30.0}
    ramped = build(parse(data)).knowledge
    assert ramped.sensors.gyro_bias_sigma == pytest.approx(np.hypot(plain.sensors.gyro_bias_sigma, bias))


def test_a_known_mounting_turns_what_belongs_to_the_sensor_alone() -> None:
    """A unit that lies on its side reads the body's motion in body axes; its bias is that of its own axis."""
    data = data_of("static-ecef")
    data["imu"] = {"grade": "perfect", "accel_bias_ug": [0.0, 100.0, 0.0], "mounting_angles_deg": [90.0, 0.0, 0.0]}
    plant = build(parse(data), duration_s=1.0)
    shown = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(10))
    force = shown["delta_velocity"] / plant.sample_interval
    up = -9.80665e-4 * np.array([0.0, 0.0, -1.0])  # the sensor's y axis points down
    np.testing.assert_allclose(force - shown["true_delta_velocity"] / plant.sample_interval, np.tile(up, (10, 1)), atol=1e-12)


def test_noise_density_and_noise_per_sample() -> None:
    data = data_of("ship-swaying")
    data["rate_hz"] = 100.0
    data["imu"] = {"grade": "paper-quaternion", "gyro_arw_deg_sqrt_h": 0.01, "accel_white_ug": 30.0}
    rows = build(parse(data)).parameters
    np.testing.assert_allclose(rows["angle_random_walk"], 0.01 * DEG / 60)  # and not the grade's white noise
    np.testing.assert_allclose(rows["velocity_random_walk"], 30e-6 * 9.80665 * 0.1)  # per sample of this scenario
    data["imu"] = {"grade": "paper-quaternion", "gyro_bias_deg_h": [1.0, 2.0, 3.0]}
    rows = build(parse(data)).parameters
    np.testing.assert_allclose(rows["velocity_random_walk"], 50e-6 * 9.80665 / math.sqrt(200))  # per sample of the paper
    np.testing.assert_allclose(rows["gyro_bias"], np.array([1, 2, 3]) * DEG / 3600)


# --- bad input -------------------------------------------------------------------------------------

CAR, SHIP, PLANE = "car-city-drive", "ship-swaying", "aircraft-survey"


@pytest.mark.parametrize(
    ("name", "old", "new", "expected"),
    [
        (CAR, "duration_s = 900.0", "duration_s = 0", "duration_s = 0 [s]: must be greater than 0"),
        (CAR, "duration_s = 900.0", "duration_s = 1e9", "duration_s = 1000000000.0 [s]: must be less than or equal to 86400"),
        (CAR, "duration_s = 900.0", "duration_s = 1e-4", "duration_s = 0.0001 s is shorter than one sample of 0.005 s"),
        (CAR, "duration_s = 900.0", "", "duration_s is missing: duration [s]"),
        (
            CAR,
            "latitude_deg = 47.07",
            "latitude_deg = 95",
            "start.latitude_deg = 95 [deg]: must be less than or equal to 89.999",
        ),
        (CAR, "latitude_deg = 47.07", "latitude_deg = nan", "start.latitude_deg = nan [deg]: must be a finite number"),
        (CAR, "[imu]", "[imu]\ngyro_arw_deg_sqrt_h = -1.0", "imu.gyro_arw_deg_sqrt_h = -1.0 [deg/sqrt(h)]: must be greater"),
        (CAR, "[imu]", "[imu]\ngyro_arw = 1.0", "imu.gyro_arw: unknown key; did you mean 'gyro_arw_deg_sqrt_h'?"),
        (CAR, "[imu]", "[imu]\naccel_white_ug = 3\naccel_vrw_ug_sqrt_hz = 3", "which describe the same noise"),
        (
            CAR,
            "[imu]",
            "[imu]\ngyro_bias_deg_h = 'x'",
            "imu.gyro_bias_deg_h = 'x' [deg/h]: must be a number, or a list of three",
        ),
        (CAR, "[gnss]", "[gnss]\nposition_noise_m = [1.0, -1.0, 1.0]", "[m]: each must be from 0 to 100000"),
        (CAR, "seed = 1", "sed = 1", "sed: unknown key; did you mean 'seed'?"),
        (
            CAR,
            "[gnss]",
            "[gnss]\nduration_s = 60",
            "gnss.duration_s: unknown key; it belongs at the top of the file",
        ),
        (CAR, "seed = 1", "latitude_deg = 45", "latitude_deg: unknown key; it belongs in [start]"),
        (CAR, "seed = 1", "seed = 1.5", "seed = 1.5: must be a whole number"),
        (CAR, "seed = 1", "seed = -1", "seed = -1: must be greater than or equal to 0"),
        (CAR, "rate_hz = 200.0", "rate_hz = '200'", "rate_hz = '200' [Hz]: must be a number"),
        (
            CAR,
            "rate_hz = 200.0",
            "rate_hz = 170.5",
            "gnss.interval_s = 1 s: allowed is a whole number of samples of 0.0058651 s",
        ),
        (CAR, "latency_s = 0.05", "latency_s = 1.0", "gnss.latency_s = 1 s: allowed is less than gnss.interval_s = 1 s"),
        (CAR, "latency_s = 0.05", "latency_s = 0.051", "gnss.latency_s = 0.051 s: allowed is a whole number of samples"),
        (
            CAR,
            "epoch_offset_s = 0.002",
            "epoch_offset_s = 0.006",
            "gnss.epoch_offset_s = 0.006 s: allowed is from 0 to less than",
        ),
        (CAR, "[200.0, 230.0]", "[200.0, 130.0]", "the outage from 200 s to 130 s must begin at 0 or later"),
        (CAR, "[200.0, 230.0]", "[200.0]", "gnss.outages_s[0] = [200.0] [s]: must be a list of two"),
        (CAR, 'kind = "car"', 'kind = "boat"', "vehicle.kind = 'boat': must be one of 'ship', 'car', 'aircraft'"),
        (CAR, 'kind = "car"', "", "vehicle.kind is missing: must be one of 'ship', 'car', 'aircraft'"),
        (CAR, 'grade = "tactical"', 'grade = "tactcal"', "IMU grade 'tactcal': unknown; did you mean 'tactical'?"),
        (CAR, 'grade = "spp"', 'grade = "ssp"', "GNSS grade 'ssp': unknown; did you mean 'spp'?"),
        (CAR, '["loosely-coupled"]', '["losely"]', "estimators[0]: no estimator 'losely'; did you mean 'loosely-coupled'?"),
        (CAR, "innovation_gate = 5.0", "gate = 5.0", "estimator.loosely-coupled.gate: unknown key"),
        (
            CAR,
            "innovation_gate = 5.0",
            "innovation_gate = -5",
            "innovation_gate = -5: allowed is a finite number from 0 to 1e+12",
        ),
        (CAR, "innovation_gate = 5.0", "innovation_gate = true", "innovation_gate = True: allowed is a finite number from 0"),
        (CAR, "innovation_gate = 5.0", 'innovation_gate = "5"', "innovation_gate = '5': allowed is a finite number from 0"),
        (CAR, 'estimator."loosely-coupled"', 'estimator."loosely"', "estimator: no estimator 'loosely'"),
        (
            CAR,
            "{ wait_s = 30.0 }",
            "{ wait_s = 30.0, drive_s = 3.0 }",
            "vehicle.legs: leg 1 has drive_s and wait_s: allowed is exactly",
        ),
        (
            CAR,
            "{ wait_s = 30.0 }",
            "{ turn_deg = 30.0, duration_s = 3.0 }",
            "vehicle.legs: leg 1: turn_deg = 30.0: a stationary car",
        ),
        (CAR, "{ wait_s = 30.0 }", "{ wait = 30.0 }", "vehicle.legs[0].wait: unknown key; did you mean 'wait_s'?"),
        (
            CAR,
            "accelerate_to_mps = 12.0",
            "accelerate_to_mps = 120.0",
            "vehicle.legs[1].accelerate_to_mps = 120.0 [m/s]: must be less",
        ),
        (
            CAR,
            "frequency_hz = 30.0",
            "frequency_hz = 130.0",
            "a sinusoid of 130 Hz in engine: allowed is up to half of rate_hz, 100 Hz",
        ),
        (
            CAR,
            "[0.3, 0.2, -0.4]",
            "[0.3, 0.2, -4000]",
            "imu.lever_arm_m = [0.3, 0.2, -4000] [m]: each must be from -1000 to 1000",
        ),
        (CAR, "tilt_sigma_deg = 0.5", "tilt_sigma_deg = -0.5", "knowledge.tilt_sigma_deg = -0.5 [deg]: must be greater than 0"),
        (CAR, "[3.0, 3.0, 6.0]", "[3.0, 3.0, 0.0]", "knowledge.position_sigma_m = [3.0, 3.0, 0.0] [m]: each must be above 0"),
        (SHIP, "[imu]", "[vehicle.sea]\nsignificant_height_m = 1.0\npeak_period_s = 8.0\n[imu]", "has both sway and sea"),
        (SHIP, "[imu]", "[vehicle.sea]\nsignificant_height_m = 1.0\n[imu]", "vehicle.sea.peak_period_s is missing"),
        (
            SHIP,
            "deg = 10.0, period_s = 8.0",
            "deg = 10.0",
            "vehicle.sway.roll[0]: needs either period_s [s] or frequency_hz [Hz]",
        ),
        (SHIP, "deg = 10.0, period_s = 8.0", "deg = 80.0, period_s = 0.02", "allowed is 0.5 rad; use a higher rate_hz"),
        (SHIP, "amplitude_deg = 10.0", "amplitude_m = 10.0", "vehicle.sway.roll[0].amplitude_m: unknown key; did you mean"),
        (SHIP, "roll = [", "rol = [", "vehicle.sway.rol: unknown key; did you mean 'roll'?"),
        (SHIP, "[vehicle.sway]", "sway = 3\n[x]", "vehicle.sway = 3: must be a table of keys"),
        (SHIP, 'title = "', "title = ", "not valid TOML"),
        (PLANE, "line_m = 27000.0, bank_deg", "bank_deg", "vehicle.legs: leg 7: survey_lines needs line_m"),
        (PLANE, "survey_lines = 15", "survey_lines = 30", "segments: allowed are at most 64"),
        (PLANE, "bank_deg = 3.0", "bank_deg = 60.0", "vehicle.legs[2].bank_deg = 60.0 [deg]: must be less than or equal to 45"),
    ],
)
def test_bad_scenarios(tmp_path: Path, name: str, old: str, new: str, expected: str) -> None:
    text = text_of(name)
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(path)
    assert expected in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


def test_unknown_names_and_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="allowed is the path of one, or a name"):
        load(str(Path(__file__).parent))
    with pytest.raises(InputError, match="no scenario 'ship-swayin'; did you mean 'ship-swaying'"):
        load("ship-swayin")
    with pytest.raises(InputError, match="file not found"):
        load(str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path)
    (tmp_path / "deep.toml").write_text("a = " + "[" * 5000)
    with pytest.raises(InputError, match="not valid TOML"):
        load(tmp_path / "deep.toml")
    (tmp_path / "long.toml").write_text("title = " + "9" * 5000)
    with pytest.raises(InputError, match="not valid TOML"):
        load(tmp_path / "long.toml")


@pytest.mark.parametrize(
    "bad", [{"seed": -1}, {"seed": 1.5}, {"seed": True}, {"seed": 2**54}, {"duration_s": 0.0}, {"duration_s": 1e9},
            {"duration_s": math.nan}, {"duration_s": 1e-6}],
)  # fmt: skip
def test_bad_calls(bad: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(bad))):
        build(load("static-ecef"), **bad)


def _leaves(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values, tables and lists included."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path] * bool(path) + [leaf for name, inner in items for leaf in _leaves(inner, (*path, name))]


PLACES = [(name, path) for name in (CAR, SHIP, PLANE, "ship-underway") for path in _leaves(data_of(name))]
JUNK = st.one_of(
    st.booleans(),
    st.text(max_size=5),
    st.integers(),
    st.floats(),
    st.just(10**400),
    st.just([]),
    st.just({}),
    st.lists(st.floats(), max_size=4),
    st.just(datetime.date(2020, 1, 1)),
    st.dictionaries(st.text(max_size=3), st.floats(), max_size=2),
)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(PLACES), JUNK)
def test_any_value_is_an_error_or_runs(place: tuple[str, tuple[Any, ...]], junk: Any) -> None:
    name, path = place
    data = copy.deepcopy(data_of(name))
    inner = data
    for part in path[:-1]:
        inner = inner[part]
    inner[path[-1]] = junk
    try:
        scenario = parse(data, "mine.toml")
    except InputError as error:
        assert all(line.startswith(("mine.toml: ", "and ")) for line in str(error).splitlines())
    else:
        plant = build(scenario)
        assert np.isfinite(make_runner(plant.model, plant.parameters, backend="interpreter").run(3)).all()


FIGURES = json_schema()["$defs"]["ImuSection"]["properties"]
NOISE = [name for name in FIGURES if "sigma" in name or "arw" in name or "vrw" in name or "white" in name]


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(NOISE), st.floats(max_value=0.0, exclude_max=True))
def test_negative_noise_is_refused(name: str, value: float) -> None:
    data = data_of(SHIP)
    data["imu"][name] = value
    with pytest.raises(InputError, match=f"imu.{name} = "):
        parse(data)


# --- tuning ----------------------------------------------------------------------------------------


def test_tuning() -> None:
    table = {"arw_deg_sqrt_h": 0.3, "vrw_mps_sqrt_h": 0.1, "correlation_time_s": 3600, "position_sigma_m": [1, 2, 3]}
    rows = tuning("loosely-coupled", table)
    assert rows["angle_random_walk"] == pytest.approx(0.3 * DEG / 60)
    assert rows["velocity_random_walk"] == pytest.approx(0.1 / 60)
    assert rows["gyro_correlation_time"] == rows["accel_correlation_time"] == 3600
    np.testing.assert_array_equal(rows["position_sigma"], [1, 2, 3])
    log = tomllib.loads((ROOT / "examples/n380-car.toml").read_text(encoding="utf-8"))
    for id, table in log["estimator"].items():
        registry.get(id).model.parameters.pack(tuning(id, table))
    for bad in ({"gyro_bias_ug": 1.0}, {"start_latitude": 1.0}, {"antenna_lever_arm_m": [1, 2, 3]}, {"arw_deg_sqrt_h": -1.0},
                {"arw_deg_sqrt_h": "x"}, {"arw_deg_sqrt_h": 10**400}, {"position_sigma_m": [1.0, 2.0]},
                {"arw_deg_sqrt_h": 1.0, "angle_random_walk_deg_sqrt_h": 1.0}):  # fmt: skip
        with pytest.raises(InputError, match=f"estimator.loosely-coupled.{list(bad)[-1]}"):
            tuning("loosely-coupled", bad)


# --- pages and schema ------------------------------------------------------------------------------


def test_every_key_shows_its_unit() -> None:
    endings = {
        "deg": "_deg",
        "m": "_m",
        "s": "_s",
        "m/s": ("_mps", "_m_s"),
        "Hz": "_hz",
        "m/s2": "_mps2",
        "%": "_percent",
        "ug": "_ug",
        "deg/h": "_deg_h",
        "deg C": "_degc",
        "ppm": "_ppm",
        "urad": "_urad",
        "arcsec": "_arcsec",
        "g": "_g",
    }
    for section in [json_schema(), *json_schema()["$defs"].values()]:
        for name, schema in section["properties"].items():
            assert schema["description"]
            if schema.get("unit") in endings:
                assert name.endswith(endings[schema["unit"]]), name
            if schema.get("type") == "number":
                assert "unit" in schema or name in ("roll_damping", "enhancement") or "probability" in name, name


def test_the_schema_accepts_the_scenarios_of_insenv() -> None:
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((ROOT / "scenarios/schema.json").read_text(encoding="utf-8"))
    of_schema = jsonschema.validators.validator_for(schema)
    of_schema.check_schema(schema)
    for name in names():
        of_schema(schema).validate(data_of(name))
    with pytest.raises(jsonschema.ValidationError):
        of_schema(schema).validate({**data_of(SHIP), "sed": 1})


def test_the_examples_of_the_page(tmp_path: Path) -> None:
    page = (ROOT / "docs/scenarios.md").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(page.split("```toml\n")[1].split("```")[0])
    plant = build(load(tmp_path / "mine.toml"), duration_s=1.0)
    runner = make_runner(plant.model, plant.parameters, backend="interpreter")
    assert np.isfinite(runner.run(plant.samples)).all()
    exec(compile(page.split("```python\n")[1].split("```")[0], "docs/scenarios.md", "exec"), {})
