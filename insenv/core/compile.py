"""Compiled models: the C compiler and its flags, the entries of the cache, and loading one.

A cache entry is a folder named by the hash of everything that determines the library (source, flags, compiler,
machine).  It holds the library and the library's own hash.  It is built under a temporary name and renamed, so that two
processes can compile at the same time and no process sees a partly written entry.  An entry that is damaged, or that
another user could have written, is not loaded but rebuilt.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import hashlib
import importlib.util
import logging
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from insenv.base.errors import InputError, InsenvError
from insenv.base.installing import need
from insenv.base.output import LockedError, exclusive
from insenv.core.cache import cache_folder, is_lasting, is_private, process_folder
from insenv.core.codegen import WRITER, batch_source, function_text, module_source, native_source, prelude
from insenv.core.model import Model
from insenv.core.tables import Vector
from insenv.core.traces import Kernel

# compilers for other processors may not support it, and gain little from it
_PROCESSOR = ("-march=native",) if platform.machine() in ("x86_64", "AMD64") else ()
LEVELS, LEVEL = ("0", "1", "2", "3"), "2"
"""Levels of optimisation that INSENV_OPTIMIZATION may name, and the one without it."""
# exact rounding in the order written, at every level of optimisation: bit-identical to the interpreter
_FLAGS = (
    "-std=gnu99",
    *_PROCESSOR,
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-tree-slp-vectorize",
    "-fvisibility=hidden",
    "-shared",
    "-fPIC",
    "-w",
)


POLLING_S = 0.02
"""Time between two looks whether another process has built an entry."""
LOG = logging.getLogger(__name__)
"""Tells, at level INFO, when a compilation begins (`COMPILING`, or `COMPILING_HERE` for this process alone) and ends."""
COMPILING, COMPILING_HERE, COMPILED = "compiling, once", "compiling", "compiled"
LIBRARY = "model.so"
SMALLEST_ROOM = 2**20
"""Free bytes below which a failed compilation is put down to a full disk: compilers die in many ways of it."""


class CompileError(InsenvError):
    """The compiler failed on generated code."""


class NoRoomError(CompileError):
    """There is no folder that a compiled model can be written to."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler's command line and flags.

    linker: command line with flags of a separate linker; empty: the compiler links.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...]
    linker: tuple[str, ...] = ()

    def commands(self, source: Path, library: Path) -> list[list[str]]:
        """The command lines that make the library of a C source."""
        if not self.linker:
            return [[*self.command, *self.flags, str(source), "-o", str(library), "-lm"]]
        compiled = str(source.with_suffix(".o"))
        return [[*self.command, *self.flags, str(source), "-o", compiled], [*self.linker, compiled, "-o", str(library)]]

    @functools.cached_property
    def identity(self) -> str:
        """What determines its output besides source and flags: the version and the processor."""
        version = subprocess.run([*self.command, "--version"], capture_output=True, text=True, check=False)
        return "\n".join([*self.command, version.stdout, platform.machine(), _processor()])


def find_compiler() -> Compiler | None:
    """The first C compiler found among the environment's CC, cc, gcc, clang and the `ziglang` wheel, or None.

    The environment's INSENV_OPTIMIZATION is its level of optimisation: a lower one compiles faster, and the models run slower
    with the same bits.  Raises `InputError` for another value than 0 to 3.
    """
    level = os.environ.get("INSENV_OPTIMIZATION", LEVEL)
    if level not in LEVELS:
        raise InputError(f"INSENV_OPTIMIZATION = {level!r}: allowed is a level of optimisation, {', '.join(LEVELS)}")
    flags = (f"-O{level}", *_FLAGS)
    for name in filter(None, (os.environ.get("CC"), "cc", "gcc", "clang")):
        words = tuple(name.split())
        if words and shutil.which(words[0]):
            return Compiler(words, flags)
    if importlib.util.find_spec("ziglang") is not None:
        return Compiler((sys.executable, "-m", "ziglang", "cc"), flags)
    return None


def compile_library(source: str, compiler: Compiler, origin: str = "") -> Path:
    """Path of the shared library of `source`, taken from the cache or compiled.

    origin: text that is the same only for the same source, which names the entry in its place (`cached_library`).  If the disk
    of the cache is full, the library is kept in a folder of this process; with a warning.  Raises `CompileError`,
    `NoRoomError` if there is no room anywhere.
    """
    key = _key(origin or source, compiler)
    try:
        cache = cache_folder()
        try:
            return _library_in(cache, key, source, compiler)
        except OSError as error:
            return _library_in(process_folder(cache, error.strerror or str(error)), key, source, compiler)
    except OSError as error:
        raise NoRoomError(f"no folder to compile models in: {error.strerror or error}") from None


