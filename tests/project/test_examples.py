"""The examples: each script runs from an empty folder, each description is read and agrees with its sibling."""

import os
import re
import runpy
import subprocess
import sys

import peers
import plain_log
import pytest
from places import ROOT

from insenv import replay
from insenv.evaluation.errors import CHANNELS
from insenv.files.toml import read_toml

EXAMPLES = ROOT / "examples"
SAID = {  # what each script must print
    "active_alignment.py": ("S-turns", "straight, constant speed"),
    "align_a_ship.py": ("heading_deg", "limit"),
    "compare_estimators.py": ("q-method", "gyrocompass", "limit at the end"),
    "env_loop.py": ("aligned after", "limit"),
    "navigate_a_log.py": ("vd_mps", "KF-GINS"),
    "own_estimator.py": ("frozen frame", "q-method"),
    "rank_navigators.py": ("wander-sins", "loosely-coupled", "limit"),
    "rank_policies.py": ("quit", "bound"),
    "step_by_step.py": ("90 s", "stated sigma"),
}
TRAINING = ("train_aligner.py", "train_manoeuvre.py", "train_tuner.py")  # tests/envs/test_sb3.py looks at what they print
SHORTER = {"rank_navigators.py": ("--seeds", "4", "--duration", "30", "insenv/ShipNavigation-v0")}


def script(name, folder, *arguments):
    command = [sys.executable, "-W", "error", EXAMPLES / name, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, encoding="utf-8", timeout=600)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert not list(folder.iterdir()) and "nan" not in done.stdout
    return done.stdout


def test_each_script_is_named_here():
    assert {path.name for path in EXAMPLES.glob("*.py")} == {*SAID, *TRAINING}


@pytest.mark.slow
@pytest.mark.parametrize("name", SAID)
def test_script(name, tmp_path):
    if name == "navigate_a_log.py":
        peers.package("onavdata")
    printed = script(name, tmp_path, *SHORTER.get(name, ()))
    assert all(text in printed for text in SAID[name]), printed


@pytest.mark.slow
def test_the_tuners_that_need_no_training_are_as_on_their_page(tmp_path):
    printed = script("train_tuner.py", tmp_path, "--steps", "0")
    page = (ROOT / "docs" / "tuning-and-manoeuvre.md").read_text("utf-8")
    beginnings = {
        "untuned": "untuned",
        "best fixed factors": "best fixed factors of a search",
        "those by CMA-ES": "best fixed factors by CMA-ES",
        "correct data sheets": "filter with the correct data sheets",
    }
    for name, beginning in beginnings.items():
        found = re.search(rf"^{name} +(-[\d.]+.*)$", printed, re.MULTILINE)[1].split()
        row = re.search(rf"^\| {re.escape(beginning)}[^|]*\|(.*)\|$", page, re.MULTILINE)[1]
        for printed_number, shown in zip(found, re.findall(r"-?[\d.]+", row), strict=True):
            digits = len(shown.partition(".")[2])
            assert abs(float(printed_number) - float(shown)) <= 0.51 * 10.0**-digits, (name, found, row)


@pytest.mark.parametrize(
    ("name", "module", "said"),
    [("navigate_a_log.py", "onavdata", r": .*pip install onavdata==[\d.]+$")]
    + [(name, "stable_baselines3", r": insenv.envs.sb3 needs Stable-Baselines3, .*: pip install .*rl") for name in TRAINING],
)
def test_a_missing_package_is_told_in_one_sentence(name, module, said, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, "insenv.envs.sb3", raising=False)
    monkeypatch.setattr(sys, "argv", [name])
    with pytest.raises(SystemExit, match=f"^{name}{said}") as ended:
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert "\n" not in str(ended.value)


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


def test_the_two_descriptions_of_the_car_log_differ_in_the_velocities_alone():
    both, positions = (read_toml(EXAMPLES / f"n380-car{kind}.toml") for kind in ("", "-position-only"))
    for name in ("velocity", "velocity_sigma"):
        assert both["gnss"].pop(name)
        assert name not in positions["gnss"]
    both["imu"].pop("rate_hz")  # the same as the median step
    for section in ("imu", "gnss", "reference", "initial", "estimator"):
        assert positions[section] == both[section]
    assert positions["evaluation"]["published"] == both["evaluation"]["published"]
