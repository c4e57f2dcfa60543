"""The folder of a campaign: damaged blocks, those of another campaign, and one campaign at a time."""

import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from campaigns import same, slow_ship, small_plan

from insenv.base.errors import InputError, InsenvError
from insenv.base.output import LockedError, exclusive
from insenv.studies.campaign import Folder, make_plan, run_campaign, threads
from insenv.studies.campaign.block import run_block


def test_damaged_blocks_are_done_again(tmp_path):
    plan = small_plan()
    expected = run_campaign(plan, store=Folder(tmp_path / "one", plan))
    other = replace(plan, first_seed=103)
    run_campaign(other, store=Folder(tmp_path / "other", other))
    files = sorted((tmp_path / "one" / "blocks").iterdir())
    data = files[0].read_bytes()
    files[0].write_bytes(data[: len(data) // 2])
    turned = bytearray(files[1].read_bytes())
    turned[len(turned) // 2] ^= 0x10
    files[1].write_bytes(turned)
    files[2].write_bytes(b"")
    shutil.copy(tmp_path / "other" / "blocks" / files[3].name, files[3])  # undamaged, but of other runs
    store = Folder(tmp_path / "one", plan, resume=True)
    assert [store.has(k) for k in range(5)] == [False] * 4 + [True]
    with pytest.raises(InsenvError, match="a block of another campaign"):
        store.column(3, "error")
    store.put_part(0, {"state": np.zeros((8, 3)), "samples": np.array(4.0), "outputs": np.zeros((8, 0, 1))})
    (tmp_path / "one" / "blocks" / "000000.begun.npz").write_bytes(b"nothing")
    assert store.part(0) is None
    assert same(run_campaign(plan, store=store), expected)
    assert all(store.has(k) for k in range(5)) and not list(tmp_path.rglob("*.part"))


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


def test_two_campaigns_in_one_folder_do_not_mix(tmp_path):
    """Both find the folder empty; the second one that runs is refused while the first holds it, and afterwards."""
    one, other = small_plan(16), replace(small_plan(16), first_seed=103)
    first, second = Folder(tmp_path, one), Folder(tmp_path, other)
    refused = []

    def intrude(done, total):
        if 0 < done < total and not refused:
            with pytest.raises(InputError, match="is in use: another campaign runs there") as caught:
                run_campaign(other, store=second)
            refused.append(caught.value)

    found = run_campaign(one, store=first, workers=threads(1), progress=intrude)
    assert refused and same(found, run_campaign(one)) and not (tmp_path / ".lock").exists()
    for use in (lambda: run_campaign(other, store=second), lambda: second.put(0, run_block(other, 0))):
        with pytest.raises(InputError, match="another campaign: it differs in first_seed"):
            use()


def test_a_folder_that_a_refused_campaign_made_is_removed(tmp_path):
    plan = replace(small_plan(8), estimator="nothing")
    with pytest.raises(InputError):
        run_campaign(plan, store=Folder(tmp_path / "a" / "b", plan))
    assert not (tmp_path / "a").exists()


def test_a_lock_is_released_when_its_process_dies(tmp_path):
    path = tmp_path / "lock"
    code = (
        "import sys; from pathlib import Path; from insenv.base.output import exclusive\n"
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
