"""Learning: the example's PPO beats the untuned filter on held-out seeds.  It takes minutes; `make test-rl` runs it."""

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


def test_a_trained_tuner_beats_the_untuned_filter_on_held_out_seeds(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "train_tuner.py", "--out", "figure"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "figure" / "tuner.png").stat().st_size > 10_000
    found = re.search(r"PPO minus untuned, seed by seed: ([+-][\d.]+) \+- ([\d.]+)", done.stdout)
    assert found is not None, done.stdout
    gain, error = map(float, found.groups())
    assert gain > 4 * error, done.stdout


def test_a_trained_aligner_beats_analytic_on_held_out_seeds(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "train_aligner.py", "--minutes", "3", "--out", "figure"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=3000,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "figure" / "aligner.png").stat().st_size > 10_000
    rows = re.findall(r"^(\S+) +(-[\d.]+) \+- ([\d.]+)$", done.stdout, re.M)
    found = {name: (float(mean), float(error)) for name, mean, error in rows}
    gain = found["PPO"][0] - found["analytic"][0]
    assert gain > 4.0 * np.hypot(found["PPO"][1], found["analytic"][1]), done.stdout
