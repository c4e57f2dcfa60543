"""Aiding instruments in recorded logs: columns of text files in their units, and the samples that they belong to."""

import casadi as ca
import numpy as np
import pytest

import insenv
from insenv import Instrument, Row
from insenv.logs.instruments import sample_columns
from insenv.sensors import registry
from insenv.sensors.figures import Grade, by_name
from insenv.sensors.instrument import Column, white

FILES = {"barometer": "510", "magnetometer": "20000,-1000,-43000", "odometer": "36", "dvl": "1,2,3", "heading": "90,0.5"}
EARLIER = {"barometer": "0", "magnetometer": "1,1,1", "odometer": "0", "dvl": "0,0,0", "heading": "0,1"}
DESCRIPTION = """
barometer = { file = "barometer.csv", time = "t", height = "v0" }
magnetometer = { file = "magnetometer.csv", time = "t", field = ["v0", "v1", "v2"], field_unit = "nT", axes = "FLU" }
odometer = { file = "odometer.csv", time = "t", speed = "v0", speed_unit = "km/h", lever_arm_m = [-1.0, 0.5, 0.4] }
dvl = { file = "dvl.csv", time = "t", velocity = ["v0", "v1", "v2"], axes = "FRD", lever_arm_m = [2.0, 0.0, 1.0] }
heading = { file = "heading.csv", time = "t", azimuth = "v0", azimuth_sigma = "v1", baseline_m = [0.9, 0.1, 0.0] }
"""


@pytest.fixture
def fitted(folder):
    """A log with two readings of every instrument in one sample, one at its end, and one after the last sample."""
    for id, values in FILES.items():
        names = ",".join(["t", "v0", "v1", "v2"][: 2 + values.count(",")])
        lines = [f"10.53,{EARLIER[id]}", *(f"{time},{values}" for time in (10.535, 11.0, 12.5))]
        folder.write(f"{id}.csv", "\n".join([names, *lines]) + "\n")
    folder.change(('title = "test"\n', f'title = "test"\n{DESCRIPTION}'))
    return folder


def test_samples_get_the_last_reading_of_their_time_in_si_and_body_axes(fitted):
    columns, _ = sample_columns(fitted.load(), slice(None))
    expected = {
        "barometer_height": 510.0, "magnetometer_field_b": [2e-5, 1e-6, 4.3e-5], "odometer_speed": 10.0,
        "dvl_velocity_b": [1.0, 2.0, 3.0], "heading_azimuth": np.pi / 2, "heading_azimuth_sigma": np.radians(0.5),
    }  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(columns[name][[26, 49]], [value, value], rtol=1e-12, err_msg=name)
    for id in FILES:
        assert np.flatnonzero(columns[f"{id}_new"]).tolist() == [26, 49], id
        np.testing.assert_allclose(columns[f"{id}_age"][[26, 49]], [0.005, 0.0], atol=1e-9, err_msg=id)
    assert "heading_baseline_n" not in columns


def test_a_log_whose_magnetometer_is_silent_has_none_and_says_so(fitted):
    lines = [f"{time},0,0,0" for time in (10.53, 11.0, 12.5)]
    fitted.write("magnetometer.csv", "\n".join(["t,v0,v1,v2", *lines]) + "\n")
    log = fitted.load()
    assert "magnetometer" not in [each.id for each in log.instruments]
    assert "3 of 3 readings of the magnetic field are exactly 0" in " ".join(log.notes)


@pytest.mark.parametrize(("size", "parts"), [(2, "xy"), (4, "1234")])
def test_a_measurement_of_any_number_of_elements_goes_through_a_log(size, parts, tmp_path, monkeypatch):
    def measured(motion, e, p):
        velocity_b = motion.body_velocity(ca.SX.zeros(3))
        return {"radar_speed": ca.vertcat(velocity_b, velocity_b)[:size] + e.noise}

    monkeypatch.setattr(registry._PLUGINS, "_added", dict(registry._PLUGINS._added))
    insenv.register(
        Instrument(
            "radar",
            title="Radar",
            called="the radar",
            what="speeds",
            causes="its noise",
            values=(Row("radar_speed", "Speeds", "m/s", (size,), "b"),),
            terms=(white("radar_noise", "radar noise", "White noise", "m/s", (size,), "b"),),
            measure=measured,
            aid_parameters=("radar_noise",),
            least_sigma={"radar_speed": 0.01},
            columns=(Column("speed", "radar_speed", "speeds"),),
            grades=by_name(Grade("perfect", "No errors")),
        )
    )
    start = {"latitude_deg": 50, "longitude_deg": 8}
    scenario = {"title": "t", "duration_s": 4, "start": start, "vehicle": {"kind": "car"}, "imu": {}, "gnss": {}, "radar": {}}
    log = insenv.record(scenario)
    paths = insenv.write(log, tmp_path, "log")
    table = next(path for path in paths if path.name.endswith("-radar.csv"))
    assert table.read_text().partition("\n")[0].split(",")[2:] == [f"speed_{part}_mps" for part in parts]
    (read,) = insenv.logs.load(paths[0]).instruments
    assert np.array_equal(read.values, log.instruments[0].values) and read.values.shape == (4, size)
    assert insenv.replay(paths[0], "fusion").results[0].estimator == "fusion"
