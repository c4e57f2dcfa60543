"""Designs of the varied values, and the sensitivities that they give."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import assert_shows, plan_of, printed, same, slow_ship
from scipy import stats

import insenv
from insenv.campaigns import make_plan, parse_variation, run_campaign, threads
from insenv.campaigns.campaign_page import campaign_page_document
from insenv.campaigns.presentation import campaign_facts, campaign_tables
from insenv.campaigns.sensitivity import sensitivities
from insenv.errors import InputError
from insenv.scenario import load


def test_a_latin_hypercube_hits_every_part_once():
    plan = plan_of("start.latitude_deg=0:50", "start.height_m=0:100", runs=50, design="latin")
    numbers = plan.numbers(range(50))
    for place, variation in enumerate(plan.variations):
        parts = np.floor(np.sort(numbers[:, place]) / variation.distribution.parameters[1] * 50)
        assert np.array_equal(parts, np.arange(50))
    assert np.array_equal(numbers[7:9], plan.numbers([7, 8]))
    assert abs(np.corrcoef(numbers.T)[0, 1]) < 0.4


def test_a_sobol_sequence_is_more_even_than_chance():
    even, chance = (
        plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=64, design=design).numbers(range(64))
        for design in ("sobol", "random")
    )
    assert stats.qmc.discrepancy(even) < 0.2 * stats.qmc.discrepancy(chance)


def test_the_results_of_a_design_do_not_depend_on_the_blocks():
    plan = make_plan(slow_ship(), "analytic", 16, first_seed=3, duration_s=2.0, design="latin",
                     variations=[parse_variation("start.latitude_deg=0:60")])  # fmt: skip
    assert same(run_campaign(plan), run_campaign(replace(plan, block_samples=1), workers=threads(2)))


@pytest.mark.parametrize(
    ("design", "runs", "vary", "said"),
    [
        ("latn", 8, ("start.height_m=0:1",), "allowed is one of random, latin, sobol, saltelli"),
        ("latin", 8, (), "a design spreads varied keys"),
        (
            "saltelli",
            10,
            ("start.height_m=0:1",),
            "of 1 key has groups of 3 runs, and their number is a power of 2",
        ),
    ],
)
def test_designs_that_do_not_fit_are_refused(design, runs, vary, said):
    with pytest.raises(InputError, match=said):
        plan_of(*vary, runs=runs, design=design)


# --- sensitivity --------------------------------------------------------------------------------------


def of_function(design, runs, function):
    """Sensitivities of a function of two uniform keys."""
    plan = plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=runs, design=design)
    values = plan.numbers(range(runs))
    keys = [v.key for v in plan.variations]
    x, y = (values[:, keys.index(key)] for key in ("start.latitude_deg", "start.height_m"))
    found = sensitivities(plan, ("heading_deg",), values, function(x, y)[:, None], np.full(runs, True))
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
    found = of_function("saltelli", 4 * 512, lambda x, y: (x - 0.5) * (y - 0.5))
    for one in found.values():
        assert abs(one.first.value) < 0.1
        assert one.total.value == pytest.approx(1.0, abs=0.15)


def test_the_noise_of_the_runs_is_left_to_one():
    """Half of the variance by a key, half by the seed: runs A and their crossed ones share the noise, B has its own."""
    plan = plan_of("start.latitude_deg=0:1", runs=3 * 1024, design="saltelli")
    seeds = np.array([plan.seed_of(run) for run in range(plan.runs)])
    assert np.array_equal(seeds[:6], [5, 5, 6, 7, 7, 8])
    noise = np.random.default_rng(1).normal(0.0, 12.0**-0.5, int(seeds.max()) + 1)[seeds]
    values = plan.numbers(range(plan.runs))
    (found,) = sensitivities(plan, ("heading_deg",), values, values + noise[:, None], np.full(plan.runs, True))
    assert found.first.value == pytest.approx(0.5, abs=0.1) and found.total.value == pytest.approx(0.5, abs=0.1)


def test_the_seeds_of_a_saltelli_design_are_stated_as_they_are():
    plan = plan_of("start.latitude_deg=0:1", runs=12, design="saltelli")
    seeds = [plan.seed_of(run) for run in range(plan.runs)]
    assert seeds == [5, 5, 6, 7, 7, 8, 9, 9, 10, 11, 11, 12]
    assert "seeds 5 to 12," in campaign_facts(SimpleNamespace(plan=plan))


def test_a_campaign_says_which_key_matters(monkeypatch):
    """The heading of an analytic alignment depends on the gyro bias to the east, b / (Omega cos L), and not on the height."""
    monkeypatch.setattr("insenv.campaigns.limits.VARIED_RUNS", 1)
    data = json.loads(load("static-ecef").model_dump_json())
    data["start"] |= {"heading_deg": 0.0}
    vary = {"imu.gyro_bias_deg_h.1": (0.0, 2.0), "start.height_m": (0.0, 100.0)}
    found = insenv.campaign(load(data | {"rate_hz": 20.0}), "analytic", 64, seed=1, duration_s=10.0, vary=vary)
    own = {one.key: one for one in found.sensitivity if one.channel == "heading_deg"}
    assert own["imu.gyro_bias_deg_h.1"].correlation > 0.95 and own["imu.gyro_bias_deg_h.1"].first.value > 0.8
    assert abs(own["start.height_m"].correlation) < 0.4 and own["start.height_m"].first.value < 0.2
    first = own["start.height_m"].first
    told = printed(campaign_tables(found))
    assert f"{first.value:.2f} ±{first.reach:.2f}" in told and "(alone), ±: half" in told
    assert_shows(campaign_page_document(found), campaign_tables(found))
    document = found.as_json()
    assert document["design"] == "random" and len(document["sensitivity"]) == 6
