"""Intervals of the figures of a campaign."""

import numpy as np
import pytest
from campaigns import car, small_plan
from scipy import stats

from insenv.studies.campaign import make_plan, run_campaign
from insenv.studies.campaign.statistics import horizontal, percentile, root_mean_square


def test_intervals_cover_the_truth_as_often_as_they_say():
    """1000 ensembles of 64 Gaussian runs; of so few as 8, there is no end."""
    drawn = np.random.default_rng(3).normal(size=(1000, 64))
    true = {50.0: 0.0, 84.0: stats.norm.ppf(0.84)}
    for percent, value in true.items():
        inside = [e.low <= value <= e.high for e in (percentile(values, percent) for values in drawn)]
        assert 0.935 <= np.mean(inside) <= 0.99, percent
    inside = [e.low <= 1.0 <= e.high for e in (root_mean_square(values**2) for values in drawn)]
    assert 0.92 <= np.mean(inside) <= 0.98
    found = percentile(np.arange(8.0), 97.5)
    assert np.isnan(found.high) and np.isfinite(found.low)
    assert np.isnan(percentile(np.zeros(0), 50.0).value) and np.isnan(root_mean_square(np.array([2.0])).low)


def test_cep_and_2drms_of_a_circular_gaussian():
    """sigma sqrt(2 ln 2) and 2 sqrt(2) sigma (Kaplan and Hegarty 2017, section 11.2)."""
    north, east = np.random.default_rng(4).normal(0.0, 3.0, (2, 4000))
    found = horizontal(north, east)
    for name, true in (("cep", 3.0 * 1.17741), ("r95", 3.0 * np.sqrt(-2.0 * np.log(0.05))), ("2drms", 6.0 * np.sqrt(2.0))):
        assert found[name].low <= true <= found[name].high, name
        assert found[name].high - found[name].low < 0.1 * true


def test_a_campaign_states_them():
    found = run_campaign(make_plan(car(), "loosely-coupled", 12, first_seed=1, duration_s=3.0))
    document = found.as_json()
    row, north = document["errors"]["north_m"], found.final[:, found.channels.index("north_m")]
    assert row["rms_95"][0] < row["rms"] < row["rms_95"][1]
    assert row["percentiles_95"]["50"] == [percentile(north, 50.0).low, percentile(north, 50.0).high]
    assert document["horizontal"]["cep"]["value"] == pytest.approx(np.median(np.hypot(*found.final[:, 3:5].T)))
    assert run_campaign(small_plan(8)).as_json()["horizontal"] is None
