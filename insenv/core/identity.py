"""The identity of a model that is not traced: what its equations follow from.

A model is made of functions, and functions of code, of the values that they hold and of the global names that they use.  For
functions of insenv the code is known by a hash of all its sources, and what they hold or name is known by value: a constant or
a function that a script has replaced is noticed.  Two models with the same identity therefore have the same equations.  A
function from outside insenv may depend on anything, so that a model with one has no identity.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import sys
from collections.abc import Iterator, Mapping, ValuesView
from enum import Enum
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, GenericAlias, MethodType, ModuleType, SimpleNamespace, UnionType
from typing import Any

import casadi as ca
import numpy as np

from insenv.base.starting import BEGUN
from insenv.core.cache import source_digest
from insenv.core.tables import Row

_PACKAGE = "insenv"
_PLAIN = (str, bytes, int, float, complex, bool, type(None), type(Ellipsis), slice, range)
_LIBRARIES = frozenset({"numpy", "casadi", "pydantic", *sys.stdlib_module_names}) - {"__main__"}
"""Where the functions come from that insenv names, but did not define."""


class _UnknownError(Exception):
    """Something whose effect on the equations is not known by its value."""


def identity(model: Any) -> str | None:
    """A hash that models (`insenv.Model`) with the same equations and tables share; None if only tracing can tell."""
    try:
        digest = hashlib.sha256(_environment().encode())
        for part in _parts([getattr(model, field.name) for field in dataclasses.fields(model)], {}, set()):
            digest.update(part.encode())
            digest.update(b"\0")
    except _UnknownError:
        return None
    return digest.hexdigest()


@functools.cache
def _environment() -> str:
    """What else decides the equations: the sources of insenv, and the versions of Python, NumPy and CasADi."""
    files = list(Path(__file__).parents[1].rglob("*.py"))
    if max(path.stat().st_mtime for path in files) >= BEGUN:  # what is imported may be older than what is read here
        raise _UnknownError
    sources = source_digest(files)
    return "\0".join((sources, sys.version, np.__version__, ca.CasadiMeta.version()))


def _parts(thing: Any, met: dict[int, int], described: set[int]) -> Iterator[str]:
    """Texts that say what a thing is.

    met: the things that hold it, by their address; a thing may hold itself.  described: addresses of the functions of modules
    that have been described already; there are many that use each other.
    """
    kind = type(thing)
    if kind in _PLAIN:
        yield f"{kind.__name__} {thing!r}"
        return
    if kind is Row and type(thing.start) in (int, float):  # there are hundreds of them
        yield repr(thing)
        return
    if id(thing) in met:
        yield f"again {met[id(thing)]}"
        return
    met = {**met, id(thing): len(met)}
    if kind in (tuple, list):
        yield f"{kind.__name__} {len(thing)}"
        for item in thing:
            yield from _parts(item, met, described)
    elif isinstance(thing, Mapping):
        yield f"mapping {len(thing)}"
        for key, value in thing.items():
            yield from _parts(key, met, described)
            yield from _parts(value, met, described)
    elif kind in (set, frozenset):
        yield f"set {sorted(chr(0).join(_parts(item, met, described)) for item in thing)}"
    elif isinstance(thing, (np.ndarray, np.generic)):
        array = np.asarray(thing)
        if array.dtype.hasobject:
            raise _UnknownError
        yield f"array {array.dtype.str} {array.shape} {hashlib.sha256(array.tobytes()).hexdigest()}"
    elif isinstance(thing, functools.partial):
        yield "partial"
        yield from _parts((thing.func, thing.args, thing.keywords), met, described)
    elif isinstance(thing, FunctionType):
        yield from _of_function(thing, met, described)
    elif isinstance(thing, MethodType):
        yield "method"
        yield from _parts((thing.__self__, thing.__func__), met, described)
    elif isinstance(thing, (BuiltinFunctionType, ModuleType)):
        yield f"builtin {getattr(thing, '__module__', '')} {thing.__name__}"
    elif isinstance(thing, SimpleNamespace):
        yield "namespace"
        yield from _parts(vars(thing), met, described)
    elif isinstance(thing, ValuesView):
        yield from _parts(tuple(thing), met, described)
    elif isinstance(thing, ca.Function):
        yield f"equations {hashlib.sha256(thing.serialize().encode()).hexdigest()}"
    elif isinstance(thing, ca.SX) and thing.is_constant():
        yield f"constant {ca.evalf(thing).serialize()}"
    elif isinstance(thing, (GenericAlias, UnionType)) or kind.__module__ == "typing":
        yield "annotation"  # which values a key of a file allows: it decides no equation
    else:
        yield from _of_object(thing, met, described)


def _of_function(function: FunctionType, met: dict[int, int], described: set[int]) -> Iterator[str]:
    code = function.__code__
    # a function from outside that wraps one of insenv by functools.wraps has the __module__ of that one
    if not (_is_ours(function.__module__) and _is_ours(function.__globals__.get("__name__", ""))):
        raise _UnknownError
    if id(function) in described:
        yield f"described {function.__module__} {function.__qualname__}"
        return
    if sys.modules.get(function.__module__) and getattr(sys.modules[function.__module__], function.__name__, None) is function:
        described.add(id(function))
    # two lambdas of one line have one name: their code tells them apart
    yield f"function {function.__module__} {function.__qualname__} {code.co_firstlineno} {code.co_code.hex()} {code.co_names}"
    try:
        held = [cell.cell_contents for cell in function.__closure__ or ()]
    except ValueError:  # a cell without a value
        raise _UnknownError from None
    constants = [value for value in code.co_consts if type(value) in _PLAIN]
    yield from _parts((constants, code.co_freevars, held, function.__defaults__, function.__kwdefaults__), met, described)
    if wrapped := getattr(function, "__wrapped__", None):
        yield from _parts(wrapped, met, described)
    for name, value in _named(code, function.__globals__):
        yield name
        yield from _of_global(value, met, described)


def _named(code: CodeType, space: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The global names that code uses, with their values, and the attributes that it may take of modules of insenv."""
    spaces = [space]
    for each in spaces:
        for name in code.co_names:
            if name not in each:
                continue
            value = each[name]
            yield name, value
            if isinstance(value, ModuleType) and _is_ours(value.__name__) and not any(vars(value) is known for known in spaces):
                spaces.append(vars(value))
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _named(inner, space)


