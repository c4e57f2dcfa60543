"""Running a campaign: blocks handed out, kept as they come, done again where a worker died."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, as_completed
from contextlib import closing

from insenv import __version__, estimators
from insenv.campaigns.block import Arrays, run_block
from insenv.campaigns.executors import Workers, threads
from insenv.campaigns.model import measured_model
from insenv.campaigns.plan import Plan
from insenv.campaigns.store import Folder, Memory
from insenv.campaigns.summary import Summary, summarise
from insenv.core.compile import batch_library_path
from insenv.core.runner import resolve_backend
from insenv.errors import InsenvError

Progress = Callable[[int, int], None]
"""Told after each block: inertial samples done, and in all."""

ATTEMPTS = 4
"""Executors that may break one after the other, their workers having died, with no block done, before it gives up."""


def run_campaign(
    plan: Plan, *, store: Memory | Folder | None = None, workers: Workers | None = None, progress: Progress | None = None
) -> Summary:
    """Do the blocks of a plan that `store` (memory, if None) does not hold yet, on `workers` (threads), and sum all up.

    The result is the same to the bit whatever the workers, and whether it was done at once or after interruptions.
    Raises `InsenvError` if workers die again and again; what is finished stays in the store.
    """
    store = Memory() if store is None else store
    measured = measured_model(plan.plant.model, estimators.get(plan.estimator))
    if resolve_backend(None) == "native":
        batch_library_path(measured.model, None)  # compiled once, before the workers would all do so
    blocks = plan.blocks
    left = {number for number in range(len(blocks)) if not store.has(number)}
    total = plan.runs * plan.samples

    def tell() -> None:
        if progress is not None:
            progress(total - sum(len(blocks[number]) for number in left) * plan.samples, total)

    tell()
    make, attempts = workers or threads(), 0
    while left:
        try:
            # what has not begun is called off before the executor is left, which waits for what has
            with make() as executor, closing(_finished(executor, plan, sorted(left))) as finished:
                for number, arrays in finished:
                    store.put(number, arrays)
                    left.discard(number)
                    attempts = 0
                    tell()
        except BrokenExecutor as error:
            attempts += 1
            if attempts == ATTEMPTS:
                raise InsenvError(f"workers died {ATTEMPTS} times ({error}): out of memory?") from None
    return summarise(plan, measured, lambda name: [store.column(number, name) for number in range(len(blocks))])


def _finished(executor: Executor, plan: Plan, numbers: list[int]) -> Generator[tuple[int, Arrays], None, None]:
    """(number, arrays) of the blocks, as they come; what has not begun is called off at its end, whatever ends it."""
    digest = plan.digest
    futures: dict[Future[Arrays], int] = {}
    try:
        for number in numbers:
            futures[executor.submit(_block, plan, number, digest)] = number
        for future in as_completed(list(futures)):
            yield futures.pop(future), _result(future)
    finally:
        for future in futures:
            future.cancel()


def _result(future: Future[Arrays]) -> Arrays:
    """What a worker gave.  Raises `InsenvError` for a cluster that has gone or whose workers die of this block."""
    try:
        return future.result()
    except CancelledError:
        raise InsenvError("the scheduler has gone; --resume goes on with what is done") from None
    except Exception as error:
        if type(error).__module__.partition(".")[0] == "distributed":
            raise InsenvError(f"the cluster gives up: {error}") from None
        raise


def _block(plan: Plan, number: int, digest: str) -> Arrays:
    """On a worker: the block, if this worker would give the same numbers as whoever asked."""
    if plan.digest != digest:
        raise InsenvError(f"a worker has insenv {__version__}, which is not the version that asks: install the same on all")
    return run_block(plan, number)
