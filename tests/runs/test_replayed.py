"""Replays of recorded logs: a real one against KF-GINS, and what a log lacks."""

import os
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from places import ROOT

from insenv import attitude, geodesy, replay
from insenv.errors import InsenvError
from insenv.logs import load as load_log


@pytest.mark.parametrize("start", ["coarse", pytest.param("reference", marks=pytest.mark.slow)])
def test_the_real_log_is_at_least_as_good_as_kf_gins_in_position(start):
    """KF-GINS on the same log: 0.35, 0.31, 0.27 m; 0.051, 0.048, 0.015 m/s; roll, pitch, heading 0.012, 0.032, 0.216 deg."""
    with mock.patch.dict(os.environ, INSENV_BACKEND="native"):  # 69,144 samples
        result = replay(ROOT / "examples" / "n380-car.toml", ["loosely-coupled"], start=start).results[0]
    rms = result.statistics()["rms"]
    for channel, bound in {
        "north_m": 0.35, "east_m": 0.31, "down_m": 0.27, "vn_mps": 0.051, "ve_mps": 0.048, "vd_mps": 0.015,
        "roll_deg": 0.03, "pitch_deg": 0.032, "heading_deg": 0.4,
    }.items():  # fmt: skip
        assert rms[channel] < bound, channel
    # the heading is found without the reference
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
