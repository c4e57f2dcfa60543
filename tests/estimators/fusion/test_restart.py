"""Refused fixes that agree start position and velocity anew; wrong ones do not."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from standing_car import HEADING, beyond, car_log, started

from insenv import replay
from insenv.estimators.fusion.restart import counted, restart

BENT_S = 30.0, 33.0
"""While the accelerometers are bent (s)."""


@cache
def standing():
    """The log of 70 s of a car that is told its heading."""
    return started(car_log("tactical", 70.0), heading_deg=HEADING)


def bent(log, mps2=5.0):
    """The log with a vertical accelerometer that vibration bends for three seconds."""
    wrong = (log.imu_time > BENT_S[0]) & (log.imu_time <= BENT_S[1])
    return replace(log, delta_velocity=log.delta_velocity + np.outer(np.where(wrong, log.dt, 0.0), [0.0, 0.0, mps2]))


@pytest.mark.parametrize("id", ["loosely-coupled", "fusion"])
def test_a_bent_accelerometer_costs_the_height_of_seconds_and_not_of_the_run(id):
    """Ten refused fixes would be 150 m of height; the accelerometer's bias takes up none of it."""
    result = replay(bent(standing()), id).results[0]
    count, down = result.outputs["gnss_restart_count"], result.errors["down_m"]
    assert 1 <= count[-1] <= 3 and np.argmax(count > 0) * 70.0 / len(count) < BENT_S[1] + 3.0
    assert np.abs(down).max() < 60.0 and np.abs(down[result.time > 45.0]).max() < 10.0
    assert all(beyond(result, name, result.time > 45.0) < 0.05 for name in ("roll_deg", "pitch_deg", "down_m", "vd_mps"))
    assert np.abs(result.outputs["accel_bias"][-1]).max() < 0.2
    assert "filter-restarted" in result.health.contradicted and result.health.verdict != "consistent"


def test_fixes_that_disagree_start_nothing_anew():
    """Two fixes of three are 200 m off, each in another direction."""
    log = standing()
    gnss, rng = log.gnss, np.random.default_rng(3)
    off = np.where(np.arange(len(gnss.time))[:, None] % 3 > 0, rng.normal(size=(len(gnss.time), 2)), 0.0)
    off = 200.0 * off / np.maximum(np.linalg.norm(off, axis=1, keepdims=True), 1e-9) / 6.37e6
    late = (gnss.time > 25.0)[:, None]
    wrong = replace(gnss, latitude=gnss.latitude + (off * late)[:, 0], longitude=gnss.longitude + (off * late)[:, 1])
    result = replay(replace(log, gnss=wrong), "loosely-coupled").results[0]
    assert result.outputs["fix_refused_count"][-1] > 15 and result.outputs["gnss_restart_count"][-1] == 0
    assert np.abs(result.errors["north_m"]).max() < 10.0


@pytest.mark.parametrize("velocities", [True, False])
def test_a_jump_of_the_fixes_is_followed_after_three_and_said(velocities):
    log, gnss = standing(), standing().gnss
    moved = replace(gnss, latitude=gnss.latitude + np.where(gnss.time > 40.0, 100.0 / 6.37e6, 0.0))
    moved = moved if velocities else replace(moved, velocity_n=None, velocity_sigma=None)
    result = replay(replace(log, gnss=moved), "loosely-coupled").results[0]
    assert result.outputs["gnss_restart_count"][-1] == 1 and result.outputs["fix_refused_count"][-1] == 3
    assert result.errors["north_m"][-1] == pytest.approx(100.0, abs=5.0)
    assert any("refused fixes agreed with each other" in note for note in result.notes)


@pytest.mark.parametrize(("grown_m", "measured", "agreed"), [
    (30.0, 1, 3.0), (0.0, 1, 1.0), (20.0, 1, 1.0), (0.0, 0, 3.0),
    (24.1, 1, 3.0), (35.9, 1, 3.0), (23.9, 1, 1.0), (36.1, 1, 1.0),  # +-3 sqrt(2 + 2^2 / 2) m: the noise of the four
])  # fmt: skip
def test_refused_fixes_agree_if_the_position_grows_by_the_mean_velocity(grown_m, measured, agreed):
    """Velocity 10 m/s wrong, then 20, two seconds apart; the first time that two agree nothing starts anew.

    measured: whether the velocities are present; what stands in their place does not count otherwise.
    """
    aid = SimpleNamespace(row=lambda name: name)
    x = SimpleNamespace(innovation=ca.DM([5.0, 0, 0, 10, 0, 0]), agreed=2.0, refusals=2.0, restart_count=0.0,
        covariance=ca.DM.zeros(45))  # fmt: skip
    done = restart(aid, x, ca.DM([5.0 + grown_m, 0, 0, 20, 0, 0]), ca.DM.ones(6), np.repeat([1, measured], 3), 2.0, 9)
    rows = counted(aid, x, done, 1)
    assert float(ca.evalf(rows["agreed"])) == agreed and float(ca.evalf(rows["restart_count"])) == 0.0
