"""The function that long work calls to report its progress."""

from __future__ import annotations

import inspect
from collections.abc import Callable

from insenv.base.errors import InputError

Progress = Callable[[int, int], None]
"""Callback with the numbers of samples done and in all."""


def check_progress(progress: object, takes: tuple[str, ...] = ("done", "total")) -> None:
    """Raise `InputError` unless `progress` is None or a function that can be called with the arguments `takes`."""
    if progress is None:
        return
    try:
        inspect.signature(progress).bind(*takes)  # type: ignore[arg-type]
    except TypeError:
        raise InputError(f"progress = {progress!r}: allowed is None or a function of ({', '.join(takes)})") from None
    except ValueError:  # a function of C that shows no signature
        return
