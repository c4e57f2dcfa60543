"""Runs: simulated scenarios and a real log."""

import importlib.util
import json
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

from insenv import attitude, campaign, geodesy, replay, run
from insenv.errors import InputError, InsenvError
from insenv.evaluation.errors import ATTITUDE, CHANNELS, Track, errors
from insenv.logs import load as load_log
from insenv.scenario import load

N380 = ROOT / "examples" / "n380-car.toml"
n380 = pytest.mark.skipif(importlib.util.find_spec("onavdata") is None, reason="onavdata is not installed")


def test_a_run_is_reproducible_and_depends_on_its_seed():
    reports = [run("ship-swaying", seed=seed, duration_s=20.0) for seed in (3, 3, 4)]
    first, again, other = (r.results[0].outputs["q_nb"] for r in reports)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_report_is_the_documented_json():
    report = run("car-city-drive", ["loosely-coupled", "wander-sins"], duration_s=30.0)
    document = json.loads(json.dumps(report.as_json()))
    assert document["scenario"] == "car-city-drive"
    assert document["imu_samples"] == 6000 and document["duration_s"] == 30.0
    for result in document["results"]:
        assert set(result["final"]) == set(result["rms"]) == set(result["max"]) == set(CHANNELS)
        assert set(result["limit"]) == set(CHANNELS)
        assert result["us_per_sample"] > 0


def test_progress_is_reported_to_the_end():
    calls = []
    run("static-ecef", ["q-method"], duration_s=250.0, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (50000, 50000) and len(calls) > 1


@pytest.mark.parametrize(
    ("scenario", "id", "message"),
    [
        ("ship-swaying", "loosely-coupled", "needs GNSS"),
        ("car-city-drive", "q-method", "in place"),
        ("ship-swaying", "q-metod", "did you mean 'q-method'"),
    ],
)
def test_an_estimator_that_cannot_run_on_the_scenario_is_an_error(scenario, id, message):
    with pytest.raises(InputError, match=message):
        run(scenario, [id], duration_s=10.0)


def test_lost_samples_are_bridged_and_counted():
    scenario = load("ship-swaying")
    lossy = scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"drop_probability": 0.01})})
    report = run(lossy, duration_s=100.0)
    assert any("bridged" in note for note in report.notes)
    assert 120 < int(report.notes[0].split()[0]) < 280
    assert np.abs(report.results[0].errors["roll_deg"][-1]) < 0.1


@pytest.mark.parametrize(("imu", "perfect"), [({}, True), (None, True), ({"gyro_bias_deg_h": 0.1}, False)])
def test_a_perfect_unit_for_want_of_a_section_is_said(imu, perfect):
    values = load("ship-swaying").model_dump(exclude_unset=True)
    del values["imu"]
    if imu is not None:
        values["imu"] = {"lever_arm_m": [1.0, 0.0, 0.0], **imu}
    said = ["the inertial unit is perfect, because [imu] is missing or states no errors"] if perfect else []
    assert run(values, "q-method", duration_s=5.0).as_json()["notes"] == said
    assert [
        note for note in campaign(values, "q-method", runs=2, duration_s=5.0).as_json()["notes"] if "perfect" in note
    ] == said
    assert run("ship-swaying", duration_s=5.0).notes == ()


def test_free_inertial_errors_agree_with_the_predicted_covariance():
    """Ten minutes without GNSS over eight seeds: errors in units of the predicted sigma are of order one."""
    ratios = []
    for seed in range(8):
        result = run("aircraft-free-inertial", seed=seed).results[0]
        ratios.append([result.errors[c][-1] / result.limit[c] for c in ("north_m", "east_m")])
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 4.0


def test_errors_wrap_angles():
    def track(heading_deg):
        return Track(np.zeros(1), attitude.numeric.from_euler(0.0, 0.0, np.radians([heading_deg])))

    found = errors(track(179.0), track(-179.0))
    assert list(found) == list(ATTITUDE)
    assert found["heading_deg"][0] == pytest.approx(-2.0)


@n380
@pytest.mark.parametrize("start", ["coarse", "reference"])
def test_the_real_log_is_at_least_as_good_as_kf_gins_in_position(start):
    """KF-GINS on the same log: 0.35, 0.31, 0.27 m; 0.051, 0.048, 0.015 m/s; roll, pitch, heading 0.012, 0.032, 0.216 deg."""
    rms = replay(N380, ["loosely-coupled"], start=start).results[0].statistics()["rms"]
    for channel, bound in {
        "north_m": 0.35, "east_m": 0.31, "down_m": 0.27, "vn_mps": 0.051, "ve_mps": 0.048, "vd_mps": 0.015,
        "roll_deg": 0.03, "pitch_deg": 0.032, "heading_deg": 0.4,
    }.items():  # fmt: skip
        assert rms[channel] < bound, channel


