"""Equations kept in the cache folder: the same as traced ones; a damaged or foreign file is not read."""

import hashlib
import os
from dataclasses import replace

import numpy as np
import pytest

from insenv.core import traces
from insenv.core.codegen import native_source
from insenv.core.identity import identity
from insenv.core.model import Model
from insenv.core.runner import make_runner
from insenv.estimators import get

MODEL = get("gyrocompass").model
IDENTITY, FINGERPRINT = identity(MODEL), MODEL.fingerprint


@pytest.fixture
def file(tmp_path, monkeypatch):
    """The file of the model in a cache folder of its own."""
    monkeypatch.setenv("INSENV_CACHE_DIR", str(tmp_path / "cache"))
    return traces._path(IDENTITY)


@pytest.fixture
def tracings(monkeypatch):
    """The ids of the models that are traced."""
    ids, trace = [], Model._kernels
    monkeypatch.setattr(Model, "_kernels", lambda self: (ids.append(self.id), trace(self))[1])
    return ids


def numbers(model):
    u = model.inputs.pack({"delta_angle": [1e-4, 2e-4, -1e-4], "delta_velocity": [0.1, 0.02, -0.05]})
    return make_runner(model, backend="interpreter").run(20, u)


def test_a_kept_model_is_the_traced_one(file, tracings):
    traced, kept = replace(MODEL), replace(MODEL)
    first, source, shown = traced.kernels, native_source(traced), numbers(traced)
    assert tracings == [MODEL.id] and file.stat().st_mode & 0o777 == 0o600
    second = kept.kernels
    assert tracings == [MODEL.id]
    assert second.fingerprint == first.fingerprint == kept.fingerprint and second.spans == first.spans
    assert list(second) == list(first) == ["start", *MODEL.steps, "output"]
    assert native_source(kept) == source
    np.testing.assert_array_equal(numbers(kept), shown)


def test_the_fingerprint_is_of_tables_and_equations():
    kernels = MODEL.kernels
    own = traces.traced(kernels, "tables").fingerprint
    other = replace(kernels["output"], spans=(slice(0, 1),))
    assert traces.traced(kernels, "tables").fingerprint == own
    assert len({own, *(traces.traced(*given).fingerprint for given in
                       ((kernels, "other tables"), ({**kernels, "output": other}, "tables"),
                        ({**kernels, "output": kernels["start"]}, "tables")))}) == 4  # fmt: skip


def signed(content):
    """A file of this content whose hash is right."""
    return hashlib.sha256(content).hexdigest().encode() + b"\n" + content


DAMAGE = {
    "cut off": lambda whole: whole[:-10], "a changed kernel": lambda whole: whole[:-10] + b"?" + whole[-9:],
    "no JSON": lambda whole: signed(b"[\n"), "no fingerprint": lambda whole: signed(b'{"kernels": []}\n'),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_is_not_read_but_written_again(file, tracings, damage):
    _ = replace(MODEL).kernels
    whole = file.read_bytes()
    damaged = DAMAGE[damage](whole)
    assert damaged != whole
    file.write_bytes(damaged)
    assert traces.read(IDENTITY) is None
    assert replace(MODEL).fingerprint == FINGERPRINT and tracings == [MODEL.id] * 2
    assert file.read_bytes() == whole


@pytest.mark.skipif(os.name == "nt", reason="owners and modes of POSIX")
def test_a_file_that_others_could_have_written_is_not_read(file, tmp_path):
    _ = replace(MODEL).kernels
    for mode, read in ((0o600, True), (0o620, False), (0o602, False), (0o600, True)):
        file.chmod(mode)
        assert (traces.read(IDENTITY) is not None) == read
    file.rename(tmp_path / "elsewhere")
    file.symlink_to(tmp_path / "elsewhere")
    assert traces.read(IDENTITY) is None


def test_without_a_usable_folder_or_an_identity_nothing_is_kept(file, tmp_path, monkeypatch, tracings, toy):
    _ = replace(toy).kernels, replace(toy).kernels
    assert tracings == ["toy"] * 2 and not file.parent.exists()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("INSENV_CACHE_DIR", str(tmp_path / "file" / "cache"))
    assert [replace(MODEL).fingerprint for _ in range(2)] == [FINGERPRINT] * 2
    assert tracings[2:] == [MODEL.id] * 2 and traces.read(IDENTITY) is None


def test_the_oldest_files_go(file, monkeypatch):
    monkeypatch.setattr(traces, "MAX_FILES", 3)
    names = [f"{k:032x}" for k in range(5)]
    for age, name in enumerate(reversed(names)):  # the name does not tell the age
        traces.keep(name, MODEL.kernels)
        os.utime(traces._path(name), (age, age))
    assert sorted(path.name for path in file.parent.iterdir()) == names[:3]
    assert traces.read(names[0]).fingerprint == FINGERPRINT
