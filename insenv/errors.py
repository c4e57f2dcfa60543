"""The errors that insenv raises for faults that a caller can correct.

Every message names the thing, its value and what is allowed.  The command line prints the message and exits.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InsenvError(Exception):
    """Base of the errors of insenv: the work could not be done (exit status 1 at the command line)."""


class InputError(InsenvError, ValueError):
    """The call was wrong: a value, name or file that is not allowed (exit status 2 at the command line)."""


def nearest(name: str, allowed: Iterable[str]) -> str:
    """End of a message about an unknown `name`: the nearest allowed name, and all allowed names."""
    allowed = list(allowed)
    close = difflib.get_close_matches(name, allowed, n=1, cutoff=0.5)
    guess = f"; did you mean {close[0]!r}?" if close else ""
    return f"{guess} (allowed: {', '.join(allowed) or 'none'})"
