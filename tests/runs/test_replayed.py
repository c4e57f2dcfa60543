"""Replays of recorded logs: a real one against KF-GINS, and what a log lacks."""

import os
import re
from dataclasses import replace
from functools import cache
from unittest import mock

import numpy as np
import pytest
from places import ROOT
from simulated_log import simulated_log
from written_logs import written_log

from insenv import attitude, replay, tune
from insenv.base.errors import InsenvError
from insenv.logs import load as load_log
from insenv.logs.outages import withheld
from insenv.runs.follower import Follower
from insenv.scenario import load as scenario_of


def test_the_real_log_is_at_least_as_good_as_kf_gins_in_position():
    """KF-GINS on the same log: 0.35, 0.31, 0.27 m; 0.051, 0.048, 0.015 m/s; roll, pitch, heading 0.012, 0.032, 0.216 deg."""
    log = load_log(ROOT / "examples" / "n380-car.toml")
    assert log.imu_time.shape == (69144,) and log.gnss.time.shape == (673,) and log.reference.time.shape == (66946,)
    assert log.rate_hz == pytest.approx(100.0, abs=0.01) and log.duration_s == pytest.approx(691.4, abs=0.1)
    assert (log.gaps.count, log.gaps.samples) == (1, 1) and log.notes == ()
    assert log.gaps.intervals[0][0] == pytest.approx(38.188, abs=1e-3)
    common = log.stated_errors["fix_common_sigma"]  # of a receiver that states six times as much in the first minute
    assert common == pytest.approx([0.484, 0.450, 0.991], abs=1e-3)
    with mock.patch.dict(os.environ, INSENV_BACKEND="native"):
        result = replay(log, ["loosely-coupled"]).results[0]
    rms = result.statistics()["rms"]
    for channel, bound in {
        "north_m": 0.35, "east_m": 0.31, "down_m": 0.27, "vn_mps": 0.051, "ve_mps": 0.048, "vd_mps": 0.015,
        "roll_deg": 0.03, "pitch_deg": 0.032, "heading_deg": 0.4,
    }.items():  # fmt: skip
        assert rms[channel] < bound, channel
    # the heading is found without the reference
    assert abs(result.errors["heading_deg"][0]) < 6.0
    assert np.abs(result.errors["heading_deg"][(result.time > 220) & (result.time < 600)]).max() < 1.0


def test_a_position_states_no_less_than_what_its_fixes_may_have_in_common(tmp_path):
    """Where the description does not say how much of their error is slow; estimates are the same to the bit."""
    path = written_log(tmp_path, duration_s=40.0, scale_of_sigma=20.0)
    white, ids = load_log(path), ["loosely-coupled", "smoother", "fusion"]
    path.write_text(path.read_text("utf-8").replace("wander_sigma_m = 0.0\n", ""), encoding="utf-8")
    silent = load_log(path)
    common = 0.95 * np.median(silent.gnss.position_sigma, axis=0)
    reports = [replay(log, ids, outages="+20:+30") for log in (white, silent)]
    assert [[note for note in report.notes if note.code == "fixes-common-error"] != [] for report in reports] == [False, True]
    for each, stated in zip(*(report.results for report in reports), strict=True):
        for name, values in each.outputs.items():
            if name != "position_sigma":
                np.testing.assert_array_equal(values, stated.outputs[name])
        expected = np.hypot(each.outputs["position_sigma"], common)
        np.testing.assert_allclose(stated.outputs["position_sigma"], expected, rtol=1e-14)
        assert not any(note.code == "fixes-slow-errors" for note in stated.notes)
        before, after = (result.outages.each[0].sigma for result in (each, stated))
        np.testing.assert_allclose(after, before, rtol=1e-6)  # a withheld fix has that error, too: it counts once


def test_a_tuning_compares_fixes_with_what_the_filter_itself_predicts(tmp_path):
    path = written_log(tmp_path, duration_s=80.0)
    stated = tune(path, "loosely-coupled", keys=["arw_deg_sqrt_h"], evaluations=2)
    path.write_text(path.read_text("utf-8").replace("wander_sigma_m = 0.0\n", ""), encoding="utf-8")
    silent = tune(path, "loosely-coupled", keys=["arw_deg_sqrt_h"], evaluations=2)
    assert silent.settings() == stated.settings() and (silent.before, silent.after) == (stated.before, stated.after)


