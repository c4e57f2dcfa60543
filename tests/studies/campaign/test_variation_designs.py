"""Designs of the varied values."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import plan_of, same, slow_ship
from scipy import stats

from insenv.base.errors import InputError
from insenv.studies.campaign import make_plan, parse_variation, run_campaign, threads
from insenv.studies.campaign.presentation import campaign_facts


def test_a_latin_hypercube_hits_every_part_once():
    plan = plan_of("start.latitude_deg=0:50", "start.height_m=0:100", runs=50, design="latin")
    numbers = plan.numbers(range(50))
    for place, variation in enumerate(plan.variations):
        parts = np.floor(np.sort(numbers[:, place]) / variation.distribution.parameters[1] * 50)
        assert np.array_equal(parts, np.arange(50))
    assert np.array_equal(numbers[7:9], plan.numbers([7, 8])) and abs(np.corrcoef(numbers.T)[0, 1]) < 0.4


def test_a_sobol_sequence_is_more_even_than_chance():
    even, chance = (
        plan_of("start.latitude_deg=0:1", "start.height_m=0:1", runs=64, design=design).numbers(range(64))
        for design in ("sobol", "random")
    )
    assert stats.qmc.discrepancy(even) < 0.2 * stats.qmc.discrepancy(chance)


def test_the_results_of_a_design_do_not_depend_on_the_blocks(monkeypatch):
    monkeypatch.setattr("insenv.studies.campaign.limits.VARIED_RUNS", 1)
    plan = make_plan(slow_ship(), "analytic", 16, first_seed=3, duration_s=2.0, design="latin",
                     variations=[parse_variation("start.latitude_deg=0:60")])  # fmt: skip
    assert same(run_campaign(plan), run_campaign(replace(plan, block_samples=1), workers=threads(2)))


def test_the_seeds_of_a_saltelli_design_are_stated_as_they_are():
    plan = plan_of("start.latitude_deg=0:1", runs=12, design="saltelli")
    assert [plan.seed_of(run) for run in range(plan.runs)] == [5, 5, 6, 7, 7, 8, 9, 9, 10, 11, 11, 12]
    assert "seeds 5 to 12," in campaign_facts(SimpleNamespace(plan=plan))


@pytest.mark.parametrize(
    ("design", "runs", "vary", "said"),
    [
        ("latn", 8, ("start.height_m=0:1",), "allowed is one of random, latin, sobol, saltelli"),
        ("latin", 8, (), "a design spreads varied keys"),
        ("saltelli", 10, ("start.height_m=0:1",), "of 1 key has groups of 3 runs, and their number is a power of 2"),
    ],
)
def test_designs_that_do_not_fit_are_refused(design, runs, vary, said):
    with pytest.raises(InputError, match=said):
        plan_of(*vary, runs=runs, design=design)
