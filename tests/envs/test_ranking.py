"""The ranking of policies in the alignment environments: whoever knows more scores more, and nothing beats the sensors."""

import itertools
import sys

import numpy as np
import pytest
from places import ROOT

from insenv.envs import IDS

sys.path.insert(0, str(ROOT / "examples"))
import rank_policies

ALIGNMENTS = [id for id in IDS if "Alignment" in id]
ORDER = ("random", "quit", "analytic", "frozen frame", "q-method")


def check(id, seeds, **kwargs):
    """Check the order of the policies of an environment, seed by seed."""
    found = rank_policies.ranking(id, seeds, **kwargs)
    assert tuple(found) == ORDER
    for worse, better in itertools.pairwise(ORDER):
        gain = found[better] - found[worse]
        error = np.std(gain) / np.sqrt(seeds)
        # on a parked vehicle the frozen frame ties with the q-method
        least = -3.0 * error if better == "q-method" else 3.0 * error
        assert gain.mean() > least, f"{id}: {better} gains {gain.mean():.3f} +- {error:.3f} over {worse}"
    best = found["q-method"]
    assert best.mean() < rank_policies.bound() + 3.0 * np.std(best) / np.sqrt(seeds)


@pytest.mark.slow
def test_the_ranking_on_the_ship():
    check("insenv/ShipAlignment-v0", 16, seed=1)


@pytest.mark.slow
@pytest.mark.parametrize("id", ALIGNMENTS)
def test_the_ranking_over_64_seeds(id):
    check(id, 64, seed=1)


def test_the_bound_is_that_of_errors_of_the_limit():
    """The mean of ln(1 + rms of three normals) by a numerical integral over the Maxwell distribution."""
    rms = np.linspace(0.0, 6.0, 60_001)
    density = np.sqrt(2.0 / np.pi) * 3.0**1.5 * rms**2 * np.exp(-1.5 * rms**2)
    expected = (
        np.trapezoid(np.log1p(rms) * density, rms) if hasattr(np, "trapezoid") else np.trapz(np.log1p(rms) * density, rms)
    )
    assert rank_policies.bound() == pytest.approx(-expected - 1.0, abs=4 * 0.25 / np.sqrt(200_000))
