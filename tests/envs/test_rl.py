"""Learning: the examples' PPO on held-out seeds.  It takes minutes; `make test-rl` runs it."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from places import ROOT

if not os.environ.get("INSENV_TEST_RL"):
    pytest.skip("it trains for minutes: make test-rl runs it", allow_module_level=True)
pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed: pip install -e '.[rl]'")


def trained(example, figure, folder, *arguments):
    """Run a training example, check its figure, and return what it printed."""
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / f"{example}.py", *arguments, "--out", "figure"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr
    assert (folder / "figure" / figure).stat().st_size > 10_000
    return done.stdout


def number_after(text, printed):
    """Return the number and its standard error after some text."""
    found = re.search(re.escape(text) + r" +([+-]?[\d.]+) \+- ([\d.]+)", printed)
    assert found is not None, printed
    return float(found[1]), float(found[2])


def test_a_trained_tuner_beats_the_untuned_filter_on_held_out_seeds(tmp_path):
    printed = trained("train_tuner", "tuner.png", tmp_path)
    gain, error = number_after("PPO minus untuned, seed by seed:", printed)
    assert gain > 4 * error, printed
    rows = {
        name: float(re.search(rf"^{name} +(-?[\d.]+)", printed, re.MULTILINE)[1]) for name in ("untuned", "correct data sheets")
    }
    assert rows["correct data sheets"] > rows["untuned"] + 0.5, printed  # it is not mistuned


def test_a_trained_aligner_beats_analytic_on_held_out_seeds(tmp_path):
    printed = trained("train_aligner", "aligner.png", tmp_path, "--minutes", "3")
    learnt, classical = number_after("PPO", printed), number_after("analytic", printed)
    assert learnt[0] - classical[0] > 4.0 * np.hypot(learnt[1], classical[1]), printed


def test_a_trained_driver_is_at_least_as_good_as_the_best_fixed_pattern(tmp_path):
    printed = trained("train_manoeuvre", "manoeuvre-curve.png", tmp_path)
    gain, error = number_after("PPO minus the pattern chosen, seed by seed:", printed)
    assert gain > -2.0 * error, printed
    assert number_after("PPO", printed)[0] > number_after("random commands", printed)[0] + 0.3, printed
    assert number_after("PPO", printed)[0] < number_after("bound of the fixes", printed)[0], printed
