"""Run a campaign: distribute its blocks, store them as they finish, and repeat those whose worker died."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
import tempfile
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
    wait,
)
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

from insenv.base.errors import InputError, InsenvError
from insenv.base.installing import need
from insenv.base.output import as_path
from insenv.base.shipped import __version__
from insenv.core.compile import NoRoomError, batch_library_path
from insenv.core.runner import Progress, check_progress, resolve_backend
from insenv.estimators import Estimator, get_all
from insenv.estimators.registry import knowing_objects
from insenv.estimators.settings import Settings
from insenv.scenario import ScenarioLike, with_settings
from insenv.scenario.variation import Variation, variation_of
from insenv.studies.campaign.block import Arrays, StoppedError, run_block
from insenv.studies.campaign.comparison import Comparison, compare
from insenv.studies.campaign.plan import Plan, make_plan
from insenv.studies.campaign.store import MANIFEST, Folder, Memory, check_compared
from insenv.studies.campaign.summary import Summary, campaign_limit, summarise

# The workers of a campaign, as executors: threads of this process, a pool of processes or a Dask cluster.

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
    """Hold SIGTERM and SIGHUP back while a process starts, which would read half of its message and print a traceback.

    Blocked they would be in the process too, which could not be ended then.
    """
    held: list[int] = []
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    in_main = threading.current_thread() is threading.main_thread()
    to_hold = {number: handler for number, handler in handlers.items() if in_main and callable(handler)}
    for number in to_hold:
        signal.signal(number, lambda arrived, frame: held.append(arrived))
    try:
        yield
    finally:
        for number, handler in to_hold.items():
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


STOPPING_S = 3.0
"""Time that blocks have to leave what is done of them, s: they look about twice a second."""
ATTEMPTS = 4
"""Number of consecutive executors that may lose their workers, with no block finished, before the campaign fails."""


@knowing_objects
def campaign(
    scenario: ScenarioLike,
    estimator: str | Estimator | Sequence[str | Estimator],
    runs: int,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    vary: Mapping[str, Any] | None = None,
    design: str = "random",
    settings: Settings | None = None,
    folder: str | Path | None = None,
    resume: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Summary | Comparison:
    """Run a scenario many times with an estimator (Monte Carlo) and summarise the errors; or with several, and compare them.

    Parameters
    ----------
    scenario: a name that ``insenv list`` shows, the path of a ``.toml`` file, a `Scenario`, or the values of such a file.
    estimator: an id or an `Estimator`; or a list of them: all get the same runs, and the result is a `Comparison` with the
        first one.
    runs: number of runs; run i has the seed `seed` + i (None: the scenario's).
    duration_s: instead of the scenario's, s.
    vary: by key of the scenario (``"imu.gyro_bias_deg_h"``), from what each run draws its value: a range (low, high), a list of
        choices, or a text such as ``"normal(0, 0.01)"`` or ``"choice(tactical, mems)"`` (docs/campaigns.md).
    design: how the values are spread over the runs: "random", "latin", "sobol" or "saltelli".
    settings: parameters by estimator id, as of `insenv.run`.
    folder: where finished blocks are kept, of several estimators each in a folder of its id.
    resume: whether an interrupted campaign in the folder continues.
    workers: number of processes, which a script may start only below ``if __name__ == "__main__":``; None: threads.
    progress: called with the numbers of inertial samples done and in all; for the limit, once more from the first.

    Raises `InputError` for what is unknown, wrong, or cannot run; `InsenvError` if workers die again and again.
    """
    if vary is not None and not (isinstance(vary, Mapping) and all(isinstance(key, str) for key in vary)):
        raise InputError(f"vary = {vary!r}: allowed is a dict of ranges by key of the scenario")
    several = isinstance(estimator, Sequence) and not isinstance(estimator, str)
    chosen: list[str | Estimator] = list(estimator) if several else [estimator]  # type: ignore[arg-type, list-item]
    variations = [variation_of(key, spread) for key, spread in (vary or {}).items()]
    plans = make_plans(
        scenario, chosen, runs, first_seed=seed, duration_s=duration_s, variations=variations, design=design, settings=settings
    )
    if resume and folder is None:
        raise InputError("resume = True: name the folder that holds the campaign")
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int)):
        raise InputError(f"workers = {workers!r}: allowed is a whole number of processes")
    stores = stores_of(None if folder is None else as_path("folder", folder), plans, resume)
    summaries = run_campaigns(plans, stores, None if workers is None else processes(workers), progress)
    return compare(summaries) if several else summaries[0]


def make_plans(
    scenario: ScenarioLike,
    estimators: Sequence[str | Estimator],
    runs: int,
    *,
    first_seed: int | None = None,
    duration_s: float | None = None,
    variations: Sequence[Variation] = (),
    design: str = "random",
    settings: Settings | None = None,
) -> list[Plan]:
    """The plans of estimators on the same runs; one that is named twice runs once.  Raises `InputError` as `make_plan`."""
    scenario = with_settings(scenario, settings, estimators)
    return [
        make_plan(scenario, each, runs, first_seed=first_seed, duration_s=duration_s, variations=variations, design=design)
        for each in get_all(estimators)
    ]


def stores_of(folder: Path | None, plans: Sequence[Plan], resume: bool) -> list[Folder | None]:
    """Where the blocks of each plan are kept: in `folder`, those of several each in a folder of the estimator's id."""
    if folder is None:
        return [None] * len(plans)
    check_compared(folder, plans)
    if len(plans) == 1:
        return [Folder(folder, plans[0], resume)]
    if (folder / MANIFEST).exists():
        raise InputError(f"{str(folder)!r} holds the campaign of one estimator: choose another folder for several")
    # with resume, a campaign that was not begun begins
    return [Folder(folder / plan.estimator, plan, resume) for plan in plans]


def run_campaigns(
    plans: Sequence[Plan], stores: Sequence[Memory | Folder | None], workers: Workers | None, progress: Progress | None
) -> list[Summary]:
    """Run plans one after the other, as `run_campaign` does."""
    check_progress(progress)
    summaries = []
    for place, (plan, store) in enumerate(zip(plans, stores, strict=True)):

        def report(done: int, total: int, before: int = place) -> None:
            assert progress is not None
            progress(before * total + done, len(plans) * total)

        summaries.append(run_campaign(plan, store=store, workers=workers, progress=None if progress is None else report))
    return summaries


def run_campaign(
    plan: Plan, *, store: Memory | Folder | None = None, workers: Workers | None = None, progress: Progress | None = None
) -> Summary:
    """Run the blocks of a plan that `store` (None: memory) does not hold yet on `workers` (None: threads); summarise
    all.

    The result is bit-identical for any workers, with or without interruptions. Raises `InsenvError` if workers die
    repeatedly, `InputError` if another process holds the store; finished blocks stay in the store. Ctrl-C ends the
    blocks that run; those that are finished, and what is done of the others, are stored in a folder, and the message of the
    KeyboardInterrupt says how many.
    """
    check_progress(progress)
    store = Memory() if store is None else store
    with store.held():
        return _run_held(plan, store, workers or threads(), progress)


def _run_held(plan: Plan, store: Memory | Folder, make: Workers, progress: Progress | None) -> Summary:
    measured = plan.measured
    if resolve_backend(None) == "native":
        with suppress(NoRoomError):  # of which the workers warn
            batch_library_path(measured.model, None)  # compile once here, not once in each worker
    blocks = plan.blocks
    left = {number for number in range(len(blocks)) if not store.has(number)}
    total = plan.runs * plan.samples

    def report() -> None:
        if progress is not None:
            progress(total - sum(len(blocks[number]) for number in left) * plan.samples, total)

    def keep(number: int, arrays: Arrays) -> None:
        store.put(number, arrays)
        left.discard(number)

    begun: set[int] = set()

    def leave(number: int, part: Arrays) -> None:
        if isinstance(store, Folder) and part["samples"] > 0:
            store.put_part(number, part)
            begun.add(number)

    attempts = 0
    try:
        report()
        while left:
            try:
                # end the blocks that run before leaving the executor, which waits for them
                with make() as executor, closing(_finished(executor, plan, sorted(left), store, keep, leave)) as finished:
                    for _ in finished:
                        attempts = 0
                        report()
            except BrokenExecutor as error:
                attempts += 1
                if attempts == ATTEMPTS:
                    raise InsenvError(
                        f"workers died {ATTEMPTS} times ({error}): out of memory? A script that starts worker processes must "
                        'do so below `if __name__ == "__main__":`'
                    ) from None
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_interrupted(store, len(blocks) - len(left), len(begun), len(blocks))) from None
    limit = campaign_limit(plan, measured.channels, progress)
    return summarise(plan, measured, lambda name: [store.column(number, name) for number in range(len(blocks))], limit)


