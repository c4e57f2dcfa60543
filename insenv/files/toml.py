"""TOML files with a pydantic model: how a key is declared, read, its faults told, its table printed.

Every fault is one line that names file, key, value, unit and what is allowed. Used for scenarios and for the
descriptions of recorded logs.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, ValidationError
from pydantic_core import PydanticUndefined

from insenv.errors import InputError, nearest

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

MAX_FAULTS = 5
MAX_SHOWN = 80
"""Most characters of a wrong value in a message."""

AnyModel = TypeVar("AnyModel", bound=BaseModel)


# --- how a key is declared -------------------------------------------------------------------------


def key(default: Any, meaning: str, unit: str = "", **limits: Any) -> Any:
    """A key: its default (... when it must be given), meaning, unit and limits."""
    return Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)


def check_three(value: object) -> object:
    """Validator: a list of three, whatever they are."""
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise ValueError("must be a list of three")
    return tuple(value)


def _check_parameter(value: object) -> object:
    items = value if isinstance(value, list) else [value]
    for item in items:
        if isinstance(item, (int, float)) and not abs(item) <= sys.float_info.max:
            raise ValueError("must be finite")
    if not all(isinstance(item, (str, bool, int, float)) for item in items):
        raise ValueError("must be a number, true or false, text, or a list of numbers")
    return value


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Vector3 = Annotated[tuple[Number, Number, Number], BeforeValidator(check_three)]
Parameter = Annotated[Any, BeforeValidator(_check_parameter)]
"""Value of an estimator's parameter."""


class Section(BaseModel):
    """A table of the TOML file: unknown keys are refused, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


# --- reading ---------------------------------------------------------------------------------------


def read_toml(path: str | Path) -> dict[str, Any]:
    """The values of a TOML file. Raises InputError: not found, not readable, not UTF-8, not TOML."""
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: file not found") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a UTF-8 text file (byte {error.start})") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply") from None


def validated(model: type[AnyModel], data: Any, label: str) -> AnyModel:
    """`data` (TOML values) as `model`; `label`, the file, begins every line of the message. Raises InputError."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        faults: dict[str, str] = {}
        for fault in error.errors(include_url=False, include_context=True):
            where, message = _fault(dict(fault), model)
            faults.setdefault(where, message)
        shown = [f"{label}: {where}{message}" for where, message in list(faults.items())[:MAX_FAULTS]]
        more = len(faults) - len(shown)
        raise InputError("\n".join(shown + ([f"and {more} more"] if more > 0 else []))) from None


def _fault(fault: dict[str, Any], root: type[BaseModel]) -> tuple[str, str]:
    """(dotted key, message) of one pydantic error."""
    here: Any = root  # the type of what the key so far names
    dotted, unit = "", ""
    parts = list(fault["loc"])
    for number, part in enumerate(parts):
        last, models = number == len(parts) - 1, _sections(here)
        owner = next((model for model in models if part in model.model_fields), None)
        if isinstance(part, int):
            dotted += f"[{part}]"
        elif owner is not None:
            field = owner.model_fields[part]
            dotted += f".{part}" if dotted else part
            extra = field.json_schema_extra
            unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
            here = field.annotation
            if last and fault["type"] == "missing":
                return dotted, f" is missing: {field.description}{_unit(unit)}"
        elif len(models) > 1 and (tagged := [model for model in models if part in _tags(model)]):
            here = tagged[0]  # of a union told apart by its `kind`
        elif last and fault["type"] == "extra_forbidden" and models:
            prefix = f"{dotted}." if dotted else ""
            return f"{prefix}{part}", f": unknown key{nearest(part, models[0].model_fields)}"
        elif (value := _dict_value(here)) is not None and part != "[key]":
            dotted, here = f"{dotted}.{part}", value
    return _message(fault, dotted, unit, _sections(here))


def _message(fault: dict[str, Any], dotted: str, unit: str, models: list[type[BaseModel]]) -> tuple[str, str]:
    value, context = fault["input"], fault.get("ctx", {})
    if fault["type"] == "union_tag_invalid":
        return f"{dotted}.kind", f" = {shown(context.get('tag'))}: must be one of {context.get('expected_tags')}"
    if fault["type"] == "union_tag_not_found":
        kinds = ", ".join(repr(tag) for model in models for tag in _tags(model))
        return f"{dotted}.kind", f" is missing: must be one of {kinds}"
    message = str(fault["msg"]).removeprefix("Value error, ")
    message = message.replace("Input should be", "must be").replace("a valid tuple", "a list")
    if fault["type"] in ("dict_type", "model_type", "model_attributes_type"):
        message = "must be a table of keys"
    if isinstance(value, (dict, BaseModel)):
        return dotted or "the file", f": {message}"
    return dotted or "the file", f" = {shown(value)}{_unit(unit)}: {message}"


