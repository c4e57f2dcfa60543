"""Tuning: a filter that is mistuned on purpose is tuned back, on a scenario and on a log without a reference."""

import json
from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed
from command_line import call, strict
from scipy.stats import norm, sem, t
from simulated_log import simulated_log

import insenv
from insenv.base.errors import InputError
from insenv.estimators import get
from insenv.runs.replayed import prepared
from insenv.scenario import load
from insenv.studies import tune_log, tune_search
from insenv.studies.campaign import make_plan
from insenv.studies.campaign.block import run_block
from insenv.studies.tune_search import tuned_parameters

KEYS = ["arw_deg_sqrt_h", "vrw_ug_sqrt_hz"]
MISTUNED = {"loosely-coupled": {"arw_deg_sqrt_h": 15.0, "vrw_ug_sqrt_hz": 5.0}}


def car():
    """A drive with a receiver at 1 Hz, 50 inertial samples a second; its gyros have 0.15 deg/sqrt(h)."""
    gnss = {"latency_s": 0.0, "epoch_offset_s": 0.0, "outages_s": [], "outlier_probability": 0.0}
    scenario = changed("car-city-drive", rate_hz=50.0, gnss=gnss, vehicle={"engine": []})
    return scenario.model_copy(update={"estimator": {}})


def log_of_car(duration_s):
    return simulated_log(car(), seed=3, duration_s=duration_s, grade="tactical",
                         initial={"static_until_s": 28.0, "heading_deg": 90.0})  # fmt: skip


@pytest.mark.slow
def test_a_mistuned_filter_is_tuned_back_on_held_out_seeds():
    """White noise of the gyros 100 times too large: it comes back within a factor of 2, and the errors fall.

    The rms before and after are those of campaigns with these settings on the held-out seeds.
    """
    found = insenv.tune(car(), "loosely-coupled", runs=4, held_out=16, keys=KEYS, evaluations=64, duration_s=120.0,
                        settings=MISTUNED)  # fmt: skip
    assert found.settings()["arw_deg_sqrt_h"] == pytest.approx(0.15, rel=1.0)
    assert found.is_better and found.change.high < -0.2
    assert found.after < found.before
    ratios = {channel.name: channel.ratio for channel in found.channels}
    for name in ("roll_deg", "pitch_deg", "vn_mps", "ve_mps"):
        assert ratios[name].high < 0.8, name
    assert abs(np.log(found.consistency["after"])) < abs(np.log(found.consistency["before"]))
    assert (found.trained_on, found.judged_on) == ("seeds 1 to 4", "seeds 5 to 20")
    assert '[estimator."loosely-coupled"]' in found.toml() and "arw_deg_sqrt_h = " in found.toml()
    for given, column in ((MISTUNED["loosely-coupled"], "before"), (found.settings(), "after")):
        data = json.loads(car().model_dump_json())
        data["estimator"] = {"loosely-coupled": given}
        plan = make_plan(load(data), "loosely-coupled", 16, first_seed=5, duration_s=120.0)
        squares = run_block(plan, 0)["mean_square"].mean(axis=(0, 1))
        shown = [getattr(channel, column) for channel in found.channels]
        # the settings have 4 digits
        assert np.allclose(np.sqrt(squares), shown, rtol=1e-9 if column == "before" else 2e-3)


def test_a_mistuned_filter_is_tuned_back_on_a_log_without_a_reference():
    """By the innovations alone; the truth, which the search does not get, says that the errors have fallen."""
    log, settings = log_of_car(300.0), {"loosely-coupled": {"arw_deg_sqrt_h": 15.0}}
    blind = replace(log, reference=None)
    found = insenv.tune(blind, "loosely-coupled", keys=["arw_deg_sqrt_h"], evaluations=32, settings=settings)
    assert found.channels == () and found.is_better
    assert 0.02 < found.settings()["arw_deg_sqrt_h"] < 1.5
    errors = []
    for given in (15.0, found.settings()["arw_deg_sqrt_h"]):
        result = insenv.replay(log, "loosely-coupled", settings={"loosely-coupled": {"arw_deg_sqrt_h": given}}).results[0]
        errors.append(result.statistics()["rms"]["roll_deg"])
    assert errors[1] < 0.7 * errors[0]


def test_the_change_on_a_log_has_the_interval_of_the_means_of_ten_blocks():
    found = tune_log._change(np.repeat(np.arange(10.0), 20))
    assert [found.value, found.low, found.high] == pytest.approx([4.5, *t.interval(0.95, 9, 4.5, sem(np.arange(10.0)))])


