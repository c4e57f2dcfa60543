"""A model compiled to WebAssembly, which runs bit for bit in any browser.

The C source is that of every other face; its operations are rounded in exactly one way.  The compiler is the `ziglang`
wheel, the module imports nothing and links no library, and it is cached as the native libraries are.
"""

from __future__ import annotations

import sys
from pathlib import Path

from insenv.base.installing import need
from insenv.core.codegen import module_source
from insenv.core.compile import Compiler, compile_library
from insenv.core.model import Model

_FLAGS = ("-target", "wasm32-wasi", "-std=gnu99", "-O2", "-g0", "-ffp-contract=off", "-fno-math-errno", "-w", "-c")
_LINK = ("--no-entry", "--strip-all", "-z", "stack-size=262144", "--export=__heap_base")

_EXPORTS = """
#define EXPORTED(name) __attribute__((export_name(#name)))
EXPORTED(run) void exported_run(const double *p, double *x, const double *u, double *y, int every, int n) {
  insenv_run(1, p, x, u, 0, 0, y, 0, every, n);
}
EXPORTED(output) void exported_output(const double *p, const double *x, double *y) { insenv_output(1, p, x, y); }
"""


def wasm_compiler() -> Compiler:
    """The compiler to WebAssembly.  Raises `InputError` if the `ziglang` wheel is not installed."""
    need("a page", "ziglang", extra="web")
    zig = (sys.executable, "-m", "ziglang")
    return Compiler((*zig, "cc"), _FLAGS, (*zig, "wasm-ld", *_LINK))


def wasm_source(model: Model, further: str = "") -> str:
    """C source of the module: the model, its exports, and the C text `further`, which may use both.

    Exports: ``run(p, x, u, y, every, n)`` advances n times with constant inputs and writes the outputs after each `every`-th
    advance (0: never); ``output(p, x, y)``; ``memory`` and ``__heap_base``, from where on memory is free.  Addresses are
    bytes; vectors are float64 in the order of the model's tables.
    """
    return module_source(model) + _EXPORTS + further


def wasm(source: str) -> bytes:
    """The WebAssembly module of a C source, taken from the cache or compiled.

    Raises `InsenvError` if there is no compiler to WebAssembly, `CompileError` if it fails.
    """
    return Path(compile_library(source, wasm_compiler())).read_bytes()
