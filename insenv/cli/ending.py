"""How a command that runs without an end is ended: Ctrl-C, SIGTERM, SIGHUP and a closed terminal all mean the same."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


class Ending:
    """Whether an end has been requested.

    asked: whether a signal has arrived, or the terminal is gone.  orderly: whether a first signal only sets `asked`, for
    the caller to look at; before that and at a second signal it interrupts (`KeyboardInterrupt`).
    """

    def __init__(self) -> None:
        self.asked = False
        self.orderly = False

    def __call__(self) -> bool:
        """Whether to end."""
        return self.asked


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

    def take(number: int, frame: FrameType | None) -> None:
        first, request.asked = not request.asked, True
        if first and request.orderly:
            return
        if callable(interrupt):  # it keeps interruptions that CasADi would lose
            interrupt(number, frame)
        else:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, take) for number in _requests()}
    try:
        yield request
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _requests() -> list[int]:
    hangup = getattr(signal, "SIGHUP", None)
    ignored = hangup is None or signal.getsignal(hangup) is signal.SIG_IGN
    return [signal.SIGINT, signal.SIGTERM, *([] if ignored or hangup is None else [hangup])]


def written(write: Callable[[], None], request: Ending) -> None:
    """Call `write`, which prints; a terminal that is gone after a request to end is no error."""
    from insenv.cli.streams import drop_unwritten

    try:
        write()
    except BrokenPipeError:
        raise
    except OSError:
        if not request.asked:
            raise
        drop_unwritten()
