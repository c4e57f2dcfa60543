"""The ranking of policies in the navigation environments: whoever uses more of what is measured scores more."""

import shutil
import sys

import numpy as np
import pytest
from places import ROOT

from insenv.envs import IDS

sys.path.insert(0, str(ROOT / "examples"))
import rank_navigators

NAVIGATIONS = [id for id in IDS if "Navigation" in id]
BETTER = (
    ("random", "reported start"),
    ("random", "wander-sins"),
    ("reported start", "fixes"),
    ("wander-sins", "fixes"),
    ("fixes", "loosely-coupled"),
)
"""Worse and better.  A tilt of 0.5 deg ruins free-inertial navigation within minutes: it may lose against standing still."""


def check(id, seeds, **kwargs):
    """Check the order of the policies of an environment, seed by seed, and that the best one is near the limit."""
    found = rank_navigators.ranking(id, seeds, seed=1, **kwargs)
    for worse, better in BETTER:
        gain = found[better] - found[worse]
        error = np.std(gain) / np.sqrt(seeds)
        assert gain.mean() > 3.0 * error, f"{id}: {better} gains {gain.mean():.3f} +- {error:.3f} over {worse}"
    # the limit is a root mean square over the run: errors that change in time may score a little more than steady ones
    assert abs(found["loosely-coupled"].mean() - rank_navigators.at_the_limit()) < 0.25


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on the path: the interpreter takes minutes")
@pytest.mark.parametrize("id", NAVIGATIONS)
def test_the_ranking_over_64_seeds(id):
    check(id, 64, duration_s=300.0)


@pytest.mark.slow
def test_the_ranking_in_a_short_drive(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "interpreter")  # to compile would take longer
    check("insenv/ShipNavigation-v0", 8, duration_s=60.0)
