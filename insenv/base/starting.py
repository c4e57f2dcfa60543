"""Ctrl-C, SIGTERM and SIGHUP while the command `insenv` loads its modules, which takes some tenths of a second.

Python would print a traceback from wherever the import stands.  This module is imported first and imports little.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from types import FrameType

BEGUN = time.time()
"""When this process imported insenv, in seconds since the epoch."""

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""The signals that end the command; its exit status is 128 plus the number, as for a shell."""
_NAMES = ("insenv", "insenv.exe", "insenv-script.py")


def is_command(argv: list[str], orig_argv: list[str]) -> bool:
    """Whether a process with this `sys.argv` and `sys.orig_argv` is the command, not a script that imports insenv.

    It is if it was started by the installed script or by ``python -m insenv``.
    """
    if not argv:
        return False
    if argv[0] == "-m":  # while `python -m NAME` imports the package of NAME
        return "-m" in orig_argv and orig_argv[orig_argv.index("-m") + 1 :][:1] == ["insenv"]
    return os.path.basename(argv[0]) in _NAMES


def message(number: int) -> str:
    """What a process says that the signal ended before anything was written."""
    ended = "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
    return f"{ended}, nothing written"


def end(number: int, frame: FrameType | None = None) -> None:
    """Handler of a signal: print one line on stderr, with --json also one document on stdout, and end the process."""
    text = message(number)
    lines = [(2, f"insenv: {text}\n")]
    if "--json" in sys.argv:
        lines.append((1, f'{{"error": {{"type": "Interrupted", "message": "{text}"}}}}\n'))
    for file, line in lines:
        try:  # noqa: SIM105 (contextlib takes long to import)
            os.write(file, line.encode())
        except OSError:
            pass
    os._exit(128 + number)


def prepare() -> None:
    """In a process that is the command, end it by `end` at a signal that would otherwise end in a traceback or silently.

    Signals that are ignored, as SIGHUP below nohup, stay ignored.
    """
    if not is_command(sys.argv, sys.orig_argv):
        return
    gc.set_threshold(50_000)  # some hundred modules are loaded, which all stay: to search them for garbage takes time
    for number in SIGNALS:
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, end)
