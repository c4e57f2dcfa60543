"""How a command ends: its exit status, and Ctrl-C, SIGTERM and SIGHUP during its work, all as a `KeyboardInterrupt`."""

from __future__ import annotations

import errno
import io
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType, TracebackType
from typing import Any

from insenv.base.starting import SIGNALS, end

DONE, FAILED, WRONG, INTERRUPTED, BROKEN_PIPE = 0, 1, 2, 130, 141
"""Exit statuses of the command."""
RETRY_S = 0.01
"""Time after which an interruption inside CasADi is tried again, s."""


class Interruptions:
    """Context manager: signals that would end the process raise `KeyboardInterrupt` during the block, and none is lost.

    number: the signal that came last; SIGINT before any.

    CasADi discards exceptions that are raised while it converts its arguments: more than half of the interruptions during
    the construction of a model.  An interruption therefore waits until no frame of CasADi is active.  A signal that is ignored
    or has a handler of the caller's keeps it.  Only the main thread can take signals: in others the block changes nothing.
    """

    def __init__(self) -> None:
        self.number: int = signal.SIGINT
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Interruptions:
        if hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread():
            default = (signal.default_int_handler, signal.SIG_DFL, end)
            taken = [number for number in SIGNALS if signal.getsignal(number) in default]
            taken += [signal.SIGALRM] if taken else []
            self._before = {number: signal.signal(number, self._interrupt) for number in taken}
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._before:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if number != signal.SIGALRM:
            self.number = number
        while frame is not None:
            if os.path.basename(frame.f_code.co_filename) == "casadi.py":
                signal.setitimer(signal.ITIMER_REAL, RETRY_S)
                return
            frame = frame.f_back
        raise KeyboardInterrupt


def ignore_from_now_on() -> None:
    """Ignore the signals that `insenv.base.starting` took: the work is done, and the process is about to exit."""
    with suppress(ValueError):  # not in the main thread
        for number in SIGNALS:
            if signal.getsignal(number) is end:
                signal.signal(number, signal.SIG_IGN)


# Standard streams that are closed, whose reader has gone, or that lack characters.


class ClosedOutput(io.TextIOBase):
    """Stands for a standard output that was closed when the process began: whatever is written to it is an error."""

    def write(self, text: str) -> int:
        raise OSError(errno.EBADF, "standard output is closed")


def prepare() -> None:
    """Let the streams be written to, or fail with an error that says why.

    Python has None for a closed stream, and the first file that is opened takes its place: tables would go into it.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    if sys.stdout is None:
        sys.stdout = ClosedOutput()
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal may lack the characters of a title


def drop_unwritten() -> None:
    """Discard output that a closed pipe or a full disk has not accepted, which would raise an error at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)


# How a command that runs without an end is ended: Ctrl-C, SIGTERM, SIGHUP and a closed terminal all mean the same.


class Ending:
    """Whether an end has been requested.

    requested: whether a signal has arrived, or the terminal is gone.  orderly: whether a first signal only sets `requested`,
    for the caller to look at; before that and at a second signal it interrupts (`KeyboardInterrupt`).
    """

    def __init__(self) -> None:
        self.requested = False
        self.orderly = False

    def __call__(self) -> bool:
        """Whether to end."""
        return self.requested


@contextmanager
def ending() -> Iterator[Ending]:
    """Take SIGINT, SIGTERM and SIGHUP as requests to end during the block.

    A shell starts the background jobs of a script with SIGINT ignored; here it counts nevertheless.  SIGHUP stays ignored
    where it was (nohup).  Only the main thread can take signals: in others nothing is taken.
    """
    request = Ending()
    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    interrupt = signal.getsignal(signal.SIGINT)
    hangup = getattr(signal, "SIGHUP", None)
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hangup is not None and signal.getsignal(hangup) is not signal.SIG_IGN:
        numbers.append(hangup)

    def take(number: int, frame: FrameType | None) -> None:
        first, request.requested = not request.requested, True
        if first and request.orderly:
            return
        if callable(interrupt):  # it keeps interruptions that CasADi would lose
            interrupt(number, frame)
        else:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, take) for number in numbers}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def written(write: Callable[[], None], request: Ending) -> None:
    """Call `write`, which prints; a terminal that is gone after a request to end is no error."""
    try:
        write()
    except BrokenPipeError:
        raise
    except OSError:
        if not request.requested:
            raise
        drop_unwritten()
