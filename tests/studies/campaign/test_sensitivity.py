"""Sensitivities to varied keys: against the shares of functions of two uniform numbers, and of a known dependence."""

import numpy as np
import pytest
from campaigns import plan_of
from changed_scenario import changed

import insenv
from insenv.studies.campaign.sensitivity import sensitivities


def of_function(design, runs, function, diverged=()):
    """Sensitivities of a function of two uniform keys; the rms of runs that diverged is wrong."""
    plan = plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=runs, design=design)
    values = plan.numbers(range(runs))
    keys = [v.key for v in plan.variations]
    x, y = (values[:, keys.index(key)] for key in ("start.latitude_deg", "start.height_m"))
    rms, whole = function(x, y), ~np.isin(np.arange(runs), diverged)
    found = sensitivities(plan, ("heading_deg",), values, np.where(whole, rms, 1e9)[:, None], whole)
    return {one.key: one for one in found}


@pytest.mark.parametrize("design", ["random", "latin", "sobol"])
def test_first_order_indices_are_the_shares_of_a_sum(design):
    """Of 3 x - y, x and y uniform, the variances are 9/12 and 1/12: 0.9 and 0.1."""
    found = of_function(design, 1024, lambda x, y: 3.0 * x - y)
    first, second = found["start.latitude_deg"], found["start.height_m"]
    assert first.first.value == pytest.approx(0.9, abs=0.05) and second.first.value == pytest.approx(0.1, abs=0.05)
    assert first.correlation > 0.9 and -0.45 < second.correlation < -0.2
    assert first.chance < 1e-6 and first.total is None


def test_total_indices_count_interactions():
    """Of (x - 1/2)(y - 1/2): neither key explains anything alone, both everything together."""
    both = [of_function("saltelli", 4 * 512, lambda x, y: (x - 0.5) * (y - 0.5), lost) for lost in ((), (6, 802))]
    for one in [one for found in both for one in found.values()]:  # a run that diverged takes its group with it
        assert abs(one.first.value) < 0.1 and one.total.value == pytest.approx(1.0, abs=0.15)


def test_the_noise_of_the_runs_is_left_to_one():
    """Half of the variance by a key, half by the seed: runs A and their crossed ones share the noise, B has its own."""
    plan = plan_of("start.latitude_deg=0:1", runs=3 * 1024, design="saltelli")
    seeds = np.array([plan.seed_of(run) for run in range(plan.runs)])
    noise = np.random.default_rng(1).normal(0.0, 12.0**-0.5, int(seeds.max()) + 1)[seeds]
    values = plan.numbers(range(plan.runs))
    (found,) = sensitivities(plan, ("heading_deg",), values, values + noise[:, None], np.full(plan.runs, True))
    assert found.first.value == pytest.approx(0.5, abs=0.1) and found.total.value == pytest.approx(0.5, abs=0.1)


def test_a_campaign_says_which_key_matters(monkeypatch):
    """The heading of an analytic alignment depends on the gyro bias to the east, b / (Omega cos L), and not on the height."""
    monkeypatch.setattr("insenv.studies.campaign.summary.VARIED_RUNS", 1)
    scenario = changed("static-ecef", start={"heading_deg": 0.0}, rate_hz=5.0)
    vary = {"imu.gyro_bias_deg_h.1": (0.0, 2.0), "start.height_m": (0.0, 100.0)}
    found = insenv.campaign(scenario, "analytic", 64, seed=1, duration_s=10.0, vary=vary)
    own = {one.key: one for one in found.sensitivity if one.channel == "heading_deg"}
    assert own["imu.gyro_bias_deg_h.1"].correlation > 0.95 and own["imu.gyro_bias_deg_h.1"].first.value > 0.8
    assert abs(own["start.height_m"].correlation) < 0.4 and own["start.height_m"].first.value < 0.2
    assert len(found.as_json()["sensitivity"]) == 6
