"""Reading a log's description: TOML to `LogDescription`, every fault in one message that names file, key,
value, unit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from insenv.files.toml import read_toml, validated
from insenv.logs.description import LogDescription


def read_description(path: str | Path) -> LogDescription:
    """The description in a TOML file. Raises InputError: not found, not TOML, unknown, missing or wrong
    keys."""
    return parse_description(read_toml(path), str(path))


def parse_description(data: dict[str, Any], label: str) -> LogDescription:
    """The description in a dict of TOML values; `label` names it in messages."""
    return validated(LogDescription, data, label)