def cached_library(origin: str, compiler: Compiler) -> Path | None:
    """Path of the library that `compile_library` has put in the cache for this origin; None if there is none."""
    with contextlib.suppress(OSError):
        entry = cache_folder() / _key(origin, compiler)
        if _is_intact(entry):
            return entry / LIBRARY
    return None


def _key(origin: str, compiler: Compiler) -> str:
    parts = (origin, *compiler.flags, *compiler.linker, compiler.identity)
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _library_in(cache: Path, key: str, source: str, compiler: Compiler) -> Path:
    """Path of the library in this cache folder, compiled if it is not there.  Raises `CompileError`, OSError."""
    entry = cache / key
    with _alone(cache / f"{key}.lock", entry):
        if not _is_intact(entry):
            _build(source, compiler, cache, entry)
    return entry / LIBRARY


@contextlib.contextmanager
def _alone(lock: Path, entry: Path) -> Iterator[None]:
    """Wait while another thread or process builds the entry: it would take the same time twice."""
    with contextlib.ExitStack() as held:
        while not _is_intact(entry):
            try:
                held.enter_context(exclusive(lock))
                break
            except LockedError:
                time.sleep(POLLING_S)
            except OSError:  # a file system without locks
                break
        yield


def _build(source: str, compiler: Compiler, cache: Path, entry: Path) -> None:
    with tempfile.TemporaryDirectory(dir=cache, prefix="build-", ignore_cleanup_errors=True) as name:
        build = Path(name) / "entry"
        build.mkdir(mode=0o700)
        LOG.info(COMPILING if is_lasting(cache) else COMPILING_HERE)
        try:
            _compile(source, compiler, build)
        finally:
            LOG.info(COMPILED)
        digest = hashlib.sha256((build / LIBRARY).read_bytes()).hexdigest()
        (build / "model.sha256").write_text(digest)
        # a folder cannot be renamed onto an existing one: move a broken entry away first
        for _ in range(10):
            if _is_intact(entry):
                break
            with contextlib.suppress(OSError):
                entry.rename(Path(name) / f"broken-{os.urandom(4).hex()}")
            with contextlib.suppress(OSError):
                build.rename(entry)
    if not _is_intact(entry):
        raise CompileError(f"cannot keep a compiled model in {cache}: is the folder writable?")


def _compile(source: str, compiler: Compiler, build: Path) -> None:
    text = build / "model.c"
    text.write_text(source)
    for command in compiler.commands(text, build / LIBRARY):
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except OSError as error:
            raise CompileError(f"{command[0]} cannot be run: {error.strerror or error}") from None
        if done.returncode and shutil.disk_usage(build).free < SMALLEST_ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if done.returncode:
            raise CompileError(f"{' '.join(compiler.command)} failed on generated code:\n{done.stderr[-2000:]}")


def _is_intact(entry: Path) -> bool:
    """Whether only this user can write the entry and its library has the hash stored beside it."""
    try:
        if not (is_private(entry) and is_private(entry / LIBRARY)):
            return False
        noted = (entry / "model.sha256").read_text()
        return hashlib.sha256((entry / LIBRARY).read_bytes()).hexdigest() == noted
    except OSError:
        return False


@functools.cache
def _processor() -> str:
    """The processor's name and features, on which -march=native depends."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))


class _Library:
    """A model's library for one row: its compiler may run while its caller does other work."""

    def __init__(self, model: Model) -> None:
        self._model, self._path = model, ""
        self._begun: Future[str] | None = None

    def begin(self) -> None:
        """Start the compiler unless it has been started."""
        if not self._path and self._begun is None:
            self._begun = _pool().submit(_looked_up(self._model, native_source))

    def path(self) -> str:
        """Path of the library, once it is compiled."""
        if not self._path:
            begun, self._begun = self._begun, None  # after a failure the next call tries again
            self._path = begun.result() if begun is not None else _looked_up(self._model, native_source)()
        return self._path


_library = functools.lru_cache(maxsize=64)(_Library)


def begin_libraries(models: Iterable[Model]) -> None:
    """Start to compile models that are about to be run, each in a process of its own; returns without waiting."""
    for model in models:
        _library(model).begin()


def library_path(model: Model) -> str:
    """Path of a model's library for one row, taken from the cache or compiled at the first call."""
    return _library(model).path()


@functools.cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="insenv-compile")


