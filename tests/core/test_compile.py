"""The cache of compiled models: damaged, foreign and contended entries."""

import errno
import os
import re
import shutil
import stat
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from insenv.base.errors import InputError
from insenv.core import codegen
from insenv.core import compile as compiling
from insenv.core.codegen import native_source
from insenv.core.compile import CompileError, Compiler, NoRoomError, compile_library, find_compiler
from insenv.core.runner import make_runner


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("INSENV_CACHE_DIR", str(folder))
    return folder


def test_a_model_is_compiled_once_which_is_told(cache, toy, caplog):
    source, compiler = native_source(toy), find_compiler()
    with caplog.at_level("INFO", logger=compiling.__name__):
        library = compile_library(source, compiler)
        assert compile_library(source, compiler) == library
    assert caplog.messages == ["compiling, once", "compiled"]
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert [p.name for p in cache.iterdir()] == [library.parent.name]  # no build folder is left
    assert compile_library(source + "\n/* other */", compiler) != library


def test_the_level_of_optimisation_is_chosen(monkeypatch):
    chosen = {}
    for level in "0123":
        monkeypatch.setenv("INSENV_OPTIMIZATION", level)
        chosen[level] = find_compiler()
        assert chosen[level].flags[0] == f"-O{level}"
    assert len({compiling._key("source", compiler) for compiler in chosen.values()}) == 4
    monkeypatch.setenv("INSENV_OPTIMIZATION", "s")
    with pytest.raises(InputError, match="INSENV_OPTIMIZATION = 's'"):
        find_compiler()


DAMAGE = {
    "truncated": lambda library, _: library.write_bytes(library.read_bytes()[:-100]),
    "digest missing": lambda library, _: (library.parent / "model.sha256").unlink(),
    "writable by others": lambda library, _: library.chmod(0o777),
    "a link": lambda library, elsewhere: library.parent.rename(elsewhere) and library.parent.symlink_to(elsewhere),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_broken_or_foreign_entry_is_rebuilt(cache, toy, tmp_path, damage):
    source, compiler = native_source(toy), find_compiler()
    library = compile_library(source, compiler)
    good = library.read_bytes()
    DAMAGE[damage](library, tmp_path / "elsewhere")
    again = compile_library(source, compiler)
    assert again.read_bytes() == good and not again.parent.is_symlink()
    assert not stat.S_IMODE(again.stat().st_mode) & 0o022


def test_a_folder_that_others_may_write_is_not_used(cache, toy):
    cache.mkdir()
    cache.chmod(0o777)
    with pytest.warns(RuntimeWarning, match=f"{re.escape(str(cache))}: .*other users can write"):
        library = compile_library(native_source(toy), find_compiler())
    assert cache not in library.parents and list(cache.iterdir()) == []
    with warnings.catch_warnings():  # it warns once
        warnings.simplefilter("error")
        assert compile_library(native_source(toy), find_compiler()) == library


def test_on_a_full_disk_another_folder_serves_then_the_interpreter(cache, toy, monkeypatch):
    compiled, full = compiling._compile, [cache]

    def compile(source, compiler, build):
        if full[0] in build.parents:
            raise OSError(errno.ENOSPC, "No space left on device")
        compiled(source, compiler, build)

    monkeypatch.setattr(compiling, "_compile", compile)
    monkeypatch.delenv("INSENV_BACKEND", raising=False)
    with pytest.warns(RuntimeWarning, match=f"{re.escape(str(cache))}: No space left on device"):
        library = compile_library(native_source(toy), find_compiler())
    assert library.exists() and cache not in library.parents and list(cache.iterdir()) == []
    library.unlink()
    full[0] = Path("/")
    compiling._library.cache_clear()
    with pytest.warns(RuntimeWarning, match="No space left on device"):
        assert make_runner(toy).backend == "interpreter"
    with pytest.raises(NoRoomError, match="No space left"):
        make_runner(toy, backend="native")


def test_the_folder_of_a_process_goes_with_it(tmp_path):
    (tmp_path / "file").write_text("")
    code = "from insenv.core.cache import cache_folder; print(cache_folder())"
    environment = {**os.environ, "INSENV_CACHE_DIR": str(tmp_path / "file" / "cache")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert "insenv-" in done.stdout and not Path(done.stdout.strip()).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="the compiler that counts is a shell script")
def test_whoever_needs_what_another_compiles_waits_for_it(cache, toy, tmp_path):
    counting, runs = tmp_path / "counting-cc", tmp_path / "runs"
    counting.write_text(f'#!/bin/sh\ncase "$*" in *-shared*) echo run >> {runs};; esac\nsleep 0.1\nexec cc "$@"\n')
    counting.chmod(0o700)
    compiler, source = Compiler((str(counting),), find_compiler().flags), native_source(toy)
    with ThreadPoolExecutor(5) as pool:
        found = set(pool.map(lambda _: compile_library(source, compiler), range(8)))
    assert len(found) == 1 and runs.read_text().splitlines() == ["run"]
    assert [p.name for p in cache.iterdir()] == [found.pop().parent.name]  # no lock is left


def test_other_equations_conditions_and_code_that_writes_are_other_entries(cache, toy, monkeypatch):
    rare, kick = toy.steps["rare"], toy.steps["kick"]
    changes = [
        {}, {"steps": {**toy.steps, "rare": replace(rare, function=lambda p, x, u, r: {"rare": x.rare + 2})}},
        {"steps": {**toy.steps, "kick": replace(kick, when="rare_due")}}, {"start": lambda p, r: {"rare": r[0] * p.gain}},
    ]  # fmt: skip
    sources = [compiling.native_source, compiling.batch_source, partial(compiling.batch_source, lanes=2)]
    found = [compiling._looked_up(replace(toy, **change), sources[0])() for change in changes]
    found += [compiling._looked_up(toy, source)() for source in sources[1:]]
    monkeypatch.setattr(compiling, "WRITER", "other")
    found.append(compiling._looked_up(toy, sources[0])())
    assert len(set(found)) == len(found)


def test_all_code_that_writes_functions_as_c_names_the_entries():
    modules = {getattr(value, "__module__", None) for value in vars(codegen).values()}
    own = {name.removeprefix("insenv.core.") for name in modules if name and name.startswith("insenv.core.")}
    assert own == {*codegen.WRITERS, "model", "traces", "cache"}  # model, traces: their result is in the fingerprint


def test_a_failing_compiler_is_reported_and_leaves_nothing_but_is_no_fault_of_the_code_on_a_full_disk(cache, monkeypatch):
    with pytest.raises(CompileError, match="failed on generated code"):
        compile_library("this is not C", find_compiler())
    assert list(cache.iterdir()) == []
    monkeypatch.setattr(compiling, "SMALLEST_ROOM", 2**80)
    with pytest.warns(RuntimeWarning, match="No space left"), pytest.raises(NoRoomError):
        compile_library("this is not C", find_compiler())


def test_environment_names_the_compiler_and_without_one_there_is_none(monkeypatch):
    monkeypatch.setenv("CC", f"{shutil.which('cc')} -g0")
    assert find_compiler().command[1:] == ("-g0",)
    monkeypatch.delenv("CC")
    monkeypatch.setattr(compiling.shutil, "which", lambda name: None)
    monkeypatch.setattr(compiling.importlib.util, "find_spec", lambda name: None)
    assert find_compiler() is None