def shown(value: object) -> str:
    """A wrong value as printed in a message."""
    try:
        text = repr(value)
    except ValueError:  # Python does not print whole numbers of thousands of digits
        return "(a number of thousands of digits)"
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


def _unit(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _sections(annotation: Any) -> list[type[BaseModel]]:
    """The sections that a key may hold, through unions, tuples and lists, but not through tables of free keys."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) is dict:
        return []
    return [found for inner in get_args(annotation) for found in _sections(inner)]


def _tags(model: type[BaseModel]) -> tuple[Any, ...]:
    """Values of the literal `kind` by which a section is told from its siblings."""
    return get_args(model.model_fields["kind"].annotation) if "kind" in model.model_fields else ()


def _dict_value(annotation: Any) -> Any:
    """Type of the values of a table of free keys; None if it is no such table."""
    if get_origin(annotation) is dict:
        return get_args(annotation)[1]
    found = (_dict_value(inner) for inner in get_args(annotation) if get_origin(annotation) is not Literal)
    return next((value for value in found if value is not None), None)


# --- the table of keys in a page -------------------------------------------------------------------

Sections = list[tuple[str, str, type[BaseModel], list[str]]]
"""Title, remark (or empty), section, and names of its keys to print."""


def key_table(sections: Sections, special: dict[str, str] | None = None, limits: bool = False) -> str:
    """Markdown: for each section its keys, values, units, defaults and meanings.

    special: what to print for the type of a key, by its name, where its annotation does not tell.
    limits: whether there is a column of what is allowed.
    """
    parts: list[str] = []
    for title, remark, model, names in sections:
        parts.append(f"### {title}\n")
        parts += [f"{remark}\n"] if remark else []
        head = ["key", "value", "unit", *(["allowed"] if limits else []), "default", "meaning"]
        parts.append(_line(head) + "\n|" + "---|" * len(head))
        for name in names:
            cells = _cells(name, model.model_fields[name], special or {})
            parts.append(_line([cell for cell, title in zip(cells, _HEAD, strict=True) if title in head]))
        parts.append("")
    return "\n".join(parts).rstrip() + "\n"


def renewed(text: str, begin: str, end: str, table: str) -> str:
    """The page `text` with what stands between the lines `begin` and `end` replaced."""
    head, _, rest = text.partition(begin)
    _, _, tail = rest.partition(end)
    return f"{head}{begin}\n\n{table}\n{end}{tail}"


def renew_page(path: str | Path, renew: Callable[[str], str]) -> None:
    """Bring a page up to date."""
    page = Path(path)
    page.write_text(renew(page.read_text(encoding="utf-8")), encoding="utf-8")


_HEAD = ("key", "value", "unit", "allowed", "default", "meaning")


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _cells(name: str, field: Any, special: dict[str, str]) -> list[str]:
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    default = field.default
    if default is PydanticUndefined:
        text = "must be given"
    elif default is None or default == () or default == {} or default == "" or isinstance(default, BaseModel):
        text = "-"
    else:
        text = f"`{default}`"
    value = special.get(name) or _type(field.annotation)
    allowed = _limits(field.metadata, field.annotation)
    return [f"`{name}`", value, str(extra.get("unit", "")) or "-", allowed or "-", text, str(field.description)]


_SIGNS = {"gt": "above {:.16g}", "ge": "from {:.16g}", "lt": "below {:.16g}", "le": "to {:.16g}"}


def _limits(metadata: Any, annotation: Any = None) -> str:
    """What the limits of a key allow: those of `key` and of validators whose function has the attribute `limits`."""
    parts = [
        text.format(float(getattr(item, name))) for name, text in _SIGNS.items() for item in metadata if hasattr(item, name)
    ]
    parts += [item.func.limits for item in metadata if hasattr(getattr(item, "func", None), "limits")]
    inner = [_limits(getattr(part, "__metadata__", ()), part) for part in get_args(annotation)]
    return " ".join(parts) or next((text for text in inner if text), "")


def _type(annotation: Any) -> str:
    """A reader's name for the type of a key."""
    origin = get_origin(annotation)
    if origin is Literal:
        return ", ".join(f"`{v}`" for v in get_args(annotation))
    inner = [a for a in get_args(annotation) if a is not type(None)]
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "section"
    if origin is dict:
        return "table"
    if origin is tuple and Ellipsis not in inner:
        return "3 columns" if "str | int" in str(inner[0]) else f"{len(inner)} numbers"
    if origin is tuple:
        return "sections" if _sections(inner[0]) else f"list of {_type(inner[0])}"
    if inner and hasattr(annotation, "__metadata__"):
        return _type(inner[0])
    if set(inner) == {str, int}:
        return "column"
    if origin is Union and len(inner) > 1 and _sections(annotation):
        return "section"
    if inner:
        return _type(inner[0])
    return {float: "number", int: "whole number", bool: "true, false", str: "text"}.get(annotation, "value")
