"""Docstrings of insenv as reStructuredText, for the reference pages of the site.

A docstring names its parameters as ``name: text`` or ``one, two: text``, either below ``Parameters`` or in a paragraph that
begins so; several may share a line.  They become a definition list.  A single pair of backticks marks code, and becomes a
link if it is a public name.  Nothing else is markup: an asterisk is an asterisk.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import insenv

ITEM = re.compile(r"(?:^|\n *|(?<=[.)])  ?)(?P<names>\*?\w+(?:, \*?\w+)*): ")
HEADING = re.compile(r"Parameters\n-+\n")
LITERAL = re.compile(r"(``.+?``|(?<![`\w])`[^`\n]+`(?!`))", re.DOTALL)
LINKED = frozenset(name for name in insenv.__all__ if not inspect.ismodule(getattr(insenv, name)))
"""Public names that have an entry in the reference."""


def parameter_names(thing: Any) -> set[str]:
    """The names that a docstring may explain: parameters, or fields of a class."""
    names = set(getattr(thing, "__annotations__", ()))
    for base in getattr(thing, "__mro__", ()):
        names |= {*getattr(base, "__annotations__", ()), *(name for name in vars(base) if not name.startswith("_"))}
    with suppress(TypeError, ValueError):  # a module or a property has no signature
        names |= set(inspect.signature(thing).parameters)
    return names


def as_rst(lines: Iterable[str], names: set[str]) -> list[str]:
    """The lines of a docstring (dedented) as reStructuredText; `names`: see `parameter_names`."""
    found: list[str] = []
    for block in re.split(r"\n\s*\n", "\n".join(lines).strip("\n")):
        heading = HEADING.match(block)
        if heading:
            items = _items(block[heading.end() :], None)
            found += [".. rubric:: Parameters", "", *_definitions(items)]
        elif block.startswith("    "):
            found += [".. code-block:: python", "", *block.split("\n"), ""]
        elif (items := _items(block, names)) and block.startswith(items[0][0] + ": "):
            found += _definitions(items)
        else:
            found += [*_inline(block).split("\n"), ""]
    return found


def _items(block: str, names: set[str] | None) -> list[tuple[str, str]]:
    """(names, text) of each item; `names` None: every item that begins a line counts."""

    def counts(match: re.Match[str]) -> bool:
        if names is None:
            return match.start() == 0 or (match[0].startswith("\n") and not match[0].startswith("\n "))
        return all(name.lstrip("*") in names for name in match["names"].split(", "))

    starts = [match for match in ITEM.finditer(block) if counts(match)]
    ends = [*(match.start() for match in starts[1:]), len(block)]
    return [(match["names"], block[match.end() : end]) for match, end in zip(starts, ends, strict=False)]


def _definitions(items: Iterable[tuple[str, str]]) -> list[str]:
    lines = []
    for names, text in items:
        words = _inline(" ".join(text.split()))
        lines += [", ".join(f"``{name}``" for name in names.split(", ")), f"    {words}", ""]
    return lines


def _inline(text: str) -> str:
    """`text` with links, literals and escapes."""
    return "".join(_literal(part) if k % 2 else _escaped(part) for k, part in enumerate(LITERAL.split(text)))


def _literal(part: str) -> str:
    if part.startswith("``"):
        return part
    name = part.strip("`")
    public = name.removeprefix("insenv.").partition("(")[0]
    return f":py:obj:`~insenv.{public}`" if public in LINKED else f"``{name}``"


def _escaped(part: str) -> str:
    return re.sub(r"(?<=\w)_(?!\w)", r"\\_", part.replace("*", r"\*").replace("|", r"\|"))