@cache
def parked(gnss=True):
    """A log at rest with fixes, without a reference."""
    log = simulated_log("car-parked", duration_s=30.0, initial={"static_until_s": 30.0})
    fixes = simulated_log("car-city-drive", duration_s=25.0)
    return replace(log, gnss=fixes.gnss if gnss else None, reference=None)


def test_an_alignment_runs_on_a_log_without_a_reference():
    result = replay(parked(), ["q-method"]).results[0]
    assert result.errors == {}
    roll, pitch, _ = attitude.numeric.to_euler(result.outputs["q_nb"][-1])
    start = scenario_of("car-parked").start
    assert np.degrees([roll, pitch]) == pytest.approx([start.roll_deg, start.pitch_deg], abs=0.2)


@pytest.mark.parametrize(("changes", "id", "start", "message"), [
    ({}, "loosely-coupled", "coarse", "heading at the start: no instrument measures it"),
    ({}, "loosely-coupled", "reference", "must give position, velocity and attitude"),
    ({"gnss": False}, "loosely-coupled", "coarse", "needs GNSS"),
    ({"gnss": False}, "q-method", "coarse", "needs the place"),
])  # fmt: skip
def test_the_error_names_what_a_log_lacks_to_start_an_estimator(changes, id, start, message):
    with pytest.raises(InsenvError, match=message):
        replay(parked(**changes), id, start=start)


def test_an_estimator_that_the_log_is_not_for_does_not_stop_the_others():
    report = replay(log := parked(), ["loosely-coupled", "q-method"])
    assert [result.estimator for result in report.results] == ["q-method"]
    assert report.notes[0].startswith("loosely-coupled is left out: heading at the start")
    with pytest.raises(InsenvError, match=r"(?s)loosely-coupled is left out.*wander-sins is left out"):
        replay(log, ["loosely-coupled", "wander-sins"])


def test_withheld_fixes_judge_what_ran_without_them():
    log = load_log(ROOT / "examples" / "logs" / "plain.toml")
    report = replay(log, ["loosely-coupled", "smoother", "q-method"], outages=["60:80"])
    assert any("q-method is left out" in note for note in report.notes)
    without = replay(withheld(log, ["60:80"], 0.0)[0], "loosely-coupled").results[0].outputs
    assert all(np.array_equal(report.results[0].outputs[name], values) for name, values in without.items())
    for each in report.results:  # fixes of 0.6 and 0.9 m
        (one,) = each.outages.each
        of_truth = np.stack([np.interp(one.time, each.time, each.errors[name]) for name in ("north_m", "east_m", "down_m")], -1)
        assert len(one.time) == 20 and np.abs((one.error - of_truth) / [0.6, 0.6, 0.9]).max() < 4.0


def test_a_diverging_estimator_is_told_with_its_time():
    log = load_log(ROOT / "examples" / "logs" / "plain.toml")
    delta_angle = log.delta_angle.copy()
    delta_angle[4999, 0] = np.radians(9e9) * log.dt[4999]  # which a text file may not hold
    log = replace(log, delta_angle=delta_angle)
    for id in ("loosely-coupled", "smoother"):
        with pytest.raises(InsenvError, match=r"diverged: its outputs are no longer finite numbers at (\S+) s") as caught:
            replay(log, id)
        at = float(re.search(r"numbers at (\S+) s; stop_s", str(caught.value))[1])
        assert at == pytest.approx(float(log.imu_time[4999]), abs=2.0)


def test_an_estimator_that_diverges_does_not_take_the_others_with_it(monkeypatch):
    log, follow = load_log(ROOT / "examples" / "logs" / "plain.toml"), Follower.follow

    def lost(self, columns, count):
        if self.estimator.id == "loosely-coupled":
            raise InsenvError("estimator 'loosely-coupled' diverged: it is gone")
        return follow(self, columns, count)

    alone = replay(log, "fusion").results[0]
    monkeypatch.setattr(Follower, "follow", lost)
    report = replay(log, ["loosely-coupled", "fusion"])
    (result,) = report.results
    assert result.estimator == "fusion" and np.array_equal(result.outputs["q_nb"], alone.outputs["q_nb"])
    assert "loosely-coupled is left out: it diverged: it is gone" in report.notes
