"""Standard streams that are closed or full, and a reader that leaves."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import SHORT
from places import ROOT

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")

PYTHON = f"'{sys.executable}' -m insenv"


def shell(line):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(["bash", "-c", line], env=environment, capture_output=True, text=True, timeout=120)
    assert "Traceback" not in done.stderr and "internal error" not in done.stderr
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("command", ["schema", "list"])
def test_a_reader_that_has_gone_ends_a_command_with_141(command):
    """The output of `schema` is larger than a pipe holds; that of others stays in buffers until the end."""
    assert shell(f"(sleep 0.01; {PYTHON} {command}; echo $? >&2) | true") == (0, "", "141\n")


def test_a_closed_stdout_is_named_after_the_work(tmp_path):
    status, _, err = shell(f"{PYTHON} {' '.join(SHORT)} --no-figure --out '{tmp_path}' >&-")
    assert status == 1 and err.endswith("insenv: standard output is closed\n")
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json", ".npz"]


def test_without_stderr_the_status_tells():
    assert shell(f"{PYTHON} run nonesuch 2>&-") == (2, "", "")
    assert shell(f"{PYTHON} run nonesuch >&- 2>&-")[0] == 2
    status, out, err = shell(f"{PYTHON} list sensors 2>&- | head -2")
    assert (status, err, out.count("\n")) == (0, "", 2)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_full_disk_on_stdout():
    status, _, err = shell(f"{PYTHON} list >/dev/full")
    assert status == 1 and "No space left" in err
