"""The statistics of a campaign against NumPy, from blocks with drawn errors in place of the simulated ones."""

import json
from dataclasses import replace

import numpy as np
import pytest
from campaigns import slow_ship
from scipy.stats import chi2

from insenv.campaigns import block as block_module
from insenv.campaigns import make_plan, parse_variation, run_campaign, running
from insenv.campaigns import plan as plan_module
from insenv.campaigns.block import run_block
from insenv.scenario import load

PERCENTILES = (2.5, 16.0, 50.0, 84.0, 97.5)


def parked(runs):
    """A plan of `loosely-coupled` on a parked car, at a low rate."""
    data = json.loads(load("car-city-drive").model_dump_json())
    data["vehicle"] |= {"engine": [], "legs": [{"wait_s": 60.0}]}
    data["gnss"] |= {"latency_s": 0.0, "epoch_offset_s": 0.0, "outages_s": []}
    plan = make_plan(load(data | {"rate_hz": 10.0}), "loosely-coupled", runs, first_seed=3, duration_s=4.0)
    return replace(plan, block_samples=1)  # blocks of 8 runs


@pytest.fixture
def drawn(monkeypatch):
    """`run(plan)` gives the summary, and the arrays that stood in place of errors, squares, sigmas and NEES."""

    def run(plan, change=lambda arrays: None):
        rng, kept, first = np.random.default_rng(2), [], block_module.run_block(plan, 0)

        def replaced(plan, number, stopped, part):
            arrays = {name: value.copy() for name, value in first.items()}
            runs = plan.blocks[number]
            arrays["seed"] = np.array([plan.first_seed + run for run in runs], dtype=float)
            for name in ("error", "mean_square", "mean_variance", "nees"):
                if name in arrays:
                    size = rng.normal(size=arrays[name].shape)
                    arrays[name] = size if name == "error" else np.abs(size) + 0.1
            kept.append(arrays)
            return arrays

        monkeypatch.setattr(running, "run_block", replaced)
        found = run_campaign(plan)
        order = sorted(kept, key=lambda arrays: arrays["seed"][0])
        return found, {name: np.concatenate([arrays[name] for arrays in order]) for name in order[0]}

    return run


def test_navigation_over_the_runs(drawn):
    found, arrays = drawn(parked(24))
    assert found.from_s == 0.0 and len(found.seeds) == 24
    for place, name in enumerate(found.channels):
        course, error, square = found.courses[name], arrays["error"][:, :, place], arrays["mean_square"][:, :, place]
        assert np.allclose(course.mean, error.mean(axis=0)) and np.allclose(course.rms, np.sqrt(square.mean(axis=0)))
        assert np.allclose(course.percentiles, np.percentile(error, PERCENTILES, axis=0))
        variance = arrays["mean_variance"][:, :, place]
        assert np.allclose(course.stated, np.sqrt(variance.mean(axis=0)))
        assert np.allclose(found.stated[:, place], np.sqrt(variance.mean(axis=1)))
        assert np.allclose(found.rms[:, place], np.sqrt(square.mean(axis=1)))
        assert found.figures()[name]["stated"] == pytest.approx(np.sqrt(variance.mean()))


def test_nees_has_the_bounds_of_a_mean_over_the_runs(drawn):
    """The sum over the runs is chi-square distributed; the bounds of one run would hold whatever the filter does."""
    found, arrays = drawn(parked(24))
    nees = found.nees
    assert nees.degrees == 9 and np.allclose(nees.mean, arrays["nees"].mean(axis=0))
    low, high = chi2.ppf([0.025, 0.975], 9 * 24) / 24
    assert (nees.low, nees.high) == pytest.approx((low, high))
    rng = np.random.default_rng(1)
    means = rng.chisquare(9, (4000, 24)).mean(axis=1)
    assert np.mean((means > nees.low) & (means < nees.high)) == pytest.approx(0.95, abs=0.015)


def test_alignment_counts_the_last_quarter(drawn):
    plan = replace(make_plan(slow_ship(), "analytic", 16, first_seed=3, duration_s=2.0), block_samples=1)
    found, arrays = drawn(plan)
    late = found.time >= 1.5 - 1e-9
    assert 0 < late.sum() < len(late)
    for place, name in enumerate(found.channels):
        square = arrays["mean_square"][:, late, place]
        assert np.allclose(found.rms[:, place], np.sqrt(square.mean(axis=1)))
        assert found.figures()[name]["rms"] == pytest.approx(np.sqrt(square.mean()))


def test_runs_far_from_the_median_are_listed(monkeypatch):
    """Ten times the median run, not ten times the worst: several runs may be far off."""
    plan = replace(make_plan(slow_ship(), "analytic", 16, first_seed=3, duration_s=2.0), block_samples=1)
    original = block_module.run_block

    def spoilt(plan, number, stopped, part):
        arrays = original(plan, number)
        arrays["mean_square"] = np.ones_like(arrays["mean_square"])
        for run, factor in ((1, 9.0), (2, 11.0), (5, 300.0)):
            arrays["mean_square"][run, :, 1] *= factor**2
        return arrays

    monkeypatch.setattr(running, "run_block", spoilt)
    assert run_campaign(plan).far == (5, 8, 13, 16)


def test_limits_of_runs_and_of_times_have_the_same_mean_square():
    """Runs told their heading more or less well: the limit of a run over its last quarter, that of a time over the runs."""
    variations = [parse_variation("knowledge.heading_sigma_deg=1:10")]
    found = run_campaign(make_plan(slow_ship(), "analytic", 8, first_seed=1, duration_s=2.0, variations=variations))
    late = found.time >= found.from_s - 1e-9
    for place, name in enumerate(found.channels):
        limit = found.courses[name].limit
        if limit is not None and np.isfinite(found.limit[:, place]).all():
            assert np.mean(limit[late] ** 2) == pytest.approx(np.mean(found.limit[:, place] ** 2), rel=1e-9), name
    assert np.isfinite(found.limit[:, 2]).all()


def test_a_record_holds_the_mean_square_since_the_one_before(monkeypatch):
    """The same runs recorded at every evaluation, and six times."""
    plan = make_plan(slow_ship(), "analytic", 3, first_seed=3, duration_s=3.0)
    each = run_block(plan, 0)
    monkeypatch.setattr(plan_module, "RECORDS", 6)
    assert plan.evaluation_samples == 1 and plan.evaluations == 10
    one = run_block(plan, 0)
    groups = each["error"].reshape(3, 6, 10, -1)
    assert np.allclose(one["mean_square"], np.mean(groups**2, axis=2), rtol=1e-9)
    assert np.array_equal(one["error"], groups[:, :, -1])
