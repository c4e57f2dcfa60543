"""The first use says that it compiles, once: in the progress line, and without a terminal in a line of its own."""

import os
import re
import shutil
import subprocess
import sys

import pytest
from command_line import SHORT
from places import ROOT

from insenv.cli.output import compiling_noticed
from insenv.core.compile import COMPILING, LOG

pytestmark = pytest.mark.skipif(shutil.which("cc") is None or os.name == "nt", reason="no C compiler on the path")

COMMAND = [sys.executable, "-m", "insenv", *SHORT]


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Environment of a process whose cache is empty."""
    monkeypatch.delenv("INSENV_BACKEND", raising=False)
    return {**os.environ, "PYTHONPATH": str(ROOT), "INSENV_CACHE_DIR": str(tmp_path / "cache")}


def test_piped(fresh):
    def said():
        done = subprocess.run(COMMAND, env=fresh, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0 and "compiling" not in done.stdout
        return done.stderr

    assert said() == "insenv: compiling, once\n"
    assert said() == ""


def test_it_is_said_once_though_a_package_has_given_the_root_logger_a_handler(capsys, caplog):
    with compiling_noticed():
        LOG.info(COMPILING)
    assert capsys.readouterr().err == "insenv: compiling, once\n" and not caplog.messages
    assert LOG.propagate


def test_at_a_terminal(fresh):
    from terminal import at_terminal

    def said():
        text, status = at_terminal(COMMAND, 90, environment=fresh)
        assert status == 0, text
        return re.findall(r"ship-swaying: compiling, once|insenv: compiling", text)

    first = said()
    assert first and set(first) == {"ship-swaying: compiling, once"}
    assert said() == []


def test_a_cache_that_cannot_be_used_is_named_and_the_run_goes_on(fresh, tmp_path):
    (tmp_path / "file").write_text("")
    fresh["INSENV_CACHE_DIR"] = str(tmp_path / "file" / "cache")
    done = subprocess.run(COMMAND, env=fresh, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "heading [deg]" in done.stdout
    warning, compiling = done.stderr.splitlines()
    assert "file/cache: Not a directory" in warning and "INSENV_CACHE_DIR" in warning
    assert compiling == "insenv: compiling"  # not once
