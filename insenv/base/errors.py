"""The errors that insenv raises for faults that a caller can correct.

Every message names the thing, its value and what is allowed.  The command line prints the message and exits.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace


class InsenvError(Exception):
    """Base of the errors of insenv: the work could not be done (exit status 1 at the command line)."""


class InputError(InsenvError, ValueError):
    """The call was wrong: a value, name or file that is not allowed (exit status 2 at the command line)."""


class UnknownArgumentError(InputError, TypeError):
    """A keyword argument that a constructor does not take, in the words of Python's own error.

    Libraries try an argument and read the `TypeError` (TorchRL: ``frameskip``).
    """


MAX_NAMES, NEAREST_NAMES, NEARBY_NAMES = 12, 6, 10
"""Allowed names that a message lists; of more, so many of the nearest where they are listed elsewhere too, and where not."""


LISTED = "`insenv list`"
"""Where scenarios, estimators, vehicles, sensors and grades are listed."""


def nearest(name: str, allowed: Iterable[str], listed: str = "") -> str:
    """End of a message about an unknown `name`: the nearest allowed name, and the allowed names.

    listed: where they are listed too, such as `LISTED`.  Of more than `MAX_NAMES` the message has the nearest ones, in the
    order of `allowed`, and how many there are besides.
    """
    allowed = list(allowed)
    if len(allowed) <= MAX_NAMES:
        return f"{guess(name, allowed)} (allowed: {', '.join(allowed) or 'none'})"
    count = NEAREST_NAMES if listed else NEARBY_NAMES
    nearby = sorted(difflib.get_close_matches(name, allowed, n=count, cutoff=0.0), key=allowed.index)
    rest = f" and {len(allowed) - len(nearby)} more{f'; {listed} shows all' if listed else ''}"
    return f"{guess(name, allowed)} (allowed: {', '.join(nearby)}{rest})"


def guess(name: str, allowed: Iterable[str]) -> str:
    """The nearest allowed name as a question; empty if none is near.

    A name with another first letter must be nearer: 'super' is not a misspelt 'consumer', nor 'spp'.
    """
    for close in difflib.get_close_matches(name, list(allowed), n=NEAREST_NAMES, cutoff=0.55):
        if close[:1].lower() == name[:1].lower() or difflib.SequenceMatcher(None, close, name).ratio() >= 0.7:
            return f"; did you mean {close!r}?"
    return ""


# Errors of functions that an author writes (of steps, vehicles, sensors): they name the function and its fault.


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
