"""Aiding instruments in recorded logs: columns of text files in their units, samples that they belong to, what is told."""

from pathlib import Path

import numpy as np
import pytest

from insenv import estimators
from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.instruments import INSTRUMENTS
from insenv.logs import load
from insenv.logs.instruments import sample_columns
from insenv.runs import replayed
from insenv.runs.replay_start import initial_knowledge
from insenv.scenario import build
from insenv.scenario import load as load_scenario

SCENARIO = {
    "title": "Car", "duration_s": 30.0, "rate_hz": 100.0, "seed": 2,
    "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "heading_deg": 30.0},
    "vehicle": {"kind": "car", "legs": [{"wait_s": 5.0}, {"accelerate_to_mps": 10.0}, {"turn_deg": 90.0, "radius_m": 20.0}]},
    "imu": {"grade": "tactical"}, "gnss": {"grade": "rtk"},
    "barometer": {"latency_s": 0.02}, "magnetometer": {}, "odometer": {"lever_arm_m": [-1.0, 0.5, 0.4]},
    "dvl": {"lever_arm_m": [2.0, 0.0, 1.0], "interval_s": 0.5, "latency_s": 0.1}, "heading": {"baseline_m": [0.9, 0.1, 0.0]},
}  # fmt: skip
UNITS = {"magnetometer": 1e9, "odometer": 3.6, "heading": 180 / np.pi}
"""Factors from SI to the units of the files: nT, km/h, deg."""
DESCRIPTION = """
title = "Simulated"
barometer = { file = "barometer.csv", time = "t", height = "v0" }
magnetometer = { file = "magnetometer.csv", time = "t", field = ["v0", "v1", "v2"], field_unit = "nT", axes = "FLU" }
odometer = { file = "odometer.csv", time = "t", speed = "v0", speed_unit = "km/h", lever_arm_m = [-1.0, 0.5, 0.4] }
dvl = { file = "dvl.csv", time = "t", velocity = ["v0", "v1", "v2"], axes = "FRD", lever_arm_m = [2.0, 0.0, 1.0] }
heading = { file = "heading.csv", time = "t", azimuth = "v0", azimuth_sigma = "v1", baseline_m = [0.9, 0.1, 0.0] }
initial = { latitude_deg = 48.0, longitude_deg = 11.0, height_m = 500.0, heading_deg = 30.0, static_until_s = 5.0 }
[imu]
file = "imu.csv"
time = "t"
gyro = ["gx", "gy", "gz"]
accel = ["ax", "ay", "az"]
kind = "increment"
stamp = "interval_end"
gyro_unit = "rad"
accel_unit = "m/s"
axes = "FRD"
rate_hz = 100.0
grade = "tactical"
"""


def write(path, columns):
    lines = [",".join(columns), *(",".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The plant, its outputs, and the log of them."""
    folder = tmp_path_factory.mktemp("log")
    plant = build(load_scenario(SCENARIO))
    y = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    angle, velocity = y["delta_angle"].T, y["delta_velocity"].T
    samples = zip(("gx", "gy", "gz", "ax", "ay", "az"), (*angle, *velocity), strict=True)
    write(folder / "imu.csv", {"t": np.round(y["time"], 6), **dict(samples)})
    for id, given in INSTRUMENTS.items():
        at = np.flatnonzero(y[given.new])
        names = [name for name in given.values if name != "heading_baseline_n"]
        values = np.concatenate([y[name][at].reshape(len(at), -1) for name in names], axis=1) * UNITS.get(id, 1.0)
        if id == "magnetometer":
            values[:, 1:] *= -1.0  # forward, left, up
        epochs = np.round(y["time"][at] - y[given.age][at], 6)
        write(folder / f"{id}.csv", {"t": epochs, **{f"v{i}": v for i, v in enumerate(values.T)}})
    (folder / "log.toml").write_text(DESCRIPTION, encoding="utf-8")
    return plant, y, load(folder / "log.toml")


@pytest.mark.parametrize("id", INSTRUMENTS)
def test_samples_get_the_readings_of_their_time(recorded, id):
    """Each on the first sample that ends at or after its epoch, which is earlier than its delivery by the latency."""
    _, y, log = recorded
    columns, _ = replayed.sample_columns(log, slice(None))
    given, at = INSTRUMENTS[id], np.flatnonzero(y[INSTRUMENTS[id].new])
    epochs = at - np.rint(y[given.age][at] / 0.01).astype(int)
    np.testing.assert_array_equal(np.flatnonzero(columns[given.new]), epochs)
    np.testing.assert_allclose(columns[given.age][epochs], 0.0, atol=1e-9)
    assert "heading_baseline_n" not in columns, "the file has azimuths only"
    for name in set(given.values) & set(columns):
        np.testing.assert_allclose(columns[name][epochs], y[name][at], rtol=1e-12, atol=1e-18, err_msg=name)


def test_estimators_are_told_what_they_are_told_in_a_run(recorded):
    plant, _, log = recorded
    start = initial_knowledge(log, estimators.get("wander-sins"), "coarse", 0)
    for name, value in plant.knowledge.instruments.items():
        if name not in ("antenna_lever_arm_sigma", "gnss_delay_sigma"):
            np.testing.assert_allclose(start.knowledge.rows[name], value, rtol=1e-9, atol=1e-20, err_msg=name)


def test_of_two_readings_in_a_sample_the_later_counts_and_none_beyond_the_window(recorded):
    _, _, log = recorded
    (odometer,) = (each for each in log.instruments if each.id == "odometer")
    end, dt = np.array([1.0, 1.2]), np.array([0.2, 0.2])
    columns = sample_columns([odometer], end, dt)
    assert np.count_nonzero((odometer.time > 0.8) & (odometer.time <= 1.2)) == 4
    np.testing.assert_allclose(columns["odometer_age"], [0.0, 0.0], atol=1e-9)
    assert columns["odometer_new"].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('field_unit = "nT"', 'field_unit = "Oe"', r"magnetometer\.field_unit = 'Oe'"),
        ('azimuth_sigma = "v1", ', "", r"heading.*give either azimuth_sigma"),
        ("baseline_m = [0.9, 0.1, 0.0]", "baseline_m = [0, 0, 0]", r"heading\.baseline_m.*a length"),
        ('height = "v0"', 'height = "v0", time_offset_s = 1e5', r"barometer: its times .* do not overlap the imu's"),
    ],
)
def test_wrong_descriptions(recorded, old, new, message):
    _, _, log = recorded
    folder = Path(log.sources[0].file).parent
    text = DESCRIPTION.replace(old, new)
    (folder / "wrong.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load(folder / "wrong.toml")