@functools.lru_cache(maxsize=64)
def batch_library_path(model: Model, lanes: int | None) -> str:
    """Path of a model's library for blocks of `lanes` rows (None: as many as suit the processor)."""
    return _looked_up(model, functools.partial(batch_source, lanes=lanes))()


def _looked_up(model: Model, source: Callable[..., str]) -> Callable[[], str]:
    """A function that gives the path of a model's library, by the compiler if it is not in the cache.

    The functions of the source, which take long to write, are written only for the compiler: they follow from the model's
    equations and the code that writes them.
    """
    compiler = find_compiler()
    if compiler is None:
        raise CompileError("no C compiler found")
    origin = "\0".join([WRITER, model.fingerprint, source(model, functions={})])
    cached = cached_library(origin, compiler)
    if cached is not None:
        return lambda: str(cached)
    written = source(model)
    return lambda: str(compile_library(written, compiler, origin))


@functools.cache
def load(path: str) -> ctypes.CDLL:
    """Load a library and declare the driver's functions; its calls release the GIL."""
    library = ctypes.CDLL(path)
    address, whole = ctypes.c_void_p, ctypes.c_int64
    library.insenv_run.argtypes = [whole, address, address, address, whole, whole, address, whole, whole, whole]
    library.insenv_start.argtypes = [whole, address, address]
    library.insenv_output.argtypes = [whole, address, address, address]
    library.insenv_cycle.argtypes = [whole, whole, address, address, address, whole, address, whole, whole, address, whole]
    for name in ("insenv_run", "insenv_start", "insenv_output", "insenv_cycle"):
        getattr(library, name).restype = None
    return library


def pointer(array: Vector) -> int:
    """Address of the first element of an array."""
    return array.ctypes.data


# A model compiled to WebAssembly, which runs bit for bit in any browser.
#
# The C source is that of every other interface; its operations are rounded in exactly one way.  The compiler is the `ziglang`
# wheel, the module imports nothing and links no library, and it is cached as the native libraries are.

_WASM_FLAGS = ("-target", "wasm32-wasi", "-std=gnu99", "-O2", "-g0", "-ffp-contract=off", "-fno-math-errno", "-w", "-c")
_LINK = ("--no-entry", "--strip-all", "-z", "stack-size=262144", "--export=__heap_base")

_EXPORTED = """
#define EXPORTED(name) __attribute__((export_name(#name)))
"""
_EXPORTS = f"""{_EXPORTED}
EXPORTED(run) void exported_run(const double *p, double *x, const double *u, double *y, int every, int n) {{
  insenv_run(1, p, x, u, 0, 0, y, 0, every, n);
}}
EXPORTED(output) void exported_output(const double *p, const double *x, double *y) {{ insenv_output(1, p, x, y); }}
"""


def wasm_compiler() -> Compiler:
    """The compiler to WebAssembly.  Raises `InputError` if the `ziglang` wheel is not installed."""
    need("a page", "ziglang", extra="web")
    zig = (sys.executable, "-m", "ziglang")
    return Compiler((*zig, "cc"), _WASM_FLAGS, (*zig, "wasm-ld", *_LINK))


def wasm_source(model: Model, further: str = "") -> str:
    """C source of the module: the model, its exports, and the C text `further`, which may use both.

    Exports: ``run(p, x, u, y, every, n)`` advances n times with constant inputs and writes the outputs after each `every`-th
    advance (0: never); ``output(p, x, y)``; ``memory`` and ``__heap_base``, from where on memory is free.  Addresses are
    bytes; vectors are float64 in the order of the model's tables.
    """
    return module_source(model) + _EXPORTS + further


def wasm_functions(functions: Mapping[str, Any], arguments: str) -> str:
    """C source of a module of functions of flat columns without a model; arguments: a letter each, of all of them.

    Exports: ``NAME(..., y)``, ``memory`` and ``__heap_base``.
    """
    signature = ", ".join(f"const real *{letter}" for letter in arguments)
    exports = [
        f"EXPORTED({name}) void exported_{name}({signature}, real *y) {{ {name}({', '.join(arguments)}, y); }}"
        for name in functions
    ]
    sources = [function_text("", name, Kernel(function, ()), arguments) for name, function in functions.items()]
    return "\n".join([prelude("scalar.h"), *sources, _EXPORTED, *exports])


def wasm(source: str) -> bytes:
    """The WebAssembly module of a C source, taken from the cache or compiled.

    Raises `InsenvError` if there is no compiler to WebAssembly, `CompileError` if it fails.
    """
    return Path(compile_library(source, wasm_compiler())).read_bytes()
