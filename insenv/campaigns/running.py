"""Run a campaign: distribute its blocks, store them as they finish, and repeat those whose worker died."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, as_completed
from contextlib import closing, suppress
from math import isfinite
from pathlib import Path
from uuid import uuid4

from insenv import __version__
from insenv.campaigns.block import Arrays, run_block
from insenv.campaigns.executors import Processes, Workers, processes, threads
from insenv.campaigns.limits import campaign_limit
from insenv.campaigns.plan import Plan, make_plan
from insenv.campaigns.store import Folder, Memory
from insenv.campaigns.summary import Summary, summarise
from insenv.campaigns.variation import Variation
from insenv.core.compile import NoRoomError, batch_library_path
from insenv.core.progress import Progress, check_progress
from insenv.core.runner import resolve_backend
from insenv.errors import InputError, InsenvError
from insenv.estimators import Estimator
from insenv.files.output import as_path
from insenv.scenario import ScenarioLike

ATTEMPTS = 4
"""Number of consecutive executors that may lose their workers, with no block finished, before the campaign fails."""


def campaign(
    scenario: ScenarioLike,
    estimator: str | Estimator,
    runs: int,
    *,
    seed: int | None = None,
    duration_s: float | None = None,
    vary: Mapping[str, tuple[float, float]] | None = None,
    folder: str | Path | None = None,
    resume: bool = False,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Summary:
    """Run a scenario many times with an estimator (Monte Carlo) and summarise the errors.

    Parameters
    ----------
    scenario: a name that ``insenv list`` shows, the path of a ``.toml`` file, a `Scenario`, or the values of such a file.
    estimator: an id or an `Estimator`.
    runs: number of runs; run i has the seed `seed` + i (None: the scenario's).
    duration_s: instead of the scenario's, s.
    vary: ranges (low, high) by key of the scenario (``"imu.gyro_bias_deg_h"``) from which each run draws its value.
    folder: where finished blocks are kept; with `resume` an interrupted campaign there continues.
    workers: number of processes, which a script may start only below ``if __name__ == "__main__":``; None: threads.
    progress: called with the numbers of inertial samples done and in all; for the limit, once more from the first.

    Raises `InputError` for what is unknown, wrong, or cannot run; `InsenvError` if workers die again and again.
    """
    if vary is not None and not (isinstance(vary, Mapping) and all(isinstance(key, str) for key in vary)):
        raise InputError(f"vary = {vary!r}: allowed is a dict of ranges by key of the scenario")
    variations = [Variation(key, *_range(key, limits)) for key, limits in (vary or {}).items()]
    plan = make_plan(scenario, estimator, runs, first_seed=seed, duration_s=duration_s, variations=variations)
    if resume and folder is None:
        raise InputError("resume = True: name the folder that holds the campaign")
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int)):
        raise InputError(f"workers = {workers!r}: allowed is a whole number of processes")
    store = None if folder is None else Folder(as_path("folder", folder), plan, resume)
    return run_campaign(plan, store=store, workers=None if workers is None else processes(workers), progress=progress)


def _range(key: str, limits: object) -> tuple[float, float]:
    try:
        low, high = (float(limit) for limit in limits)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError(f"vary[{key!r}] = {limits!r}: allowed is a pair of numbers, the lower first") from None
    if not (isfinite(low) and isfinite(high) and low <= high):
        raise InputError(f"vary[{key!r}] = {limits!r}: allowed is a pair of finite numbers, the lower first")
    return low, high


def run_campaign(
    plan: Plan, *, store: Memory | Folder | None = None, workers: Workers | None = None, progress: Progress | None = None
) -> Summary:
    """Run the blocks of a plan that `store` (None: memory) does not hold yet on `workers` (None: threads); summarise
    all.

    The result is bit-identical for any workers, with or without interruptions. Raises `InsenvError` if workers die
    repeatedly, `InputError` if another process holds the store; finished blocks stay in the store. Ctrl-C ends the
    blocks that run; those that are finished are stored, and the message of the KeyboardInterrupt says how many.
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

    attempts = 0
    try:
        report()
        while left:
            try:
                # end the blocks that run before leaving the executor, which waits for them
                with make() as executor, closing(_finished(executor, plan, sorted(left), keep)) as finished:
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
        raise KeyboardInterrupt(_interrupted(store, len(blocks) - len(left), len(blocks))) from None
    limit = campaign_limit(plan, measured.channels, progress)
    return summarise(plan, measured, lambda name: [store.column(number, name) for number in range(len(blocks))], limit)


def _interrupted(store: Memory | Folder, done: int, blocks: int) -> str:
    """What an interrupted campaign leaves."""
    if not isinstance(store, Folder):
        return "interrupted; nothing written: --out DIR keeps finished blocks"
    if not done:
        return f"interrupted before the first of {blocks} blocks was finished; nothing is kept"
    return f"interrupted; {done} of {blocks} blocks are finished and kept: --resume continues"


def _finished(
    executor: Executor, plan: Plan, numbers: list[int], keep: Callable[[int, Arrays], None]
) -> Generator[int, None, None]:
    """Call `keep` with the blocks as they finish and yield their numbers.

    On an error or an interruption stop and cancel all others, and keep those that have finished meanwhile.
    """
    digest, token = plan.digest, uuid4().hex
    futures: dict[Future[Arrays], int] = {}
    try:
        for number in numbers:
            futures[executor.submit(_block, plan, number, digest, token)] = number
        for future in as_completed(list(futures)):
            number = futures[future]
            keep(number, _result(future))
            del futures[future]
            yield number
    except (Exception, KeyboardInterrupt, GeneratorExit):
        _stopped.add(token)  # seen by the threads of this process
        if isinstance(executor, Processes):
            executor.end()
        else:
            for future in futures:
                future.cancel()
        for future, number in futures.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                keep(number, future.result())
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


def _block(plan: Plan, number: int, digest: str, token: str = "") -> Arrays:
    """Run a block on a worker, provided that the worker's version gives the same results."""
    if plan.digest != digest:
        raise InsenvError(
            f"a worker with insenv {__version__} would give other results than this process: install the same version of "
            "insenv and of its plug-ins on all"
        )
    return run_block(plan, number, lambda: token in _stopped)
