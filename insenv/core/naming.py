"""Errors of functions that an author writes (of steps, vehicles, sensors): they name the function and its fault."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

from insenv.base.errors import InputError, InsenvError, nearest
from insenv.core.tables import Table


@contextmanager
def naming(where: str, prefixed: bool = True) -> Iterator[None]:
    """Raise an error of the block as an `InputError` that begins with `where`, with the original as its cause.

    prefixed: whether the message of an `InputError` begins with `where` too; else it stays.
    """
    try:
        yield
    except InputError as error:
        if not prefixed:
            raise
        raise InputError(f"{where}: {error}") from error
    except InsenvError:
        raise
    except Exception as error:
        raise InputError(f"{where}: {_fault(error)}") from error


def check_rows(values: Any, table: Table) -> Mapping[str, Any]:
    """`values` if it is a mapping with names of the table's rows.  Raises `InputError` otherwise."""
    for name in check_mapping(values):
        table.slice(name)
    return values


def check_mapping(values: Any) -> Mapping[str, Any]:
    """`values` if it is a mapping.  Raises `InputError` otherwise."""
    if not isinstance(values, Mapping):
        raise InputError(f"the result is of type {type(values).__name__}: allowed is a dict of values by row name")
    return values


def _fault(error: Exception) -> str:
    """One line about an error of Python, NumPy or CasADi."""
    if isinstance(error, AttributeError) and isinstance(error.obj, SimpleNamespace):
        return f"no row named {error.name!r}{nearest(str(error.name), vars(error.obj))}"
    text = str(error).strip()
    if "truth value" in text:
        return (
            "a CasADi symbol has no truth value: allowed is casadi.if_else instead of `if`, casadi.logic_and instead of `and`"
        )
    line = re.sub(r"^\.\.\./casadi/\S+ ", "", text.splitlines()[-1].strip()) if text else "no message"
    return f"{type(error).__name__}: {line}"
