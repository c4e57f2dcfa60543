"""Sentences that comment on a result: each is one entry of a code, a rule and a text.

The rule is a function that returns the values of the names in braces, or None where there is nothing to say; `remark` makes of
it a function that returns the sentences.  The code is stable, so that programs need not read the text.

A text is filled in by `filled`.  Texts are data, and rules give numbers (`insenv.web.judging` lists those of a live page), so
that a page says what a run says without a sentence of its own.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from typing import Any, ParamSpec

Arguments = ParamSpec("Arguments")
Values = Mapping[str, Any]
TEXTS: dict[str, str] = {}
"""Text of every remark of the package that has been imported, by code."""
_NAMED = re.compile(r"\{(\w+)(?::([^{}|]*))?\}")
_CHOICE = re.compile(r"\{(\w+)\|((?:[^{}]|\{\w+(?::[^{}|]*)?\})*)\}")
"""One in which no other choice stands."""
_DIGITS = " digits"


LATE_S = 1e6
"""Times from which on a log counts from a date, such as Unix time: s."""


def clock(time_s: float, digits: int = 6) -> str:
    """A time of a log in a sentence: with so many significant digits, or from `LATE_S` on in full, to the millisecond."""
    if abs(time_s) < LATE_S:
        return f"{time_s:.{digits}g}"
    return f"{time_s:.3f}".rstrip("0").rstrip(".")


def figure(value: float, digits: int = 3) -> str:
    """So many significant digits, and no exponent of a large value."""
    return f"{value:.{digits}g}" if value < 10**digits - 0.5 else f"{value:.0f}"


def filled(text: str, values: Values) -> str:
    """The text with values for the names in braces; other braces stay.

    Behind a name may be a format of Python, or "{name:3 digits}" (`figure`).  "{name|A|B}" is A if the value is 0, B if it is
    1.  web/words.js does the same.
    """
    before = ""
    while before != text:
        before, text = text, _CHOICE.sub(lambda it: it[2].split("|")[int(values[it[1]])] if it[1] in values else it[0], text)
    return _NAMED.sub(lambda it: _formatted(it, values) if it[1] in values else it[0], text)


def _formatted(place: re.Match[str], values: Values) -> str:
    named = place[2] or ""
    if named.endswith(_DIGITS):
        return figure(values[place[1]], int(named.removesuffix(_DIGITS)))
    return place[0].format(**values)


def worded(texts: Mapping[str, str], values: Values) -> dict[str, Any]:
    """The values, and by name these texts filled in, each with the values and the texts before it."""
    made = dict(values)
    for name, text in texts.items():
        made[name] = filled(text, made)
    return made


class Remark(str):
    """A sentence with its code."""

    code: str

    def __new__(cls, code: str, text: str) -> Remark:
        made = super().__new__(cls, text)
        made.code = code
        return made

    def __reduce__(self) -> tuple[type[Remark], tuple[str, str]]:
        return type(self), (self.code, str(self))

    def of(self, who: str) -> Remark:
        """With the name of what it is about before it."""
        return type(self)(self.code, f"{who}: {self}")

    def filled(self, **values: Any) -> Remark:
        """With values for the names in braces (`filled`)."""
        return type(self)(self.code, filled(self, values))


class Caveat(Remark):
    """A remark on stated standard deviations, with which an estimate counts as aligned all the same."""


class Doubt(Remark):
    """A remark that speaks against the stated standard deviations: an estimate with one is not called consistent."""


def declared(code: str, text: str, kind: type[Remark] = Remark) -> Remark:
    """A remark without a rule of its own.  Raises `ValueError` for a code that has another text."""
    if TEXTS.setdefault(code, text) != text:
        raise ValueError(f"remark {code!r} is declared twice")
    return kind(code, text)


def remark(
    code: str, text: str, kind: type[Remark] = Remark
) -> Callable[[Callable[Arguments, Values | None]], Callable[Arguments, tuple[Remark, ...]]]:
    """Make of a rule the function that returns its sentence, or no sentence."""
    entry = declared(code, text, kind)

    def of_rule(rule: Callable[Arguments, Values | None]) -> Callable[Arguments, tuple[Remark, ...]]:
        @wraps(rule)
        def said(*args: Arguments.args, **kwargs: Arguments.kwargs) -> tuple[Remark, ...]:
            values = rule(*args, **kwargs)
            return () if values is None else (entry.filled(**values),)

        return said

    return of_rule


def coded(sentences: Iterable[str], code: str) -> tuple[Remark, ...]:
    """Sentences of code outside the package as remarks: those without a code get this one."""
    return tuple(each if isinstance(each, Remark) else Remark(code, each) for each in sentences)


def as_json(remarks: Iterable[Remark], key: str = "notes") -> dict[str, Any]:
    """The documented JSON form: the sentences by `key`, and the same with their codes."""
    said = list(remarks)
    return {key: list(said), "remarks": [{"code": each.code, "text": str(each)} for each in said]}
