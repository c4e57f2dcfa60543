"""Intervals of the figures of a campaign."""

import numpy as np
import pytest
from campaigns import car, small_plan

from insenv.studies.campaign import make_plan, run_campaign
from insenv.studies.campaign.statistics import Estimate, _skewed, horizontal, mean_ends, percentile, root_mean_square


def test_intervals_of_percentiles_are_those_of_the_sign_test():
    """Tables of the sign test for the median; of so few as 8 runs an end of the 97.5 % is unknown."""
    for n, expected in ((10, (2.0, 9.0)), (20, (6.0, 15.0)), (64, (24.0, 41.0))):
        found = percentile(np.arange(1.0, n + 1.0), 50.0)
        assert (found.low, found.high) == expected
    found = percentile(np.arange(8.0), 97.5)
    assert np.isnan(found.high) and np.isfinite(found.low)
    assert np.isnan(percentile(np.zeros(0), 50.0).value) and np.isnan(root_mean_square(np.array([2.0])).low)


@pytest.mark.parametrize("n", [4, 8, 11, 16, 32, 64])
def test_intervals_of_skewed_squares_cover_as_often_as_they_say(n):
    """Gaussian errors of 1 to 20 independent values a run, and rms that scatter by a factor of 1.35 and 1.5."""
    rng = np.random.default_rng(n)
    families = {f"chi-square {k}": rng.chisquare(k, (8000, n)) / k for k in (1, 2, 6, 20)}
    families |= {f"log-normal {s}": np.exp(s * rng.normal(size=(8000, n)) - s**2 / 2.0) for s in (0.3, 0.6, 0.8)}
    for name, squares in families.items():
        low, high = mean_ends(squares)
        assert 0.93 <= np.mean((low <= 1.0) & (high >= 1.0)) <= 0.97, name
        assert max(np.mean(low > 1.0), np.mean(high < 1.0)) < 0.06, name
    found = root_mean_square(squares[0])
    assert (found.low**2, found.high**2) == pytest.approx((low[0], high[0]))
    found = root_mean_square(np.append(squares[0], 0.0))  # an error of exactly 0 fits no chi-square
    assert 0.0 < found.low < found.value < found.high < np.inf
    assert root_mean_square(np.full(n, 4.0)) == Estimate(2.0, 2.0, 2.0)


def test_the_upper_end_of_a_skewed_mean_solves_the_polynomial_of_hall():
    """x - g x^2 / 3 + g^2 x^3 / 27 - g / (6 n) = t, with the unbiased skewness g."""
    for n, third, t in ((6, 1.1, 0.9), (40, -0.4, 0.3)):
        x, g = float(_skewed(np.array(third), n, t)), third * np.sqrt(n * (n - 1)) / (n - 2)
        assert x - g * x**2 / 3 + g**2 * x**3 / 27 - g / (6 * n) == pytest.approx(t, rel=1e-12)


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
