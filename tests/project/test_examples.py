"""The examples: each script runs from an empty folder, each description is read and agrees with its sibling."""

import os
import re
import runpy
import subprocess
import sys
from importlib.util import find_spec

import plain_log
import pytest
from places import ROOT

from insenv import replay, run
from insenv.evaluation.errors import CHANNELS
from insenv.files.toml import read_toml
from insenv.scenario import load

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
    "train_aligner.py": ("PPO", "q-method"),
    "train_manoeuvre.py": ("PPO minus the pattern", "bound of the fixes"),
    "train_tuner.py": ("PPO minus untuned", "best fixed factors"),
}


@pytest.mark.slow
def test_the_tuners_that_need_no_training_are_as_on_their_page():
    """All rows of docs/tuning-and-manoeuvre.md but that of PPO; a minute."""
    done = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / "train_tuner.py", "--steps", "0"],
        env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, encoding="utf-8", check=True,
    )  # fmt: skip
    page = (ROOT / "docs" / "tuning-and-manoeuvre.md").read_text("utf-8")
    told = {
        "untuned": "untuned",
        "best fixed factors": "best fixed factors of a search",
        "those by CMA-ES": "best fixed factors by CMA-ES",
        "correct data sheets": "filter with the correct data sheets",
    }
    for name, beginning in told.items():
        printed = re.search(rf"^{name} +(-[\d.]+.*)$", done.stdout, re.MULTILINE)[1].split()
        row = re.search(rf"^\| {re.escape(beginning)}[^|]*\|(.*)\|$", page, re.MULTILINE)[1]
        shown = re.findall(r"-?[\d.]+", row)
        digits = [len(number.partition(".")[2]) for number in shown]
        wrong = [abs(float(a) - float(b)) > 0.51 * 10.0**-n for a, b, n in zip(printed, shown, digits, strict=True)]
        assert not any(wrong), (name, printed, shown)


def test_each_script_is_named_here():
    assert {path.name for path in EXAMPLES.glob("*.py")} == set(SAID)


def test_a_missing_package_is_told_in_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "onavdata", None)
    with pytest.raises(SystemExit, match=r"^navigate_a_log\.py: .*pip install onavdata==[\d.]+$"):
        runpy.run_path(str(EXAMPLES / "navigate_a_log.py"))


SHORTER = {"rank_navigators.py": ("--seeds", "4", "--duration", "30", "insenv/ShipNavigation-v0")}
"""Arguments of scripts that take long without."""
COMPILES_LONG = {"active_alignment.py", "rank_navigators.py", "rank_policies.py"}


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow if n in COMPILES_LONG else ()) for n in sorted(SAID)])
def test_script(name, tmp_path):
    if name.startswith("train_"):
        pytest.skip("it trains for minutes: make test-rl runs it")
    if name == "navigate_a_log.py" and find_spec("onavdata") is None:
        pytest.skip("the log is in the package onavdata, which is not installed")
    done = subprocess.run(
        [sys.executable, "-W", "error", EXAMPLES / name, *SHORTER.get(name, ())],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert all(text in done.stdout for text in SAID[name]), done.stdout
    assert "nan" not in done.stdout
    assert done.stderr == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", [n for n in sorted(SAID) if n.startswith("train_")])
def test_a_script_that_trains_says_what_to_install(name, tmp_path):
    script = str(EXAMPLES / name)
    code = f"import sys, runpy; sys.modules['stable_baselines3'] = None; runpy.run_path({script!r}, run_name='__main__')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert done.returncode == 1
    assert done.stderr.startswith(f"{name}: insenv.envs.sb3 needs Stable-Baselines3, which is not installed: pip install ")
    assert done.stderr.count("\n") == 1 and "rl" in done.stderr


def test_own_scenario():
    report = run(load(EXAMPLES / "own_scenario.toml"), duration_s=5.0)
    assert [result.estimator for result in report.results] == ["q-method"]


def test_the_files_of_the_plain_log_are_those_that_its_tool_writes():
    for name, text in plain_log.files().items():
        assert (EXAMPLES / "logs" / name).read_text("utf-8") == text, f"{name}: run python tools/plain_log.py"


@pytest.mark.parametrize("start", ["coarse", "reference"])
def test_the_plain_log_navigates_within_its_sigmas(start):
    (result,) = replay(EXAMPLES / "logs" / "plain.toml", "loosely-coupled", start=start).results
    assert result.health.verdict == "consistent"
    stated = result.stated()
    rms = result.statistics()["rms"]
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
