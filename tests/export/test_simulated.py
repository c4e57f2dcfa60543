"""A simulated drive as a log: the same samples to the bit, and the same answer, through CSV files and their description."""

from dataclasses import replace

import numpy as np
import pytest

import insenv
from insenv.errors import InputError
from insenv.estimators import get
from insenv.export.angles import degrees_of
from insenv.export.toml_text import toml_text
from insenv.files.resources import examples_folder
from insenv.files.toml import read_toml
from insenv.logs import load
from insenv.runs.replay_start import initial_knowledge
from insenv.runs.replayed import sample_columns
from insenv.scenario import build

EVERYTHING = {
    "title": "Car with every instrument", "duration_s": 30.0, "rate_hz": 100.0, "seed": 2,
    "start": {"latitude_deg": 48.0, "longitude_deg": 179.9999, "height_m": 500.0, "heading_deg": 90.0},
    "vehicle": {"kind": "car", "legs": [{"wait_s": 5.0}, {"accelerate_to_mps": 10.0}, {"turn_deg": 90.0, "radius_m": 20.0}]},
    "imu": {"grade": "tactical", "gyro_bias_deg_h": [0.3, -0.2, 0.1]},
    "gnss": {"grade": "spp", "latency_s": 0.2, "epoch_offset_s": 0.003, "lever_arm_m": [0.5, 0.1, -1.0],
             "lever_arm_error_m": [0.1, 0.0, 0.0], "delay_sigma_s": 0.01},
    "barometer": {"latency_s": 0.02, "noise_m": 0.3}, "magnetometer": {"field_nt": [20000.0, 1000.0, 43000.0]},
    "odometer": {"lever_arm_m": [-1.0, 0.5, 0.4], "mounting_deg": [0.0, 1.0, -0.5]},
    "dvl": {"lever_arm_m": [2.0, 0.0, 1.0], "interval_s": 0.5, "latency_s": 0.1}, "heading": {"baseline_m": [0.9, 0.1, 0.0]},
    "knowledge": {"heading_sigma_deg": 3.0},
}  # fmt: skip


def written(folder, log):
    """The log after it was written and read."""
    (description, *_) = insenv.write(log, folder, ["log"], name="drive")
    return load(description)


def assert_same_samples(log, back):
    before, after = (sample_columns(each, slice(None))[0] for each in (log, back))
    assert set(before) == set(after)
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values, err_msg=name)


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    log = insenv.record(EVERYTHING)
    return log, written(tmp_path_factory.mktemp("log"), log)


def test_every_instrument_comes_back_to_the_bit(everything):
    log, back = everything
    assert_same_samples(log, back)
    assert back.gnss.age[0] == pytest.approx(0.203), "fixes arrive late, and the log says by how much"


def test_the_temperature_of_the_unit_comes_back_to_the_bit(tmp_path):
    """A unit that warms up, with lost samples, whose temperatures no log has."""
    warm = {"temperature_start_degc": -11.3, "temperature_end_degc": 37.7, "warm_up_s": 7.0, "drop_probability": 0.01}
    log = insenv.record({**EVERYTHING, "imu": {**EVERYTHING["imu"], **warm}})
    assert np.ptp(log.temperature) > 40.0
    back = written(tmp_path, log)
    own = ~log.bridged
    assert not own.all()
    np.testing.assert_array_equal(back.temperature[own], log.temperature[own])


def test_a_log_without_place_for_a_temperature_leaves_it_out(tmp_path):
    log = insenv.record({**EVERYTHING, "imu": {"temperature_end_degc": 200.0, "warm_up_s": 1.0, "temperature_ramp_k_h": 100.0}})
    assert log.temperature is None
    assert any("no place for: temperatures of the unit beyond -100 to 200 deg C" in note for note in log.notes)
    assert_same_samples(log, written(tmp_path, log))


def test_estimators_are_told_the_same(everything):
    told = build(insenv.load(EVERYTHING)).knowledge.rows
    rows = initial_knowledge(everything[1], get("wander-sins"), "stated", 0).knowledge.rows
    assert rows.keys() == told.keys()
    for name, value in told.items():
        np.testing.assert_allclose(rows[name], value, rtol=1e-15, atol=0.0, err_msg=name)


def test_the_samples_are_those_of_the_run(everything):
    """The outputs of a filter depend on every one of them."""
    run = insenv.run(EVERYTHING, "loosely-coupled")
    for log in everything:
        same_answer(run, insenv.replay(log, "loosely-coupled", start="stated"), 1e-9)


def same_answer(run, replayed, tolerance):
    """Outputs at the times of both; tolerance: relative to the largest value of a row; 0: to the bit."""
    for before, after in zip(run.results, replayed.results, strict=True):
        times = np.intersect1d(before.time, after.time)
        assert len(times) > 100
        here, there = np.isin(before.time, times), np.isin(after.time, times)
        for name, values in before.outputs.items():
            apart = tolerance * np.max(np.abs(values))
            np.testing.assert_allclose(after.outputs[name][there], values[here], rtol=0.0, atol=apart, err_msg=name)
        apart = max(1e-6, 0.1 * tolerance)
        for name, values in before.errors.items():
            np.testing.assert_allclose(after.errors[name][there], values[here], rtol=0.0, atol=apart, err_msg=name)


