"""How a command ends: its exit status, and Ctrl-C, SIGTERM and SIGHUP during its work, all as a `KeyboardInterrupt`."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import suppress
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
            own = (signal.default_int_handler, signal.SIG_DFL, end)
            taken = [number for number in SIGNALS if signal.getsignal(number) in own]
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
