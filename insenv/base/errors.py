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


MAX_NAMES, NEAREST_NAMES = 12, 6
"""Allowed names that a message lists; of more, the nearest ones."""


LISTED = "`insenv list`"
"""Where scenarios, estimators, vehicles, sensors and grades are listed."""


def nearest(name: str, allowed: Iterable[str], listed: str = "") -> str:
    """End of a message about an unknown `name`: the nearest allowed name, and the allowed names.

    listed: where they are listed too, such as `LISTED`: of more than `MAX_NAMES` the message then has the nearest ones, in the
    order of `allowed`.
    """
    allowed = list(allowed)
    if not listed or len(allowed) <= MAX_NAMES:
        return f"{guess(name, allowed)} (allowed: {', '.join(allowed) or 'none'})"
    nearby = sorted(difflib.get_close_matches(name, allowed, n=NEAREST_NAMES, cutoff=0.0), key=allowed.index)
    return f"{guess(name, allowed)} (allowed: {', '.join(nearby)} and {len(allowed) - len(nearby)} more; {listed} shows all)"


def guess(name: str, allowed: Iterable[str]) -> str:
    """The nearest allowed name as a question; empty if none is near.

    A name with another first letter must be nearer: 'super' is not a misspelt 'consumer'.
    """
    for close in difflib.get_close_matches(name, list(allowed), n=NEAREST_NAMES, cutoff=0.5):
        if close[:1].lower() == name[:1].lower() or difflib.SequenceMatcher(None, close, name).ratio() >= 0.7:
            return f"; did you mean {close!r}?"
    return ""