def _interrupted(store: Memory | Folder, done: int, begun: int, blocks: int) -> str:
    """What an interrupted campaign leaves."""
    if not isinstance(store, Folder):
        return "interrupted; nothing written: --out DIR keeps finished blocks"
    if not done and not begun:
        return f"interrupted before the first of {blocks} blocks was begun; nothing is kept"
    more = f", and {begun} begun" if begun else ""
    return f"interrupted; {done} of {blocks} blocks are finished and kept{more}: --resume continues"


def _finished(
    executor: Executor,
    plan: Plan,
    numbers: list[int],
    store: Memory | Folder,
    keep: Callable[[int, Arrays], None],
    leave: Callable[[int, Arrays], None],
) -> Generator[int, None, None]:
    """Call `keep` with the blocks as they finish and yield their numbers.

    On an error or an interruption stop and cancel all others, keep those that have finished meanwhile, and call `leave` with
    what is done of those that ran in this process or its own ones.
    """
    digest, token = plan.digest, uuid4().hex
    futures: dict[Future[Arrays], int] = {}
    try:
        for number in numbers:
            futures[executor.submit(_block, plan, number, digest, token, store.part(number))] = number
        for future in as_completed(list(futures)):
            number = futures[future]
            keep(number, _result(future))
            del futures[future]
            yield number
    except (Exception, KeyboardInterrupt, GeneratorExit):
        _stopped.add(token)  # seen by the threads of this process
        try:
            if isinstance(executor, Processes):
                flag = _flag(token)
                flag.touch()
                wait(futures, STOPPING_S)
                flag.unlink(missing_ok=True)
            else:
                for future in futures:
                    future.cancel()
                if isinstance(executor, ThreadPoolExecutor):
                    wait([future for future in futures if not future.cancelled()], STOPPING_S)
        finally:
            if isinstance(executor, Processes):
                executor.end()
        for future, number in futures.items():
            if not future.done() or future.cancelled():
                continue
            error = future.exception()
            if error is None:
                keep(number, future.result())
            elif isinstance(error, StoppedError) and error.part is not None:
                leave(number, error.part)
        raise


_stopped: set[str] = set()
"""Tokens of the interrupted campaigns of this process."""


def _result(future: Future[Arrays]) -> Arrays:
    """The result of a worker.  Raises `InsenvError` if the cluster is gone or its workers die on this block."""
    try:
        return future.result()
    except CancelledError:
        raise InsenvError("the scheduler is gone; --resume continues with the remaining blocks") from None
    except Exception as error:
        if type(error).__module__.partition(".")[0] == "distributed":
            raise InsenvError(f"the cluster failed: {error}") from None
        raise


def _flag(token: str) -> Path:
    """The file whose presence tells the processes of this machine that their campaign was interrupted."""
    return Path(tempfile.gettempdir()) / f"insenv-stop-{token}"


def _block(plan: Plan, number: int, digest: str, token: str = "", part: Arrays | None = None) -> Arrays:
    """Run a block on a worker, from what an interruption left of it, if the worker's version gives the same results."""

    def stopped() -> bool:
        return token in _stopped or _flag(token).exists()

    if stopped():
        raise StoppedError
    if plan.digest != digest:
        raise InsenvError(
            f"a worker with insenv {__version__} would give other results than this process: install the same version of "
            "insenv and of its plug-ins on all"
        )
    return run_block(plan, number, stopped, part)
