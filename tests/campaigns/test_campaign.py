"""Campaigns: whole runs in the core; bit-identical with any workers and after interruptions."""

import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from campaigns import same, slow_ship, small_plan

from insenv import run
from insenv.campaigns import Folder, cluster, make_plan, processes, run_campaign, running, threads
from insenv.campaigns import block as block_module
from insenv.campaigns.block import run_block
from insenv.errors import InputError, InsenvError
from insenv.evaluation.errors import CHANNELS
from insenv.files.lock import LockedError, exclusive
from insenv.scenario import build, load, reseeded

has_compiler = shutil.which("cc") is not None
native = pytest.mark.skipif(not has_compiler, reason="no C compiler on the path")


# --- what a run is ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "id", "duration_s"),
    [
        ("ship-swaying", "q-method", 6.0),
        pytest.param("car-city-drive", "loosely-coupled", 6.0, marks=pytest.mark.slow),
        pytest.param("car-city-drive", "wander-sins", 4.0, marks=pytest.mark.slow),
    ],
)
def test_a_run_of_a_campaign_is_the_run_of_its_seed(name, id, duration_s):
    """Errors and stated accuracy at the recorded times, and mean squares in between, equal those of `insenv.runs.simulated`."""
    scenario = load(name).model_copy(update={"rate_hz": 100.0})
    plan = make_plan(scenario, id, 3, first_seed=11, duration_s=duration_s)
    arrays = run_block(plan, 0)
    report = run(scenario, [id], seed=12, duration_s=duration_s)
    result = report.results[0]
    k = plan.evaluations
    assert np.allclose(plan.times, result.time[k - 1 :: k], rtol=1e-12)
    for place, channel in enumerate(c for c in CHANNELS if c in result.errors):
        error = result.errors[channel]
        assert np.allclose(arrays["error"][1, :, place], error[k - 1 :: k], rtol=1e-9, atol=1e-9)
        blocks = (error[: len(plan.times) * k] ** 2).reshape(-1, k).mean(axis=1)
        assert np.allclose(arrays["mean_square"][1, :, place], blocks, rtol=1e-6, atol=1e-15)
        if channel in result.sigma:
            sigma = result.sigma[channel]
            assert np.allclose(arrays["sigma"][1, :, place], sigma[k - 1 :: k], rtol=1e-9)
            variances = (sigma[: len(plan.times) * k] ** 2).reshape(-1, k).mean(axis=1)
            assert np.allclose(arrays["mean_variance"][1, :, place], variances, rtol=1e-9)


def test_rms_and_stated_of_a_campaign_are_those_of_its_run():
    """Both are means over every evaluation; those at the records alone are others."""
    scenario = load("ship-underway").model_copy(update={"rate_hz": 10.0})
    found = run_campaign(make_plan(scenario, "loosely-coupled", 1, first_seed=4, duration_s=60.0))
    result = run(scenario, "loosely-coupled", seed=4, duration_s=60.0).results[0]
    for name, row in found.figures().items():
        assert row["rms"] == pytest.approx(result.statistics()["rms"][name], rel=1e-6, abs=1e-9), name
        assert row["stated"] == pytest.approx(result.stated()[name], rel=1e-9), name
    records = result.sigma["vn_mps"][found.plan.evaluations - 1 :: found.plan.evaluations]
    assert result.stated()["vn_mps"] != pytest.approx(np.sqrt(np.mean(records**2)), rel=0.01)


@pytest.mark.parametrize(("name", "id"), [("ship-swaying", "q-method"), ("car-city-drive", "loosely-coupled")])
def test_the_limit_is_that_of_a_run(name, id):
    """The same statistic of the same limit, from the start on for navigation, whatever the seed."""
    scenario = load(name).model_copy(update={"rate_hz": 100.0})
    found = run_campaign(make_plan(scenario, id, 2, first_seed=5, duration_s=12.0))
    result = run(scenario, [id], seed=9, duration_s=12.0).results[0]
    late = found.time >= found.from_s - 1e-9
    begin = found.time[late][0] - found.time[0]  # a record holds the evaluations since the one before
    inside = result.time > begin + 1e-9
    for place, channel in enumerate(found.channels):
        expected = np.sqrt(np.mean(result.limit_sigma[channel][inside] ** 2))
        assert found.limit[:, place] == pytest.approx(expected, rel=1e-9), channel
        assert found.figures()[channel]["limit"] == pytest.approx(expected, rel=1e-9)
        assert np.sqrt(np.mean(found.courses[channel].limit[late] ** 2)) == pytest.approx(expected, rel=1e-9)
        if found.from_s == 0.0:
            assert expected == pytest.approx(result.limit[channel], rel=1e-9)
    assert found.notes == found.plan.notes


