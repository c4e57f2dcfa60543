"""The workers of a campaign, as executors: threads of this process, a pool of processes or a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from typing import Any

from insenv.base.errors import InputError
from insenv.base.installing import need

Workers = Callable[[], AbstractContextManager[Executor]]
"""Makes an executor; called again after one broke because a worker died."""

MAX_WORKERS = 4096
CONNECT_S = 20.0
_ADDRESS = re.compile(r"(tcp|tls|ucx|ws|wss)://(\[[^]]+\]|[^][:/\s]+):\d{1,5}")
RETRIES = 5
"""How often a cluster repeats a block whose worker died."""


def threads(count: int | None = None) -> Workers:
    """Threads of this process, by default one per core: compiled models release the interpreter's lock."""
    number = _checked(count) if count is not None else cores()
    return lambda: ThreadPoolExecutor(number, thread_name_prefix="insenv-campaign")


def processes(count: int) -> Workers:
    """`count` newly started processes of this machine, which inherit no state."""
    number = _checked(count)
    return lambda: Processes(number, mp_context=multiprocessing.get_context("spawn"))


class Processes(ProcessPoolExecutor):
    """Processes that ignore Ctrl-C, which a terminal sends to all of them: the main process ends them."""

    def submit(self, *call: Any, **options: Any) -> Future[Any]:
        """Start processes with SIGINT blocked, which they inherit; a signal that arrives meanwhile is raised later."""
        if not hasattr(signal, "pthread_sigmask"):
            return super().submit(*call, **options)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            with _held_back():
                return super().submit(*call, **options)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def end(self) -> None:
        """End the processes at once; what they have not finished fails.

        Its futures must not have been cancelled: the pool sets their exceptions.
        """
        for process in list((self._processes or {}).values()):
            process.terminate()


@contextmanager
def _held_back() -> Iterator[None]:
    """Hold SIGTERM and SIGHUP back while a process starts, which would read half of what it is told and print a traceback.

    Blocked they would be in the process too, which could not be ended then.
    """
    held: list[int] = []
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    in_main = threading.current_thread() is threading.main_thread()
    own = {number: handler for number, handler in handlers.items() if in_main and callable(handler)}
    for number in own:
        signal.signal(number, lambda arrived, frame: held.append(arrived))
    try:
        yield
    finally:
        for number, handler in own.items():
            signal.signal(number, handler)
        for arrived in held:
            signal.raise_signal(arrived)


def cluster(address: str) -> Workers:
    """The workers of the Dask scheduler at `address` (``tcp://host:8786``).

    Raises `InputError` for another form of address, or if Dask is not installed.
    """
    if not _ADDRESS.fullmatch(address):
        raise InputError(f"scheduler {address!r}: allowed is tcp://HOST:PORT (or tls:// and the other protocols of Dask)")
    need("a scheduler", "distributed", extra="cluster")
    from distributed import Client

    @contextmanager
    def connected() -> Iterator[Executor]:
        try:
            client = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask scheduler answers at {address!r}: {error}") from None
        with client:
            yield client.get_executor(pure=False, retries=RETRIES)

    return connected


def _checked(count: int) -> int:
    if not 1 <= count <= MAX_WORKERS:
        raise InputError(f"workers = {count}: allowed is 1 to {MAX_WORKERS}")
    return count


def cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
