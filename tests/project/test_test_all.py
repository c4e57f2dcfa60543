"""What runs the tests says what it runs, what it does not, and why."""

import subprocess
import sys

import mutants
import pytest
import test_all
from places import ROOT
from test_all import Outcome, Target


def test_again_says_what_it_runs_and_why_and_a_target_without_tests_counts_its_commands(tmp_path, monkeypatch):
    kept = {"web": Outcome("web", state="now"), "fmu": Outcome("fmu", 0, 1, state="now"), "slow": Outcome("slow", state="old")}
    reasons = {name: test_all.reason(kept.get(name), "now") for name in (*kept, "site")}
    line = "again: fmu (failed before); slow (the tree has changed since); site (not run before); not again: web (passed)"
    assert test_all.plan(reasons) == line
    monkeypatch.setattr(test_all, "KEPT", tmp_path)
    monkeypatch.setattr(test_all, "ROOT", tmp_path)
    outcome = test_all.done(Target("two", "commands", tuple((sys.executable, "-c", f"exit({status})") for status in (0, 1))))
    assert (outcome.passed, outcome.failed, outcome.status) == (1, 1, 1)


@pytest.mark.parametrize(("chosen", "reason"), [
    (["tests/none.py"], "tests/none.py: no such file or folder"),
    pytest.param(["-k", "none", "tests"], "no test matches tests -k 'none'", marks=pytest.mark.slow),
    pytest.param(["-k", "a b"], "-k 'a b': expected end of input", marks=pytest.mark.slow),
])  # fmt: skip
def test_pytest_with_workers_says_why_it_runs_nothing(chosen, reason, tmp_path):
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "1", *chosen]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode and reason in done.stdout + done.stderr


def test_a_path_without_faults_is_named():
    with pytest.raises(SystemExit, match=r"none: .* --list shows all"):
        mutants.main(["none"])
