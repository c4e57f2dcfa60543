"""The examples: each script runs from an empty folder, and the plain log is as its tool writes it."""

import os
import subprocess
import sys

import peers
import plain_log
import pytest
from places import ROOT

from insenv import replay
from insenv.evaluation.errors import CHANNELS

EXAMPLES = ROOT / "examples"
SAID = {  # what each script must print
    "active_alignment.py": ("S-turns", "straight, constant speed"),
    "align_a_ship.py": ("heading_deg", "limit"),
    "compare_tuners.py": ("innovation-based", "oracle minus"),
    "compare_estimators.py": ("q-method", "gyrocompass", "limit at the end"),
    "env_loop.py": ("aligned after", "limit"),
    "navigate_a_log.py": ("vd_mps", "KF-GINS"),
    "own_estimator.py": ("frozen frame", "q-method"),
    "rank_navigators.py": ("wander-sins", "loosely-coupled", "limit"),
    "rank_policies.py": ("quit", "bound"),
    "step_by_step.py": ("90 s", "stated sigma"),
}
SHORTER = {
    "compare_tuners.py": ("--seeds", "4", "--evaluations", "9"),
    "rank_navigators.py": ("--seeds", "4", "--duration", "30", "insenv/ShipNavigation-v0"),
}


SCRIPTS = sorted(path.name for path in EXAMPLES.glob("[!t]*.py"))  # those that train: tests/envs


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_script(name, tmp_path):
    if name == "navigate_a_log.py":
        peers.package("onavdata")
    command = [sys.executable, "-W", "error", EXAMPLES / name, *SHORTER.get(name, ())]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, encoding="utf-8", timeout=600)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert not list(tmp_path.iterdir()) and "nan" not in done.stdout
    assert all(text in done.stdout for text in SAID[name]), done.stdout


def test_the_files_of_the_plain_log_are_those_that_its_tool_writes():
    for name, text in plain_log.files().items():
        assert (EXAMPLES / "logs" / name).read_text("utf-8") == text, f"{name}: run python tools/plain_log.py"


def test_the_plain_log_navigates_within_its_sigmas():
    (result,) = replay(EXAMPLES / "logs" / "plain.toml", "loosely-coupled").results
    assert result.health.verdict == "consistent"
    stated, rms = result.stated(), result.statistics()["rms"]
    assert set(rms) == set(CHANNELS) & set(stated)
    # one run, in which errors that change slowly (heading, biases behind tilt) are one draw
    assert all(rms[name] < 3 * stated[name] for name in rms)