def test_reseeded_plants_are_those_built_for_the_seeds():
    for name in ("car-city-drive", "ship-irregular-sea"):
        first = build(load(name), seed=1, duration_s=50.0)
        for plant, seed in zip(reseeded(first, [4, 9]), (4, 9), strict=True):
            other = build(load(name), seed=seed, duration_s=50.0)
            vectors = [p.model.parameters.pack(p.parameters) for p in (plant, other)]
            assert plant.seed == seed and np.array_equal(*vectors)
            assert repr(plant.knowledge) == repr(other.knowledge)


# --- the same with any workers ------------------------------------------------------------------------


def test_threads_and_processes_are_bit_identical():
    plan = small_plan()
    assert [len(b) for b in plan.blocks] == [8] * 5
    calls = []
    first = run_campaign(plan, workers=threads(1), progress=lambda done, total: calls.append((done, total)))
    assert calls[0] == (0, 40 * 40) and calls[5] == (40 * 40, 40 * 40)
    assert all(total == 40 for _, total in calls[6:])  # the limit
    assert list(first.seeds) == list(range(3, 43))
    assert same(first, run_campaign(plan, workers=threads(3)))
    assert same(first, run_campaign(replace(plan, block_samples=10**6), workers=threads(2)))  # one block
    assert same(first, run_campaign(plan, workers=processes(2)))
    assert pickle.loads(pickle.dumps(plan)).digest == plan.digest


