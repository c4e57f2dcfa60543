"""A telemetry log of insenv replays as well as the run that it came from, and an alignment finds its place in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from insenv import replay, run
from insenv.logs import load
from insenv.logs.flight.parameters import settings
from insenv.mavlink import Stream, Vehicle
from insenv.mavlink.wire import TlogWriter, dialect, open_link
from insenv.report import Report
from insenv.scenario import build
from insenv.scenario import load as load_scenario


def streamed(path: Path, scenario: str, estimator: str, seconds: float, seed: int | None = None) -> Path:
    vehicle = Vehicle(load_scenario(scenario), estimator, seed=seed, speed=0.0, start_unix=1.7e9)
    with open_link("udpout:127.0.0.1:14599") as link, TlogWriter(path) as log:
        Stream(vehicle, link, log).run(seconds)
    return path


def rms(report: Report, channel: str, from_s: float) -> float:
    result = report.results[0]
    return float(np.sqrt(np.mean(result.errors[channel][result.time > from_s] ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["ship-underway", "car-city-drive"])
def test_a_replay_is_as_good_as_the_run(scenario: str, tmp_path: Path) -> None:
    """The scenario's own seed, 200 s, the last 100 s: the same estimator on the same samples and fixes, from another start."""
    path = streamed(tmp_path / "drive.tlog", scenario, "loosely-coupled", 200.0)
    again = replay(path, "loosely-coupled", start="reference")
    original = run(scenario, "loosely-coupled", duration_s=200.0)
    for channel in ("north_m", "east_m", "down_m", "vn_mps", "ve_mps", "vd_mps", "roll_deg", "pitch_deg"):
        own = rms(original, channel, 100.0)
        assert rms(again, channel, 100.0) < max(1.1 * own, own + 0.2 * again.results[0].stated()[channel]), channel


def test_lever_arm_data_sheet_and_settings_are_in_the_log(tmp_path: Path) -> None:
    log = load(streamed(tmp_path / "drive.tlog", "car-city-drive", "loosely-coupled", 3.0))
    assert log.lever_arm_b == pytest.approx([-1.2, 0.3, -1.0])
    assert log.unit is not None
    parameters = build(load_scenario("car-city-drive")).parameters
    np.testing.assert_allclose(log.unit["angle_random_walk"], parameters["angle_random_walk"], rtol=1e-6)
    np.testing.assert_allclose(log.unit["gyro_bias_sigma"], parameters["gyro_bias_sigma"], rtol=1e-6)
    assert log.settings["loosely-coupled"]["fix_wander_sigma"] == pytest.approx([1.5, 1.5, 3.05])
    assert any("lever arm of the antenna -1.2, 0.3, -1 m" in note for note in log.notes)
    (tmp_path / "log.toml").write_text('flight = "drive.tlog"\nlever_arm_m = [0.0, 0.0, 0.0]\ngrade = "consumer"\n')
    told = load(tmp_path / "log.toml")
    assert told.lever_arm_b.tolist() == [0.0, 0.0, 0.0] and told.unit is None


def test_settings_of_another_version_are_taken_as_far_as_they_go(tmp_path: Path) -> None:
    """A parameter more and one less: the rest is the estimator's; those of another estimator are not."""
    vehicle = Vehicle(load_scenario("car-city-drive"), "loosely-coupled", speed=0.0)
    values = {parameter.name: parameter.value() for parameter in vehicle.parameters.all}
    assert settings(values)["loosely-coupled"]["innovation_gate"] == 5.0
    values["E_NEW_NAME"] = 1.0
    del values["E_INN_GATE"]
    found = settings(values)["loosely-coupled"]
    assert "innovation_gate" not in found and found["fix_wander_sigma"] == pytest.approx([1.5, 1.5, 3.05])
    assert "q-method" not in settings(values) and settings({}) == {}


def test_a_moored_ship_is_aligned_at_its_home_position(tmp_path: Path) -> None:
    path = streamed(tmp_path / "moored.tlog", "ship-moored-paper", "q-method", 60.0)
    again, original = replay(path, "q-method"), run("ship-moored-paper", "q-method", duration_s=60.0)
    assert any("the place is that of HOME_POSITION, 28.2" in note for note in again.notes)
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        assert again.results[0].errors[channel][-1] == pytest.approx(original.results[0].errors[channel][-1], abs=2e-4)


def test_accuracies_are_those_of_gps_raw_int(tmp_path: Path) -> None:
    """eph and epv of HIL_GPS are dilutions by the definition, here 0.9 and 1.5; GPS_RAW_INT states metres, fix by fix."""
    mavlink = dialect()
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as log:
        for i in range(1, 1001):
            t = i * 10_000
            values = (0.0, 0.0, -9.8, 0.0, 0.0, 0.0)
            sample = mavlink.MAVLink_hil_sensor_message(t, *values, *[0.0] * 3, 0.0, 0.0, 0.0, 0.0, 0b111111, 0)
            log.write(1_700_000_000_000_000 + t, sample.pack(packer))
            if i % 100:
                continue
            speed = 65535 if i == 500 else 0
            hil = mavlink.MAVLink_hil_gps_message(t, 3, 470000000, 150000000, 400000, 90, 150, speed, 0, 0, 0, 0, 9)
            log.write(1_700_000_000_000_000 + t, hil.pack(packer))
            raw = mavlink.MAVLink_gps_raw_int_message(
                t, 3, 470000000, 150000000, 400000, 90, 150, 0, 0, 9, 445000, 1000 + i, 2000 + i, 300, 0
            )
            log.write(1_700_000_000_000_000 + t, raw.pack(packer))
    found = load(path).gnss
    assert found is not None and found.velocity_sigma is not None
    place = np.arange(1, 11) * 0.1
    np.testing.assert_allclose(found.position_sigma, np.stack([1 + place, 1 + place, 2 + place], axis=1), atol=1e-9)
    assert found.velocity_sigma[0].tolist() == pytest.approx([0.3] * 3)
    assert found.velocity_sigma[4].tolist() == [100.0] * 3  # the receiver had no velocity then
