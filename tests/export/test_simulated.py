"""A simulated drive as a log: CSV files and their description."""

from itertools import groupby

import numpy as np
import pytest
from standing_car import started

import insenv
from insenv.base.errors import InputError
from insenv.base.resources import examples_folder
from insenv.estimators import get
from insenv.logs import load
from insenv.logs.instruments import sample_columns
from insenv.runs.replay_start import initial_knowledge
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


def test_estimators_are_told_the_same(everything):
    told = build(insenv.load(EVERYTHING)).knowledge.rows
    rows = initial_knowledge(everything[1], get("wander-sins"), "stated", 0).knowledge.rows
    assert rows.keys() == told.keys()
    for name, value in told.items():
        np.testing.assert_allclose(rows[name], value, rtol=1e-15, atol=0.0, err_msg=name)


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


def replays(folder, scenario, seed, duration, tolerance):
    log = insenv.record(scenario, seed=seed, duration_s=duration)
    back = written(folder, log)
    assert_same_samples(log, back)
    ids = insenv.load(scenario).estimators
    run = insenv.run(scenario, ids, seed=seed, duration_s=duration)
    same_answer(run, insenv.replay(back, ids, start="stated"), tolerance)


def test_a_simulated_drive_replays_to_the_same_bits(tmp_path):
    """Degrees give all angles of its start back."""
    replays(tmp_path, "car-city-drive", 1, 20.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", insenv.scenario.names())
def test_every_scenario_comes_back(tmp_path, scenario):
    """With a magnetometer: the field of the Earth at the first fix instead of the start, nanotesla."""
    loaded = insenv.load(scenario)
    replays(tmp_path, scenario, 3, min(loaded.duration_s, 60.0), 1e-7 if loaded.magnetometer is None else 1e-3)


def test_lost_samples_are_missing_in_the_log_and_bridged_again(tmp_path):
    warm = {"temperature_start_degc": -11.3, "temperature_end_degc": 37.7, "warm_up_s": 7.0}
    log = insenv.record({**EVERYTHING, "imu": {"grade": "tactical", "drop_probability": 0.02, **warm}})
    back = written(tmp_path, log)
    lost = log.gaps.samples
    assert 20 < lost < 120
    assert len((tmp_path / "drive-log-imu.csv").read_text("utf-8").splitlines()) - 1 == 3000 - lost
    assert back.gaps.samples == lost
    runs = [[n for n, _ in run] for is_lost, run in groupby(enumerate(log.bridged), key=lambda each: each[1]) if is_lost]
    lengths = [len(run) for run in runs]
    assert (log.gaps.count, log.gaps.samples) == (len(runs), sum(lengths)) == (back.gaps.count, log.bridged.sum())
    assert log.gaps.longest_s == pytest.approx(0.01 * max(lengths)) == pytest.approx(back.gaps.longest_s)
    # sample n covers n to n + 1 intervals
    np.testing.assert_allclose(log.gaps.intervals, [(0.01 * run[0], 0.01 * (run[-1] + 1)) for run in runs], atol=1e-12)
    for name in ("delta_angle", "delta_velocity"):
        np.testing.assert_allclose(getattr(back, name), getattr(log, name), rtol=1e-9, atol=1e-12)
    assert np.ptp(log.temperature) > 40.0
    np.testing.assert_array_equal(back.temperature[~log.bridged], log.temperature[~log.bridged])


def test_a_log_of_another_format_is_written_too(tmp_path):
    """The example log: rates in deg/s, another mounting, a grade."""
    log = load(examples_folder() / "logs" / "plain.toml")
    back = written(tmp_path, log)
    assert_same_samples(log, back)
    assert back.description.imu.grade == log.description.imu.grade
    before, after = (insenv.replay(each, "loosely-coupled").results[0] for each in (log, back))
    for name, values in before.outputs.items():
        np.testing.assert_array_equal(after.outputs[name], values, err_msg=name)


def test_a_start_that_is_not_stated_is_refused_by_its_missing_keys(tmp_path):
    log = insenv.record("car-city-drive", duration_s=10.0)
    lacking = started(log, heading_deg=None, velocity_mps=None)
    with pytest.raises(InputError, match=r"start 'stated': \[initial\] lacks velocity_mps, heading_deg"):
        insenv.replay(lacking, "loosely-coupled", start="stated")
