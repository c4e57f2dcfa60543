"""What is shown: compilations once, tables as wide as the terminal."""

import logging
import os
import re
import struct
import subprocess
import sys
from contextlib import suppress

import pytest

from insenv.cli.output import compiling_noticed, print_blocks
from insenv.core.compile import COMPILED, COMPILING, LOG
from insenv.report.document import Grid


def test_a_compilation_is_said_once_though_a_package_has_given_the_root_logger_a_handler(capsys, caplog):
    with compiling_noticed():
        for text in (COMPILING, COMPILED, COMPILING):
            LOG.info(text)
    assert capsys.readouterr().err == "insenv: compiling, once\n" and not caplog.messages
    assert LOG.propagate and not LOG.isEnabledFor(logging.DEBUG)


def test_a_table_wider_than_the_screen_is_not_cut(capsys):
    cell = "walk 25.2 [19.4, 31.5] deg/h/sqrt(h), " * 4
    print_blocks([Grid(("first", "second"), [("a b", cell)])])
    assert cell.strip() in capsys.readouterr().out


@pytest.mark.skipif(os.name == "nt", reason="terminals of POSIX")
def test_tables_are_not_cut_at_a_narrow_terminal():
    import fcntl
    import pty
    import termios

    terminal, inside = pty.openpty()
    fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 50, 0, 0))
    # readline sets COLUMNS behind os.environ's back: the environment is given whole
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
    command = [sys.executable, "-m", "insenv", "run", "car-city-drive", "--duration", "5", "-e", "wander-sins"]
    running = subprocess.Popen(command, stdin=inside, stdout=inside, stderr=inside, env={**environment, "TERM": "xterm"})
    os.close(inside)
    shown = b""
    with suppress(OSError):  # the end, once the command has closed it
        while part := os.read(terminal, 65536):
            shown += part
    os.close(terminal)
    lines = [re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", line).rstrip() for line in shown.decode().splitlines()]
    row = next(line for line in lines if line.startswith("heading [deg]"))
    assert running.wait(timeout=60) == 0 and "…" not in row and len(row.split()) >= 6  # no digit is cut off
    assert max(len(line) for line in lines if line.startswith(("final", "time", "note"))) <= 50
