"""Compiled libraries of models: which one, loaded once, and the driver's functions in it."""

from __future__ import annotations

import ctypes
import functools

from insenv.core.codegen import batch_source, native_source
from insenv.core.compile import CompileError, compile_library, find_compiler
from insenv.core.model import Model
from insenv.core.tables import Vector


@functools.lru_cache(maxsize=64)
def library_path(model: Model) -> str:
    """Path of a model's library for one row (compiled at the first call in the process, or taken from the cache)."""
    return _compiled(native_source(model))


@functools.lru_cache(maxsize=64)
def batch_library_path(model: Model, lanes: int | None) -> str:
    """Path of a model's library for blocks of `lanes` rows (None: as many as suit the processor)."""
    return _compiled(batch_source(model, lanes))


def _compiled(source: str) -> str:
    compiler = find_compiler()
    if compiler is None:
        raise CompileError("no C compiler found")
    return str(compile_library(source, compiler))


@functools.cache
def load(path: str) -> ctypes.CDLL:
    """The library with the driver's functions declared; calls release the GIL."""
    library = ctypes.CDLL(path)
    address, whole = ctypes.c_void_p, ctypes.c_int64
    library.insenv_run.argtypes = [whole, address, address, address, whole, whole, address, whole, whole, whole]
    library.insenv_start.argtypes = [whole, address, address]
    library.insenv_output.argtypes = [whole, address, address, address]
    library.insenv_round.argtypes = [whole, whole, address, address, address, whole, address, whole, whole, address, whole]
    for name in ("insenv_run", "insenv_start", "insenv_output", "insenv_round"):
        getattr(library, name).restype = None
    return library


def pointer(array: Vector) -> int:
    """Address of an array's first element."""
    return array.ctypes.data
