"""The figures of a filter on a Cortex-M7, and the whole of it in qemu."""

import re

import pytest
from peers import program, ran

from insenv.export.board import export_c, figures
from insenv.export.board.figures import COMPILER, INSTALL, QEMU, WHOLE, deepest

GRAPH = r"""graph: { title: "f.c"
node: { title: "f_init" label: "f_init\nf.c:3:1\n24 bytes (static)\n0 dynamic objects" }
node: { title: "f.c:a" label: "a\nf.c:1:1\n100 bytes (static)" }
node: { title: "f.c:b" label: "b\nf.c:2:1\n8 bytes (static)" }
node: { title: "sqrt" label: "sqrt\nmath.h:1:1" shape : ellipse }
edge: { sourcename: "f_init" targetname: "f.c:b" label: "f.c:4:1" }
edge: { sourcename: "f.c:b" targetname: "f.c:a" label: "f.c:5:1" }
edge: { sourcename: "f.c:a" targetname: "sqrt" label: "f.c:6:1" }
node: { title: "unused" label: "unused\nf.c:7:1\n999 bytes (static)" }
}
"""


def test_the_stack_is_that_of_the_deepest_path():
    assert deepest(GRAPH, ["f_init"]) == 132


def test_without_the_compiler_there_are_no_figures(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert figures.figures(tmp_path, "f") is None


@pytest.mark.slow
@pytest.mark.parametrize(("id", "stack"), [("q-method", 1000), ("loosely-coupled", 2000), ("fusion", 2000)])
def test_a_whole_run_on_a_cortex_m7_has_the_same_bits(tmp_path, id, stack):
    for name in (COMPILER, QEMU):
        program(name, how=INSTALL)
    exported = export_c(id, output=tmp_path, whole_run=True)
    measured = exported.figures
    assert measured is not None
    assert measured.same_bits
    assert 0 < measured.stack < stack
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