@native
def test_the_compiled_core_is_bit_identical(monkeypatch):
    plan = small_plan(9)
    first = run_campaign(plan)
    monkeypatch.setenv("INSENV_BACKEND", "native")
    assert same(first, run_campaign(plan))


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_bit_identical_results(tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
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


@pytest.mark.parametrize("address", ["nonsense", "http://127.0.0.1:8786", "tcp://127.0.0.1", "tcp://:8786", "127.0.0.1:8786"])
def test_an_address_of_another_form_is_refused_at_once(address):
    with pytest.raises(InputError, match=f"scheduler '{address}': allowed is tcp://HOST:PORT"):
        cluster(address)


def test_processes_that_die_are_replaced_and_at_last_given_up(monkeypatch):
    from concurrent.futures.process import BrokenProcessPool

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


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_processes_do_not_hear_ctrl_c():
    with processes(1)() as executor:
        assert signal.SIGINT in executor.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result()
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_a_worker_of_another_version_is_refused():
    with pytest.raises(InsenvError, match="would give other results than this process"):
        running._block(small_plan(8), 0, "the digest of another version")


# --- the folder ---------------------------------------------------------------------------------------


def test_an_interrupted_campaign_resumes_with_bit_identical_results(tmp_path):
    plan = small_plan()
    expected = run_campaign(plan)
    done = []

    def interrupt(now, total):
        done.append(now)
        if now >= total // 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1), progress=interrupt)
    kept = sorted(p.name for p in (tmp_path / "blocks").iterdir())
    assert kept[:3] == ["000000.npz", "000001.npz", "000002.npz"]
    assert kept[3:] in ([], ["000003.begun.npz"], ["000003.npz"])  # the block in work: by chance not begun, begun or finished
    finished = [name for name in kept if not name.endswith(".begun.npz")]
    with pytest.raises(InputError, match="--resume"):
        Folder(tmp_path, plan)
    calls = []
    found = run_campaign(plan, store=Folder(tmp_path, plan, resume=True), progress=lambda now, _: calls.append(now))
    assert calls[0] == len(finished) * 8 * 40 and same(found, expected)
    calls.clear()  # nothing is left to do
    assert same(run_campaign(plan, store=Folder(tmp_path, plan, resume=True), progress=lambda n, _: calls.append(n)), expected)
    assert calls == [40 * 40]


def test_an_interruption_waits_for_no_block_that_has_not_begun(monkeypatch):
    plan, original, begun = small_plan(), block_module.run_block, []

    def slow(plan, number, stopped, part):
        begun.append(number)
        time.sleep(0.5)
        return original(plan, number, stopped)

    def interrupt(done, total):
        if done:
            raise KeyboardInterrupt

    monkeypatch.setattr(running, "run_block", slow)
    with pytest.raises(KeyboardInterrupt):
        run_campaign(plan, workers=threads(1), progress=interrupt)
    assert begun == [0, 1]  # the second one had begun


def test_damaged_blocks_are_done_again(tmp_path):
    plan = small_plan()
    expected = run_campaign(plan, store=Folder(tmp_path, plan))
    files = sorted((tmp_path / "blocks").iterdir())
    data = files[0].read_bytes()
    files[0].write_bytes(data[: len(data) // 2])
    turned = bytearray(files[1].read_bytes())
    turned[len(turned) // 2] ^= 0x10
    files[1].write_bytes(turned)
    files[2].write_bytes(b"")
    shutil.copy(files[4], files[3])  # undamaged, but of other runs
    store = Folder(tmp_path, plan, resume=True)
    assert [store.has(k) for k in range(5)] == [False] * 4 + [True]
    assert same(run_campaign(plan, store=store), expected)
    assert all(store.has(k) for k in range(5))
    assert not list(tmp_path.rglob("*.part"))


def test_the_folder_of_another_campaign_is_refused(tmp_path):
    plan = small_plan(16)
    run_campaign(plan, store=Folder(tmp_path, plan))
    with pytest.raises(InputError, match="another campaign: it differs in first_seed"):
        Folder(tmp_path, replace(plan, first_seed=4), resume=True)
    with pytest.raises(InputError, match="differs in estimator"):
        Folder(tmp_path, make_plan(slow_ship(), "q-method", 16, first_seed=3, duration_s=2.0), resume=True)
    (tmp_path / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="not the manifest"):
        Folder(tmp_path, plan, resume=True)
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(InputError, match=r"no manifest\.json"):
        Folder(tmp_path, plan)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="not a folder"):
        Folder(tmp_path / "file", plan)


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


# --- one campaign a folder ----------------------------------------------------------------------------


def test_two_campaigns_in_one_folder_do_not_mix(tmp_path):
    """Both find the folder empty; the second one that runs is refused while the first holds it, and afterwards."""
    one, other = small_plan(), replace(small_plan(), first_seed=103)
    first, second = Folder(tmp_path, one), Folder(tmp_path, other)
    refused = []

    def intrude(done, total):
        if 0 < done < total and not refused:
            with pytest.raises(InputError, match="is in use: another campaign runs there") as caught:
                run_campaign(other, store=second)
            refused.append(caught.value)

    found = run_campaign(one, store=first, workers=threads(1), progress=intrude)
    assert refused and same(found, run_campaign(one))
    with pytest.raises(InputError, match="another campaign: it differs in first_seed"):
        run_campaign(other, store=second)
    with pytest.raises(InputError, match="another campaign: it differs in first_seed"):
        second.put(0, run_block(other, 0))
    assert not (tmp_path / ".lock").exists()


def test_a_block_of_another_campaign_is_not_read(tmp_path):
    one, other = small_plan(), replace(small_plan(), first_seed=103)
    for plan, name in ((one, "one"), (other, "other")):
        run_campaign(plan, store=Folder(tmp_path / name, plan))
    shutil.copy(tmp_path / "other" / "blocks" / "000001.npz", tmp_path / "one" / "blocks" / "000001.npz")
    store = Folder(tmp_path / "one", one, resume=True)
    assert store.column(0, "error").shape[0] == 8
    with pytest.raises(InsenvError, match="a block of another campaign"):
        store.column(1, "error")


def test_a_lock_is_released_when_its_process_dies(tmp_path):
    path = tmp_path / "lock"
    code = (
        "import sys; from pathlib import Path; from insenv.files.lock import exclusive\n"
        f"with exclusive(Path({str(path)!r})):\n  print('held', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout.readline().strip() == b"held"
        with pytest.raises(LockedError), exclusive(path):
            pass
        holder.kill()
    with exclusive(path):
        assert path.exists()
    assert not path.exists()


def test_a_folder_that_a_refused_campaign_made_is_removed(tmp_path):
    plan = replace(small_plan(), estimator="nothing")
    with pytest.raises(InputError):
        run_campaign(plan, store=Folder(tmp_path / "a" / "b", plan))
    assert not (tmp_path / "a").exists()


# --- Ctrl-C -------------------------------------------------------------------------------------------


def long_plan():
    """Blocks of 8 runs, each of which takes minutes on the interpreter."""
    return replace(make_plan(slow_ship(), "q-method", 16, first_seed=3, duration_s=7200.0), block_samples=1)


def test_a_block_ends_soon_after_an_interruption():
    plan, asked = long_plan(), []

    def stopped():
        asked.append(time.perf_counter())
        return len(asked) > 4

    with pytest.raises(block_module.StoppedError):
        run_block(plan, 0, stopped)
    assert len(asked) == 5


@pytest.mark.parametrize("pool", [threads(2), processes(2)], ids=["threads", "processes"])
def test_an_interruption_ends_blocks_that_run(tmp_path, pool):
    """Without that, the blocks, which take minutes, would be waited for."""
    plan = long_plan()

    def interrupted(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupted)
    signal.setitimer(signal.ITIMER_REAL, 3.0)
    try:
        with pytest.raises(
            KeyboardInterrupt,
            match=r"before the first of 2 blocks was begun|0 of 2 blocks are finished and kept, and [12] begun",
        ):
            run_campaign(plan, store=Folder(tmp_path / "out", plan), workers=pool)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert not list((tmp_path / "out").glob("blocks/00000?.npz"))


def test_an_interruption_says_what_is_kept(tmp_path):
    plan = small_plan()

    def interrupt(done, total):
        if done:
            raise KeyboardInterrupt

    kept = r"interrupted; [1-4] of 5 blocks are finished and kept(, and \d begun)?: --resume continues"
    with pytest.raises(KeyboardInterrupt, match=kept):
        run_campaign(plan, store=Folder(tmp_path, plan), workers=threads(1), progress=interrupt)
    with pytest.raises(KeyboardInterrupt, match="nothing written: --out DIR keeps finished blocks"):
        run_campaign(plan, workers=threads(1), progress=interrupt)
