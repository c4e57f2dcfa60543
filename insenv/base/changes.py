"""Keys of a file changed by their dotted names, such as ``imu.grade``: for single runs, without another file."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

from insenv.base.errors import InputError
from insenv.base.remarks import remark
from insenv.base.resources import toml_values

Changes = Mapping[str, Any]
"""New values by dotted key; a number names an element of a list, from 0."""


def parsed(texts: Iterable[str]) -> dict[str, Any]:
    """Changes from texts ``KEY=VALUE``; a value is a number, true, false, a list or table as in JSON or TOML, or text.

    Raises one `InputError` for all texts of another form and keys that are given twice.
    """
    changes: dict[str, Any] = {}
    faults: list[str] = []
    for text in texts:
        name, equals, value = text.partition("=")
        key = name.strip()
        if not (equals and value.strip() and all(key.split("."))):
            faults.append(
                f"--set {text!r}: allowed is KEY=VALUE, such as imu.grade=tactical or loosely-coupled.arw_deg_sqrt_h=0.3"
            )
        elif key in changes:
            faults.append(f"--set {text!r}: {key} is given twice")
        else:
            changes[key] = _value(value.strip())
    if faults:
        raise InputError("\n".join(faults))
    return changes


def _value(text: str) -> Any:
    """The value that a text is in JSON, or a list or table in TOML; else the text."""
    with suppress(ValueError):
        return json.loads(text)
    if text.startswith(("[", "{")):
        with suppress(ValueError):
            return toml_values(f"value = {text}")["value"]
    return text


def changed(data: Mapping[str, Any], changes: Changes) -> dict[str, Any]:
    """A copy of the values of a file with the changes in it; a table that the file does not have is made.

    Raises `InputError` for a key inside a value that is no table, and for an element that a list does not have.
    """
    copied = copy.deepcopy(dict(data))
    for key, value in changes.items():
        *path, last = key.split(".")
        owner: Any = copied
        for done, part in enumerate(path):
            place = _place(owner, part, path[:done], key)
            if isinstance(owner, dict) and owner.get(place) is None:
                owner[place] = {}
            owner = owner[place]
        owner[_place(owner, last, path, key)] = copy.deepcopy(value)
    return copied


@remark("keys-changed", "changed by --set: {listed}")
def sentence(changes: Changes) -> dict[str, Any] | None:
    """What the changes are, for a reader of the results."""
    listed = ", ".join(f"{key} = {json.dumps(value, default=str)}" for key, value in changes.items())
    return {"listed": listed} if changes else None


def _place(owner: Any, part: str, path: list[str], key: str) -> Any:
    """The place of `part` in its owner, a table or a list."""
    if isinstance(owner, dict):
        return part
    where = ".".join(path)
    if not isinstance(owner, (list, tuple)):
        raise InputError(f"--set {key}: {where} = {owner!r} is a value, not a table of keys")
    if not (part.isdigit() and int(part) < len(owner)):
        raise InputError(f"--set {key}: {where} is a list of {len(owner)}: allowed is an element from 0 to {len(owner) - 1}")
    return int(part)