def _of_global(value: Any, met: dict[int, int], described: set[int]) -> Iterator[str]:
    """Texts of the value of a global name; an object that is not known by value cannot affect an equation."""
    if isinstance(value, FunctionType) and value.__globals__.get("__name__", "").partition(".")[0] in _LIBRARIES:
        yield f"{value.__module__} {value.__qualname__}"
    elif isinstance(value, FunctionType):
        yield from _parts(value, met, described)
    elif wrapped := getattr(value, "__wrapped__", None):  # functools.cache
        yield from _of_global(wrapped, met, described)
    else:
        try:
            yield from list(_parts(value, met, described))
        except _UnknownError:
            yield f"a {type(value).__qualname__}"


def _of_object(thing: Any, met: dict[int, int], described: set[int]) -> Iterator[str]:
    kind = thing if isinstance(thing, type) else type(thing)
    if not _is_ours(kind.__module__):
        raise _UnknownError
    yield f"{kind.__module__} {kind.__qualname__}"
    if id(kind) not in described:
        described.add(id(kind))
        for base in kind.__mro__:
            for name, function in _methods(base):
                yield name
                yield from _of_global(function, met, described)
    if isinstance(thing, type):
        return
    if isinstance(thing, Enum):
        yield thing.name
    elif dataclasses.is_dataclass(thing):
        yield from _parts([getattr(thing, field.name) for field in dataclasses.fields(thing)], met, described)
    elif hasattr(thing, "model_dump"):  # a section of a file
        yield from _parts(thing.model_dump(), met, described)
    else:
        raise _UnknownError


def _methods(kind: type) -> Iterator[tuple[str, FunctionType]]:
    """What a class of insenv defines in words, not what `dataclasses` writes for it."""
    if _is_ours(kind.__module__):
        for name, value in vars(kind).items():
            function = getattr(value, "__func__", None) or getattr(value, "fget", None) or getattr(value, "func", None) or value
            if isinstance(function, FunctionType) and function.__code__.co_filename != "<string>":
                yield name, function


def _is_ours(module: str) -> bool:
    return module == _PACKAGE or module.startswith(f"{_PACKAGE}.")
