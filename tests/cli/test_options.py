"""Options that several commands share."""

import pytest
from command_line import ROOT, call, refused

PLAIN = ROOT / "examples" / "logs" / "plain.toml"


def test_an_empty_path_is_refused():
    for line in (
        "run ship-swaying --out",
        f"replay {PLAIN} -e loosely-coupled -o",
        "stream ship-swaying --to udpout:127.0.0.1:14550 --tlog",
        "new scenario",
    ):
        refused(call(*line.split(), ""), "is empty: allowed is a path")


@pytest.mark.parametrize("command", [("budget", "ship-swaying"), ("fmu", "export", "ship-swaying", "-o", "x.fmu")])
def test_a_command_that_runs_one_estimator_refuses_two(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(call(*command, "-e", "q-method", "-e", "analytic"), "-e q-method -e analytic: allowed is one estimator")
    assert not list(tmp_path.iterdir())