@pytest.mark.parametrize(("scenario", "seed", "tolerance"), [("car-city-drive", 1, 0.0), ("ship-swaying", 3, 1e-12)])
def test_a_simulated_drive_replays_to_the_same_answer(tmp_path, scenario, seed, tolerance):
    """To the bit if degrees give all angles of the start back."""
    replays(tmp_path, scenario, seed, 20.0, tolerance)


def replays(folder, scenario, seed, duration, tolerance):
    log = insenv.record(scenario, seed=seed, duration_s=duration)
    back = written(folder, log)
    assert_same_samples(log, back)
    ids = insenv.load(scenario).estimators
    run = insenv.run(scenario, ids, seed=seed, duration_s=duration)
    same_answer(run, insenv.replay(back, ids, start="stated"), tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", insenv.scenario.names())
def test_every_scenario_comes_back(tmp_path, scenario):
    """With a magnetometer: the field of the Earth at the first fix instead of the start, nanotesla."""
    loaded = insenv.load(scenario)
    replays(tmp_path, scenario, 3, min(loaded.duration_s, 60.0), 1e-7 if loaded.magnetometer is None else 1e-3)


def test_lost_samples_are_missing_in_the_log_and_bridged_again(tmp_path):
    log = insenv.record({**EVERYTHING, "imu": {"grade": "tactical", "drop_probability": 0.02}})
    back = written(tmp_path, log)
    lost = log.gaps.samples
    assert 20 < lost < 120
    assert len((tmp_path / "drive-log-imu.csv").read_text("utf-8").splitlines()) - 1 == 3000 - lost
    assert back.gaps.samples == lost
    for name in ("delta_angle", "delta_velocity"):
        np.testing.assert_allclose(getattr(back, name), getattr(log, name), rtol=1e-9, atol=1e-12)


def test_a_log_of_another_format_is_written_too(tmp_path):
    """The example log: rates in deg/s, another mounting, a grade."""
    log = load(examples_folder() / "logs" / "plain.toml")
    back = written(tmp_path, log)
    assert_same_samples(log, back)
    assert back.description.imu.grade == log.description.imu.grade
    before, after = (insenv.replay(each, "loosely-coupled").results[0] for each in (log, back))
    for name, values in before.outputs.items():
        np.testing.assert_array_equal(after.outputs[name], values, err_msg=name)


def test_degrees_give_the_angle_back():
    angles = np.random.default_rng(1).uniform(-np.pi, np.pi, 2000)
    back = np.radians([degrees_of(float(angle)) for angle in angles])
    assert np.all(np.abs(back - angles) <= np.spacing(np.abs(angles)))
    assert np.mean(back == angles) > 0.9


def test_text_of_a_toml_file_is_read_back(tmp_path):
    values = {
        "text": 'a "quoted" \\ path\n\ttab é', "whole": 3, "number": 0.1 + 0.2, "small": 5e-324, "yes": True,
        "list": [1.5, -2.0],
        "names": ["a", "b"], "table": {"key with space": 1.0, "inner": {"x": 1}, "empty": {}}, "several": [{"a": 1}, {"a": 2}],
    }  # fmt: skip
    (tmp_path / "x.toml").write_text(toml_text(values), encoding="utf-8")
    assert read_toml(tmp_path / "x.toml") == values


@pytest.mark.parametrize(
    ("table", "value", "message"),
    [("gnss", "99999.0", "age is 99999 s"), ("imu", "-0.01", "interval is -0.01 s")],
)
def test_wrong_ages_and_intervals_are_named(tmp_path, table, value, message):
    insenv.write(insenv.record(EVERYTHING, duration_s=5.0), tmp_path, ["log"], name="drive")
    path = tmp_path / f"drive-log-{table}.csv"
    lines = path.read_text(encoding="utf-8").splitlines()
    fields = lines[2].split(",")
    fields[1] = value  # behind the time: the age of a fix, the interval of a sample
    path.write_text("\n".join([*lines[:2], ",".join(fields), *lines[3:]]) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load(tmp_path / "drive-log.toml")


def test_a_start_that_is_not_stated_is_refused_by_its_missing_keys(tmp_path):
    log = insenv.record("car-city-drive", duration_s=10.0)
    initial = log.description.initial.model_copy(update={"heading_deg": None, "velocity_mps": None})
    lacking = replace(log, description=log.description.model_copy(update={"initial": initial}))
    with pytest.raises(InputError, match=r"start 'stated': \[initial\] lacks velocity_mps, heading_deg"):
        insenv.replay(lacking, "loosely-coupled", start="stated")
