"""The kinds of values that a log description holds, and how a key of it is written."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from insenv.files.toml import Number, Parameter, Positive, Section, Vector3, check_three, key

__all__ = [
    "AngleUnit",
    "Column",
    "Columns3",
    "Files",
    "Number",
    "Parameter",
    "Positive",
    "Section",
    "Sigma3",
    "Vector3",
    "key",
    "with_format",
]


def _check_column(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, (str, int)) or (isinstance(value, int) and value < 0):
        raise ValueError("must be a column name in quotes or a column number, counted from 0")
    return value


def _as_tuple(value: object) -> object:
    files = [value] if isinstance(value, str) else value
    if not isinstance(files, (list, tuple)) or not files or not all(isinstance(f, str) and f for f in files):
        raise ValueError("must be a path or a list of paths, in quotes")
    return tuple(files)


Column = Annotated[str | int, BeforeValidator(_check_column)]
Columns3 = Annotated[tuple[Column, Column, Column], BeforeValidator(check_three)]
Sigma3 = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(check_three)]
Files = Annotated[tuple[str, ...], BeforeValidator(_as_tuple)]
AngleUnit = Literal["deg", "rad"]


def with_format(data: Any, fixed: dict[str, Any], unless: tuple[str, ...] = ()) -> Any:
    """kf-gins files: the format sets the columns; a key given in the file wins."""
    if not isinstance(data, dict) or data.get("format") != "kf-gins":
        return data
    drop = unless[0] if any(name in data for name in unless) and unless[0] not in data else None
    return {**{k: v for k, v in fixed.items() if k != drop}, **data}
