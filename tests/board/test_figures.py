"""The figures of a filter on a Cortex-M7, and the whole of it in qemu."""

import re
from itertools import product
from pathlib import Path

import pytest
from peers import program, ran

from insenv.export.board import export_c, figures
from insenv.export.board.figures import COMPILER, INSTALL, QEMU, WHOLE, deepest
from insenv.export.board.precision import NEEDED


def test_the_stack_is_that_of_the_deepest_path():
    """Of a graph as gcc -fcallgraph-info=su writes it."""
    assert deepest(Path(__file__).with_name("f.ci").read_text(), ["f_init"]) == 132


def test_without_the_compiler_there_are_no_figures(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert figures.figures(tmp_path, "f") is None


@pytest.mark.slow
@pytest.mark.parametrize(("id", "precision"), [("q-method", "double"), *product(("loosely-coupled", "fusion"), NEEDED)])
def test_a_whole_run_on_a_cortex_m7_has_the_same_bits(tmp_path, id, precision):
    for name in (COMPILER, QEMU):
        program(name, how=INSTALL)
    exported = export_c(id, output=tmp_path, precision=precision, whole_run=True)
    measured = exported.figures
    assert measured is not None
    assert measured.same_bits
    assert 0 < measured.stack < (1000 if id == "q-method" else 2000)
    assert measured.instructions[WHOLE].calls == exported.samples
    flags = "CFLAGS=-O2 -Wall -Wextra -Wconversion -Wshadow -pedantic -Werror"
    command = ["make", "-s", "-C", tmp_path, "board", flags, "RUN=test/run.bin"]
    said = rf"^test/run.bin: {exported.run_samples} samples, (\d+) numbers compared, 0 differ$"
    (compared,) = re.findall(said, ran(*command), re.M)
    assert int(compared) > 2000


@pytest.mark.slow
def test_cmake_builds_the_filter_and_runs_its_test(tmp_path):
    cmake = program("cmake", how="apt-get install cmake")
    export_c("q-method", output=tmp_path, measure=False)
    ran(cmake, "-S", tmp_path, "-B", tmp_path / "build")
    ran(cmake, "--build", tmp_path / "build")
    ran("ctest", "--test-dir", tmp_path / "build", "--no-tests=error")
