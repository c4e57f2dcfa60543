"""Exit statuses: of tables whose reader has gone, and of work that the caller can mend."""

import os
import subprocess
import sys

import pytest
from command_line import call, refused

CAMPAIGN = ("campaign", "ship-swaying", "-e", "analytic", "-n", "8", "--duration", "2", "--no-figure")


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
@pytest.mark.parametrize("arguments", [CAMPAIGN, ("run", "ship-swaying", "--duration", "10", "-e", "analytic"), ("list",)])
def test_a_reader_that_has_gone_ends_a_command_with_141(arguments, tmp_path):
    out = ["--out", tmp_path / "out"] if arguments == CAMPAIGN else []
    with subprocess.Popen(
        [sys.executable, "-m", "insenv", *arguments, *out], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        process.stdout.close()
        assert process.wait(100) == 141
        assert "Traceback" not in process.stderr.read()
    if out:  # what was asked for in files is complete
        assert {path.name for path in out[1].iterdir()} >= {"campaign.json", "campaign.npz", "manifest.json", "blocks"}


def test_a_log_without_a_heading_is_a_wrong_call(tmp_path):
    to = ("--to", "udpout:127.0.0.1:9", "--speed", "0", "--duration", "10", "--tlog", tmp_path / "c.tlog")
    assert call("stream", "car-city-drive", *to)[0] == 0
    refused(call("replay", tmp_path / "c.tlog", "-e", "loosely-coupled"), "heading from motion", "[initial] heading_deg")
