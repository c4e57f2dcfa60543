"""What is shown: compilations once, tables as wide as the terminal."""

import io
import logging
import os
import re
import shutil
import subprocess
import sys

import pytest
from command_line import SHORT
from places import ROOT

from insenv.cli.output import compiling_noticed, print_parts, working
from insenv.core.compile import COMPILED, COMPILING, LOG
from insenv.report.tables import table_of

COMMAND = [sys.executable, "-m", "insenv", *SHORT]


def test_a_compilation_is_said_once_though_a_package_has_given_the_root_logger_a_handler(capsys, caplog):
    with compiling_noticed():
        for text in (COMPILING, COMPILED, COMPILING):
            LOG.info(text)
    assert capsys.readouterr().err == "insenv: compiling, once\n" and not caplog.messages
    assert LOG.propagate and not LOG.isEnabledFor(logging.DEBUG)


def test_at_a_terminal_it_is_said_in_the_progress_line(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr("sys.stderr", terminal := Terminal())
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    with compiling_noticed(), working("ship") as bar:
        LOG.info(COMPILING)
        bar._progress.refresh()
        assert "ship: compiling, once" in terminal.getvalue() and "insenv:" not in terminal.getvalue()
        LOG.info(COMPILED)
        terminal.truncate(0)
        bar(1, 2)
        bar._progress.refresh()
        assert "ship" in terminal.getvalue() and "compiling" not in terminal.getvalue()


def test_a_table_wider_than_the_screen_is_not_cut(capsys):
    cell = "walk 25.2 [19.4, 31.5] deg/h/sqrt(h), " * 4
    table = table_of("first", "second")
    table.add_row("a b", cell)
    print_parts([table])
    assert cell.strip() in capsys.readouterr().out


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """Environment of a process whose cache is empty."""
    if shutil.which("cc") is None or os.name == "nt":
        pytest.skip("no C compiler on the path")
    monkeypatch.delenv("INSENV_BACKEND", raising=False)
    return {**os.environ, "PYTHONPATH": str(ROOT), "INSENV_CACHE_DIR": str(tmp_path / "cache")}


@pytest.mark.slow
def test_the_first_use_says_that_it_compiles(fresh, tmp_path):
    def said():
        done = subprocess.run(COMMAND, env=fresh, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0 and "compiling" not in done.stdout and "heading [deg]" in done.stdout
        return done.stderr

    assert said() == "insenv: compiling, once\n" and said() == ""
    (tmp_path / "file").write_text("")
    fresh["INSENV_CACHE_DIR"] = str(tmp_path / "file" / "cache")  # cannot be used: named, and the run goes on
    warning, compiling = said().splitlines()
    assert "file/cache: Not a directory" in warning and "INSENV_CACHE_DIR" in warning
    assert compiling == "insenv: compiling"  # not once


@pytest.mark.slow
def test_the_first_use_at_a_terminal(fresh):
    from terminal import at_terminal

    def said():
        text, status = at_terminal(COMMAND, 90, environment=fresh)
        assert status == 0, text
        return re.findall(r"ship-swaying: compiling, once|insenv: compiling", text)

    assert set(said()) == {"ship-swaying: compiling, once"} and said() == []


def shown(columns, *arguments):
    from terminal import at_terminal

    command = [sys.executable, "-m", "insenv", *arguments]
    text, status = at_terminal(command, columns, environment={"PYTHONPATH": str(ROOT)})
    assert status == 0, text
    return [re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", line).rstrip() for line in text.splitlines()]


@pytest.mark.skipif(os.name == "nt", reason="terminals of POSIX")
def test_lists_follow_the_width_of_the_terminal():
    narrow, wide = (shown(columns, "list", "estimators") for columns in (70, 160))
    assert max(map(len, narrow)) == 70 and 100 < max(map(len, wide)) <= 160 and len(wide) < len(narrow)


@pytest.mark.skipif(os.name == "nt", reason="terminals of POSIX")
@pytest.mark.parametrize("columns", [50, *(pytest.param(wider, marks=pytest.mark.slow) for wider in (80, 160))])
def test_tables_are_not_cut_at_a_terminal(columns):
    lines = shown(columns, "run", "car-city-drive", "--duration", "5", "-e", "wander-sins")
    row = next(line for line in lines if line.startswith("heading [deg]"))
    assert "…" not in row and len(row.split()) >= 6  # no digit is cut off
    assert max(len(line) for line in lines if line.startswith(("final", "time", "note"))) <= columns