def test_the_score_of_a_fix_is_the_predictive_density_of_its_innovations():
    """Against the outputs of a replay: what the filter states before a fix, with what the receiver states, and what came."""
    log = log_of_car(45.0)
    ready = prepared(log, ["loosely-coupled"])
    samples = np.flatnonzero(ready.columns["gnss_valid"])[1:13]
    fixes = tune_log.Fixes(ready, (), samples, tune_log._sigma(ready, samples))
    scores, squares = fixes.scores(np.ones((1, 0)), len(samples))
    result = insenv.replay(log, "loosely-coupled").results[0]
    rows = np.searchsorted(result.time, log.imu_time[ready.first + samples] - 1e-6)
    assert np.diff(result.time) == pytest.approx(0.02), "every sample is recorded"
    came = np.searchsorted(log.gnss.time, result.time[rows] - 1e-6)
    told = np.hstack([log.gnss.position_sigma, log.gnss.velocity_sigma])[came]
    stated = np.hstack([result.outputs["position_sigma"], result.outputs["velocity_sigma"]])[rows - 1]
    sigma, y = np.hypot(stated, told), result.outputs["innovation"][rows]
    assert np.abs(y / sigma).max() < 5 and (np.log(sigma).max() - np.log(sigma).min()) > 1
    assert scores[0] == pytest.approx(-norm.logpdf(y, scale=sigma) - np.log(2 * np.pi) / 2, rel=1e-9, abs=1e-9)
    assert squares[0] == pytest.approx((y / sigma) ** 2, rel=1e-9)
    # a fix that is off by more than five standard deviations counts as one that is off by five
    ready.columns["gnss_height"][samples[-1]] += 1e3
    scores, squares = fixes.scores(np.ones((1, 0)), len(samples))
    assert squares[0, -1, 2] > 1e4
    assert scores[0, -1, 2] == pytest.approx(-norm.logpdf(5 * sigma[-1, 2], scale=sigma[-1, 2]) - np.log(2 * np.pi) / 2)


def test_the_search_finds_a_minimum_and_survives_ctrl_c():
    asked = []

    def bowl(logs):
        asked.append(len(logs))
        if len(asked) == 12:
            raise KeyboardInterrupt
        return np.sum((logs - np.log([3.0, 0.5])) ** 2, axis=1)

    found = tune_search.search(bowl, 2, 400, 1, None)
    assert found.interrupted and len(found.history) == 11 == len(asked) - 1
    assert np.allclose(found.factors, [3.0, 0.5], rtol=0.5)
    asked[:] = [0] * 20
    whole = tune_search.search(bowl, 2, 400, 1, None)
    assert not whole.interrupted and np.allclose(whole.factors, [3.0, 0.5], rtol=0.05)


def test_noises_and_gates_are_tuned_by_default_and_nothing_else():
    estimator = get("loosely-coupled")
    table = estimator.model.parameters
    values = table.unpack(table.start_vector()) | {"innovation_gate": 5.0, "rotation_error": 0.0}
    rows = {parameter.row.name for parameter in tuned_parameters(estimator, values, None)}
    assert {"angle_random_walk", "velocity_random_walk", "gyro_bias_sigma", "accel_bias_sigma", "innovation_gate"} <= rows
    assert not rows & {"tilt_sigma", "heading_sigma", "position_sigma", "standing_window", "rotation_error", "fix_wander_time"}


def test_a_log_without_fixes_or_with_few_is_refused():
    with pytest.raises(InputError, match="30 fixes: tuning on a log needs at least 40"):
        insenv.tune(log_of_car(30.0), "loosely-coupled")


@pytest.mark.slow
def test_the_slow_part_of_the_fixes_error_is_not_tuned_on_a_log_by_default():
    """Innovations do not show it; where they are small and the filter models none, a note says so."""
    log = log_of_car(80.0)
    told = {"loosely-coupled": {"fix_wander_sigma_m": [1.0, 1.0, 1.0]}}
    found = insenv.tune(log, "loosely-coupled", evaluations=8, settings=told)
    assert "fix_wander_sigma_m" not in found.settings() and len(found.settings()) > 5 and not found.notes
    named = insenv.tune(log, "loosely-coupled", keys=["fix_wander_sigma_m"], evaluations=8, settings=told)
    assert set(named.settings()) == {"fix_wander_sigma_m"}
    assert "state fix_wander_sigma_m" in str(insenv.tune(log, "loosely-coupled", evaluations=8).notes)


def test_the_command_keeps_a_tuning_that_no_other_betters(tmp_path):
    """No noise of q-method changes its estimate: whatever the search ends at, the result is to be left."""
    given = ("tune", "ship-swaying", "-e", "q-method", "--evaluations", "8", "-n", "2", "--held-out", "4", "--duration", "10")
    status, out, err = call(*given, "--out", tmp_path / "out")
    assert (status, err) == (0, "") and "keep the present tuning" in out and "tuned on seeds 1 to 2" in out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"tuning.html", "tuning.json", "tuning.png", "tuning.svg", "tuning.toml"}
    assert "not significantly better on held-out data" in (tmp_path / "out" / "tuning.toml").read_text("utf-8")
    status, out, _ = call(*given, "--json")
    document = strict(out)
    assert status == 0 and document["better"] is False
    assert {"key", "before", "after", "factor"} == set(document["parameters"][0])


def test_a_filter_that_finds_its_attitude_is_tuned_without_its_alignment():
    """Whose parameters no section may set: the tuning ended with an error."""
    plan = make_plan("car-unknown-heading", "fusion", 1, duration_s=2.0)
    values = plan.chosen.model.parameters.unpack(plan.chosen.model.parameters.start_vector())
    values |= plan.plant.parameters_of(plan.chosen)
    assert any(row.startswith("alignment_") for row in values)
    keys = [parameter.key for parameter in tuned_parameters(plan.chosen, values, None)]
    assert "gyro_bias_sigma_deg_h" in keys and not any(key.startswith("alignment_") for key in keys)
