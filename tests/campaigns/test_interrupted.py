"""Blocks that are interrupted, kept and finished."""

import signal
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from campaigns import same, small_plan

from insenv.campaigns import Folder, pieces, run_campaign, running, threads
from insenv.campaigns import block as block_module
from insenv.campaigns.block import StoppedError, run_block


@pytest.mark.parametrize("looks", [1, 3, 30])
def test_a_block_goes_on_from_where_it_was_stopped(monkeypatch, looks):
    monkeypatch.setattr(pieces, "PIECE_S", 1e-9)  # one sample a piece
    plan = small_plan(8)
    asked = []

    def stopped():
        asked.append(1)
        return len(asked) > 8 + looks

    with pytest.raises(StoppedError) as caught:
        run_block(plan, 0, stopped)
    part = caught.value.part
    assert part["samples"] > 0
    whole, continued = run_block(plan, 0), run_block(plan, 0, part=part)
    assert all(np.array_equal(whole[name], continued[name]) for name in whole)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="signals of POSIX")
def test_an_interrupted_block_is_kept_and_finished(tmp_path, monkeypatch):
    monkeypatch.setattr(pieces, "PIECE_S", 1e-9)
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

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "run_block", interrupting)
    before = signal.signal(signal.SIGALRM, interrupted)
    try:
        with pytest.raises(KeyboardInterrupt, match="0 of 1 blocks are finished and kept, and 1 begun: --resume continues"):
            run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1))
    finally:
        signal.signal(signal.SIGALRM, before)
    assert [path.name for path in (tmp_path / "blocks").iterdir()] == ["000000.begun.npz"]
    done = len(asked)
    monkeypatch.setattr(running, "run_block", original)
    resumed = run_campaign(plan, store=Folder(tmp_path, plan, resume=True))
    assert [path.name for path in (tmp_path / "blocks").iterdir()] == ["000000.npz"]
    assert done >= 20 and same(resumed, run_campaign(plan))


def test_a_damaged_part_is_begun_again(tmp_path):
    plan = small_plan(8)
    store = Folder(tmp_path, plan)
    store.put_part(0, {"state": np.zeros((8, 3)), "samples": np.array(4.0), "outputs": np.zeros((8, 0, 1))})
    (tmp_path / "blocks" / "000000.begun.npz").write_bytes(b"nothing")
    assert store.part(0) is None
    assert same(run_campaign(plan, store=Folder(tmp_path, plan, resume=True)), run_campaign(plan))
