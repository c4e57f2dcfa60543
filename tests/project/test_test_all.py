"""What runs the tests says what it runs, what it does not, and why."""

import subprocess
import sys

import mutants
import pytest
import test_all
from places import ROOT
from test_all import Outcome


def test_again_runs_what_has_not_passed_on_this_state_and_says_why():
    kept = {
        "web": Outcome("web", state="now"),
        "fmu": Outcome("fmu", failed=1, state="now"),
        "slow": Outcome("slow", state="old"),
    }
    reasons = {name: test_all.reason(kept.get(name), "now") for name in (*kept, "site")}
    line = "again: fmu (failed before); slow (the tree has changed since); site (not run before); not again: web (passed)"
    assert test_all.plan(reasons) == line


def test_a_target_without_tests_counts_its_commands(tmp_path, monkeypatch):
    monkeypatch.setattr(test_all, "KEPT", tmp_path)
    monkeypatch.setattr(test_all, "ROOT", tmp_path)
    outcome = test_all.done(
        test_all.Target("commands", "two commands", tuple((sys.executable, "-c", f"exit({n})") for n in (0, 1)))
    )
    assert (outcome.passed, outcome.failed, outcome.status) == (1, 1, 1)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["tests/nonesuch.py"], "tests/nonesuch.py: no such file or folder"),
        (["-k", "nonesuch", "tests/base"], "no test matches tests/base -k 'nonesuch'"),
    ],
)
def test_pytest_with_workers_says_why_it_runs_nothing(arguments, reason):
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "1", *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode and reason in done.stdout + done.stderr


def test_a_path_without_faults_is_named():
    with pytest.raises(SystemExit, match=r"nonesuch: .* --list shows all"):
        mutants.main(["nonesuch"])