@n380
def test_the_coarse_start_finds_the_heading_without_the_reference():
    result = replay(N380, ["loosely-coupled"]).results[0]
    assert abs(result.errors["heading_deg"][0]) < 6.0
    assert np.abs(result.errors["heading_deg"][(result.time > 220) & (result.time < 600)]).max() < 1.0


def synthetic_log(folder, **changes):
    """A log at rest with GNSS, described by a TOML file; `changes` replace lines of the description."""
    n, dt = 3000, 0.01
    time = np.arange(1, n + 1) * dt
    rate = geodesy.numeric.earth_rate_n(np.radians(30.0))
    imu = np.column_stack([time, np.tile(rate * dt, (n, 1)), np.zeros((n, 2)), np.full(n, -9.79 * dt)])
    np.savetxt(folder / "imu.csv", imu, delimiter=",", header="t,gx,gy,gz,ax,ay,az", comments="")
    fixes = np.arange(1.0, 30.0) + 0.0037
    columns = [fixes, np.full(29, 30.0), np.full(29, 114.0), np.full(29, 20.0)]
    np.savetxt(folder / "gnss.csv", np.column_stack(columns), delimiter=",", header="t,lat,lon,h", comments="")
    lines = {
        "imu": '[imu]\nfile = "imu.csv"\ntime = "t"\ngyro = ["gx", "gy", "gz"]\naccel = ["ax", "ay", "az"]\n'
        'kind = "increment"\nstamp = "interval_end"\ngyro_unit = "rad"\naccel_unit = "m/s"\naxes = "FRD"\nrate_hz = 100.0',
        "gnss": '[gnss]\nfile = "gnss.csv"\ntime = "t"\nlatitude = "lat"\nlongitude = "lon"\nheight = "h"\n'
        'position_unit = "deg"\nposition_sigma_m = [1.0, 1.0, 2.0]\nlever_arm_m = [0.0, 0.0, 0.0]',
        "initial": "[initial]\nstatic_until_s = 30.0\nlatitude_deg = 30.0\nlongitude_deg = 114.0\nheight_m = 20.0",
        **changes,
    }
    path = folder / "log.toml"
    path.write_text('title = "at rest"\n' + "\n".join(lines.values()))
    return path


def test_an_alignment_runs_on_a_log_without_a_reference(tmp_path):
    result = replay(synthetic_log(tmp_path), ["q-method"]).results[0]
    assert result.errors == {}
    roll, pitch, _ = attitude.numeric.to_euler(result.outputs["q_nb"][-1])
    assert abs(roll) < 1e-6 and abs(pitch) < 1e-6


@pytest.mark.parametrize(
    ("changes", "ids", "start", "message"),
    [
        ({}, ["loosely-coupled"], "coarse", "faster than 5 m/s"),
        ({}, ["loosely-coupled"], "reference", "must give position, velocity and attitude"),
        ({}, ["loosely-coupled"], "guess", "allowed is coarse, reference or stated"),
        ({"gnss": ""}, ["loosely-coupled"], "coarse", "needs GNSS"),
        ({"initial": ""}, ["loosely-coupled"], "coarse", "faster than 5 m/s"),
        ({"initial": "[initial]\nstart_s = 99.0"}, ["q-method"], "coarse", "the log ends at"),
        ({"gnss": "", "initial": ""}, ["q-method"], "coarse", "needs the place"),
    ],
)
def test_the_error_names_what_a_log_lacks_to_start_an_estimator(tmp_path, changes, ids, start, message):
    with pytest.raises(InsenvError, match=message):
        replay(synthetic_log(tmp_path, **changes), ids, start=start)


def test_a_diverging_estimator_is_told_with_its_time():
    log = load_log(ROOT / "examples" / "logs" / "plain.toml")
    delta_angle = log.delta_angle.copy()
    delta_angle[4999, 0] = np.radians(9e9) * log.dt[4999]  # which a text file may not hold
    log = replace(log, delta_angle=delta_angle)
    for id in ("loosely-coupled", "smoother"):
        with pytest.raises(InsenvError, match=r"diverged: its outputs are no longer finite numbers at (\S+) s") as caught:
            replay(log, id)
        assert float(str(caught.value).split()[-2]) == pytest.approx(float(log.imu_time[4999]), abs=2.0)
