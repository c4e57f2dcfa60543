"""Campaigns are bit-identical with any workers and after any interruption; blocks that were begun are kept and finished."""

import os
import pickle
import signal
import threading
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import replace

import peers
import pytest
from campaigns import same, slow_ship, small_plan

from insenv.base.errors import InputError, InsenvError
from insenv.studies.campaign import Folder, block, cluster, make_plan, processes, run_campaign, running, threads
from insenv.studies.campaign import block as block_module

posix = pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals of POSIX")


@pytest.mark.slow
def test_threads_and_processes_are_bit_identical():
    plan = small_plan(24)
    assert [len(b) for b in plan.blocks] == [8] * 3
    calls = []
    first = run_campaign(plan, workers=threads(1), progress=lambda done, total: calls.append((done, total)))
    assert calls[0] == (0, 24 * 40) and calls[3] == (24 * 40, 24 * 40)
    assert list(first.seeds) == list(range(3, 27))
    assert same(first, run_campaign(plan, workers=threads(3)))
    assert same(first, run_campaign(replace(plan, block_samples=10**6), workers=threads(2)))  # one block
    assert same(first, run_campaign(plan, workers=processes(2)))
    assert pickle.loads(pickle.dumps(plan)).digest == plan.digest


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_bit_identical_results(tmp_path):
    distributed = peers.package("distributed")
    plan = small_plan(80)
    expected = run_campaign(plan)
    blocks, killed = [], []

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50, local_directory=tmp_path
    ) as local:

        def kill(done, total):
            if 0 < done < total and not killed:
                killed.append(next(iter(local.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        class Counting(Folder):
            def put(self, number, arrays):
                blocks.append(number)
                super().put(number, arrays)

        store = Counting(tmp_path / "out", plan)
        found = run_campaign(plan, store=store, workers=cluster(local.scheduler_address), progress=kill)
    assert killed and sorted(blocks) == list(range(10))  # each block once
    assert same(found, expected)


def test_processes_that_die_are_replaced_and_at_last_given_up():
    plan, calls = small_plan(16), []

    class Breaking:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def submit(self, *_):
            calls.append(1)
            raise BrokenProcessPool("a process in the process pool was terminated abruptly")

    makers = iter([Breaking, Breaking, threads(1)])
    assert same(run_campaign(plan, workers=lambda: next(makers)()), run_campaign(plan))
    with pytest.raises(InsenvError, match="died 4 times"):
        run_campaign(plan, workers=Breaking)
    assert len(calls) == 2 + running.ATTEMPTS


@posix
def test_processes_do_not_hear_ctrl_c():
    with processes(1)() as executor:
        assert signal.SIGINT in executor.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result()
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_worker_of_another_version_is_refused():
    with pytest.raises(InsenvError, match="would give other results than this process"):
        running._block(small_plan(8), 0, "the digest of another version")


@contextmanager
def alarm_interrupts():
    def interrupted(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupted)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_an_interrupted_campaign_resumes_with_bit_identical_results(tmp_path):
    plan, done = small_plan(), []
    expected = run_campaign(plan)

    def half(now, total):
        done.append(now)
        if now >= total // 2:
            raise KeyboardInterrupt

    kept = r"interrupted; [1-4] of 5 blocks are finished and kept(, and \d begun)?: --resume continues"
    with pytest.raises(KeyboardInterrupt, match=kept):
        run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1), progress=half)
    names = sorted(p.name for p in (tmp_path / "blocks").iterdir())
    assert names[:3] == ["000000.npz", "000001.npz", "000002.npz"]
    assert names[3:] in ([], ["000003.begun.npz"], ["000003.npz"])  # the block in work: by chance not begun, begun or finished
    finished = [name for name in names if not name.endswith(".begun.npz")]
    with pytest.raises(InputError, match="--resume"):
        Folder(tmp_path, plan)
    for first in (len(finished) * 8 * 40, 40 * 40):  # at last, nothing is left to do
        calls = []
        store = Folder(tmp_path, plan, resume=True)
        assert same(run_campaign(plan, store=store, progress=lambda now, _, calls=calls: calls.append(now)), expected)
        assert calls[0] == first
    with pytest.raises(KeyboardInterrupt, match="nothing written: --out DIR keeps finished blocks"):
        run_campaign(plan, workers=threads(1), progress=half)


def test_a_block_that_fails_ends_the_campaign_and_keeps_the_others(tmp_path, monkeypatch):
    plan, original = small_plan(), block_module.run_block

    def failing(plan, number, stopped, part):
        if number == 2:
            raise InputError("no such wave")
        return original(plan, number, stopped)

    monkeypatch.setattr(running, "run_block", failing)
    with pytest.raises(InputError, match="no such wave"):
        run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1))
    assert len(list((tmp_path / "blocks").iterdir())) >= 2


@posix
@pytest.mark.parametrize(
    ("pool", "after_s"),
    [(threads(2), 0.5), pytest.param(processes(2), 3.0, marks=pytest.mark.slow)],
    ids=["threads", "processes"],
)
def test_an_interruption_ends_blocks_that_run(tmp_path, pool, after_s):
    """Without that, the blocks of 8 runs, each of which takes minutes on the interpreter, would be waited for."""
    plan = replace(make_plan(slow_ship(), "q-method", 16, first_seed=3, duration_s=7200.0), block_samples=1)

    def begun(done, total):
        signal.setitimer(signal.ITIMER_REAL, after_s)

    said = "before the first of 2 blocks was begun|0 of 2 blocks are finished and kept, and [12] begun"
    with alarm_interrupts(), pytest.raises(KeyboardInterrupt, match=said):
        run_campaign(plan, store=Folder(tmp_path / "out", plan), workers=pool, progress=begun)
    assert not list((tmp_path / "out").glob("blocks/00000?.npz"))


@posix
def test_an_interrupted_block_is_kept_and_finished(tmp_path, monkeypatch):
    monkeypatch.setattr(block, "PIECE_S", 1e-9)
    plan = replace(small_plan(8), block_samples=1000)
    original, asked = block_module.run_block, []

    def interrupting(plan, number, stopped, part=None):
        def look():
            asked.append(1)
            if len(asked) == 20:
                signal.pthread_kill(threading.main_thread().ident, signal.SIGALRM)
            for _ in range(1000):  # until the main thread has seen it
                if len(asked) < 20 or stopped():
                    break
                time.sleep(0.01)
            return stopped()

        return original(plan, number, look, part)

    monkeypatch.setattr(running, "run_block", interrupting)
    said = "0 of 1 blocks are finished and kept, and 1 begun: --resume continues"
    with alarm_interrupts(), pytest.raises(KeyboardInterrupt, match=said):
        run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1))
    assert [path.name for path in (tmp_path / "blocks").iterdir()] == ["000000.begun.npz"] and len(asked) >= 20
    monkeypatch.setattr(running, "run_block", original)
    resumed = run_campaign(plan, store=Folder(tmp_path, plan, resume=True))
    assert [path.name for path in (tmp_path / "blocks").iterdir()] == ["000000.npz"]
    assert same(resumed, run_campaign(plan))
