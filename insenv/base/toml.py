"""TOML files checked by pydantic: how a key is declared, how a file is read, how an error is reported.

Every error is one line that names file, key, value, unit and what is allowed.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict, ValidationError, WithJsonSchema

from insenv.base.errors import InputError, guess, nearest
from insenv.base.keys import SetsRow, unit_of
from insenv.base.resources import toml_values
from insenv.base.units import Conversion, check_unit, converted

# What the bytes or the values of a file are, for the message to someone who gave the wrong file.

ARCHIVE, BINARY, EMPTY, TABLE, UTF16 = "an archive", "a binary file", "empty", "a table of numbers", "text in UTF-16"
NMEA, GPX, KML, OTHER = "sentences of NMEA 0183", "a GPX file", "a KML file", "text"
_ARCHIVES = (b"\x1f\x8b", b"PK\x03\x04", b"\xfd7zXZ\x00", b"BZh", b"7z\xbc\xaf")
_SEPARATORS = re.compile(r"[,;\t]| +")
_SENTENCE = re.compile(r"[$!][A-Z]{5},[^\n]*\*[0-9A-Fa-f]{2}\s")
_HEAD = 2000
"""Characters in which the first element of a markup file begins."""
_LINES = 20
_BYTES = 65536


def content_of(raw: bytes) -> str:
    """What the bytes plainly are, one of the constants above; `OTHER` for text that is none of them."""
    if not raw.strip():
        return EMPTY
    if raw.startswith(_ARCHIVES):
        return ARCHIVE
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return UTF16
    if b"\0" in raw or _share_of_controls(raw) > 0.02:
        return BINARY
    text = raw[:_BYTES].decode("utf-8-sig", errors="replace").lstrip()
    if text.startswith("<"):
        return next((content for tag, content in (("<gpx", GPX), ("<kml", KML)) if tag in text[:_HEAD]), OTHER)
    if _SENTENCE.match(text):
        return NMEA
    return TABLE if _has_row_of_numbers(text) else OTHER


def _share_of_controls(raw: bytes) -> float:
    """Share of the bytes that no text has, in any encoding of 8 bits."""
    part = raw[:_BYTES]
    return sum(byte < 32 and byte not in b"\t\n\r\f\x1b" for byte in part) / len(part)


def _has_row_of_numbers(text: str) -> bool:
    for line in [line.strip() for line in text.splitlines() if line.strip()][:_LINES]:
        fields = [field for field in _SEPARATORS.split(line) if field]
        if len(fields) > 1 and all(map(_is_number, fields)):
            return True
    return False


def _is_number(text: str) -> bool:
    try:
        float(text.strip('"'))
    except ValueError:
        return False
    return True


def is_scenario(data: Mapping[str, Any]) -> bool:
    """Whether the file has a key that a scenario must have and a description of a log may not."""
    return "vehicle" in data or "duration_s" in data


def is_log(data: Mapping[str, Any]) -> bool:
    """Whether the file names a flight log or the file of the inertial samples, as a scenario may not."""
    imu = data.get("imu")
    return "flight" in data or (isinstance(imu, Mapping) and "file" in imu)


if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass as _ModelType
    from typing_extensions import Self

MAX_FAULTS = 20
MAX_PLACES = 2
"""Tables that a message names for a key that is in the wrong one; a key that more of them have tells nothing."""
MAX_SHOWN = 80
"""Largest number of characters of a wrong value in a message, and of allowed names that it lists more than once."""

AnyModel = TypeVar("AnyModel", bound=BaseModel)
if not TYPE_CHECKING:
    _ModelType = type(BaseModel)  # public at run time only


# --- how a key is declared -------------------------------------------------------------------------


def key(default: Any, meaning: str, unit: str = "", *, row: Any = "", convert: Conversion | None = None, **limits: Any) -> Any:
    """A key: its default (... if required), meaning, unit and limits (`gt`, `ge`, `lt`, `le`, `max_length` ...).

    row: the parameter row that it sets (`insenv.base.keys.rows_of`), if it is one: its name, or the row, whose range is then
    that of the key.  convert: to the row's SI unit; None: the conversion of the key's unit.
    Raises `InputError` for a key that sets a row and whose unit is unknown or not that of the row.
    """
    if row and convert is None:
        named = (row, "") if isinstance(row, str) else (row.name, row.unit)
        check_unit(f"the key of row {named[0]!r}, {meaning!r}", unit, *named if named[1] else ())
    convert = convert or converted(unit).convert
    if not isinstance(row, str):
        ends = {"ge": float(convert.back(row.lower)), "le": float(convert.back(row.upper))}
        row, limits = row.name, {name: int(end) if end.is_integer() else end for name, end in ends.items()} | limits
    field = Field(default, description=meaning, json_schema_extra={"unit": unit}, **limits)
    if row:
        field.metadata.append(SetsRow(row, convert))
    return field


def list_of(count: int, what: str) -> BeforeValidator:
    """Validator: a list of so many values of any type, which a message calls "a list of {what}"."""

    def check(value: object) -> object:
        if not isinstance(value, (list, tuple)) or len(value) != count:
            raise ValueError(f"must be a list of {what}")
        return tuple(value)

    return BeforeValidator(check)


def _check_parameter(value: object) -> object:
    items = value if isinstance(value, list) else [value]
    for item in items:
        if isinstance(item, (int, float)) and not abs(item) <= sys.float_info.max:
            raise ValueError("must be finite")
    if not all(isinstance(item, (str, bool, int, float)) for item in items):
        raise ValueError("must be a number, true or false, text, or a list of these")
    return value


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Vector3 = Annotated[tuple[Number, Number, Number], list_of(3, "three")]
Parameter = Annotated[Any, BeforeValidator(_check_parameter)]
"""Value of an estimator's parameter."""


class _Checked(_ModelType):
    """Type of a section: a wrong value in a call of the class is an `InputError`, as one in a file is."""

    def __call__(self, *positional: Any, **values: Any) -> Any:
        if positional:
            raise InputError(f"{self.__name__}({shown(positional[0])}): allowed are keys with their values")
        try:
            return super().__call__(**values)
        except ValidationError as error:
            raise InputError(_faults(error, self, self.__name__)) from None  # type: ignore[arg-type]


class Section(BaseModel, metaclass=_Checked):
    """A table of the TOML file: unknown keys are errors, values are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with the keys in `update` changed.  Raises `InputError` for an unknown key; values are not checked."""
        for name in update or {}:
            if name not in type(self).model_fields:
                raise InputError(f"{name}: unknown key{nearest(name, type(self).model_fields)}")
        return super().model_copy(update=update, deep=deep)

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise `InputError` for a key."""
        if name in type(self).model_fields:
            raise InputError(
                f"{name} = {shown(value)}: keys are read-only; model_copy(update={{{name!r}: ...}}) makes a changed copy"
            )
        super().__setattr__(name, value)


def summary(section: type[Section]) -> str:
    """First line of a section's docstring, without its full stop; without a docstring the name of the class."""
    return (section.__doc__ or section.__name__).strip().partition("\n")[0].rstrip(".")


# --- reading ---------------------------------------------------------------------------------------


def read_toml(path: str | Path, hints: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The values of a TOML file, in UTF-8 with or without a byte order mark.

    hints: end of the message about a file that is something else, by the constants of `insenv.base.toml`; that of `OTHER`
    is for a name that does not end in .toml.
    Raises InputError: not found, not readable, empty, not UTF-8, not TOML.
    """
    path = Path(path)
    try:
        if path.is_dir():
            raise InputError(f"{path}: a folder, not a TOML file{f'; {hints[OTHER]}' if hints and OTHER in hints else ''}")
        raw = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{path}: file not found") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    content = content_of(raw)
    hint = f"; {hints[content]}" if hints and content in hints else ""
    if content == EMPTY:
        raise InputError(f"{path}: the file is empty")
    if content in (ARCHIVE, BINARY, UTF16):
        raise InputError(f"{path}: {content}, not a TOML file in UTF-8{hint}")
    try:
        return toml_values(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a UTF-8 text file (byte {error.start})") from None
    except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
        if content != OTHER or path.suffix.lower() != ".toml":
            raise InputError(f"{path}: {content}, not a TOML file{hint}") from None
        raise InputError(f"{path}: not valid TOML: {_said_by_parser(str(error))}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply") from None


def _said_by_parser(message: str) -> str:
    """What the TOML parser says; a doubled key by its line."""
    line = re.search(r"at line (\d+)", message)
    if line and re.match(r"Cannot (overwrite a value|mutate|declare .* twice)", message):
        return f"line {line[1]} gives a key or table that the file has before: allowed is each once"
    return message


def validated(model: type[AnyModel], data: Any, label: str) -> AnyModel:
    """`data` (TOML values) as `model`; every line of a message begins with `label`, the file. Raises InputError."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(_faults(error, model, label)) from None


def _faults(error: ValidationError, model: type[BaseModel], label: str) -> str:
    """The message on what pydantic found wrong; every line begins with `label`."""
    faults: dict[str, str] = {}
    for fault in error.errors(include_url=False, include_context=True):
        where, message = _fault(dict(fault), model)
        if (alternative := message.partition(": must be ")[2]) and where in faults:  # of a union of types
            faults[where] += f" or {alternative}" if alternative not in faults[where] else ""
        faults.setdefault(where, message)
    listed = list(faults.items())[:MAX_FAULTS]
    more = len(faults) - len(listed)
    lines, listed_names = [], set[str]()
    for where, message in listed:
        begin = f"{label}: {where}"
        said, _, names = message.partition(" (allowed: ")
        if len(names) > MAX_SHOWN and names in listed_names:  # every leg of a list, or several keys of one long table
            message = f"{said} (allowed: as above)"
        listed_names.add(names)
        lines.append(f"{begin}{message}".replace("\n", f"\n{begin}: " if where else f"\n{begin}"))
    return "\n".join(lines + ([f"and {more} more"] if more > 0 else []))


def _fault(fault: dict[str, Any], root: type[BaseModel]) -> tuple[str, str]:
    """(dotted key, message) of one pydantic error."""
    here: Any = root  # type of the value at the key so far
    dotted, unit = "", ""
    parts = list(fault["loc"])
    for number, part in enumerate(parts):
        last, models = number == len(parts) - 1, sections_in(here)
        owner = next((model for model in models if part in model.model_fields), None)
        if isinstance(part, int):
            dotted += f"[{part}]"
        elif len(models) > 1 and (tagged := [model for model in models if part in _tags(model)]):
            here = tagged[0]  # of a union discriminated by `kind`: its name comes before the key, which may be the same
        elif owner is not None:
            field = owner.model_fields[part]
            dotted += f".{part}" if dotted else part
            unit = unit_of(field)
            here = field.annotation
            if last and fault["type"] == "missing":
                return dotted, f" is missing: {field.description}{_unit(unit)}"
        elif last and fault["type"] == "extra_forbidden" and models:
            prefix, allowed = f"{dotted}." if dotted else "", models[0].model_fields
            places = [place for place in dict.fromkeys(_places_of(str(part), root)) if place != dotted]
            if 0 < len(places) <= MAX_PLACES:
                return f"{prefix}{part}", f": unknown key; it belongs {_in(places)} (allowed: {', '.join(allowed)})"
            return f"{prefix}{part}", f": unknown key{nearest(part, allowed)}"
        elif (value := _dict_value(here)) is not None and part != "[key]":
            dotted, here = f"{dotted}.{part}", value
    return _message(fault, dotted, unit, sections_in(here))


def _places_of(name: str, section: type[BaseModel], here: str = "") -> Iterator[str]:
    """The tables, by dotted name, that have a key `name`, in a section and those in it; "" for the top."""
    if name in section.model_fields:
        yield here
    for inner, field in section.model_fields.items():
        for model in sections_in(field.annotation):
            yield from _places_of(name, model, f"{here}.{inner}" if here else inner)


def _in(places: list[str]) -> str:
    return " or ".join(f"in [{place}]" if place else "at the top of the file" for place in places)


def _message(fault: dict[str, Any], dotted: str, unit: str, models: list[type[BaseModel]]) -> tuple[str, str]:
    kind, value, context = fault["type"], fault["input"], fault.get("ctx", {})
    kinds = [tag for model in models for tag in _tags(model)]
    if kind == "union_tag_invalid":
        meant = guess(str(context.get("tag")), kinds)
        return f"{dotted}.kind", f" = {shown(context.get('tag'))}: must be one of {', '.join(map(repr, kinds))}{meant}"
    if kind == "union_tag_not_found":
        return f"{dotted}.kind", f" is missing: must be one of {', '.join(map(repr, kinds))}"
    if kind in _LENGTHS:
        name = dotted.rpartition(".")[2].removesuffix(f"_{unit}")
        noun = name if name.endswith("s") else "entries"
        return dotted, f": {_LENGTHS[kind].format(**context)} {noun}, {context['actual_length']} given"
    other = str(fault["msg"]).removeprefix("Value error, ").replace("Input should be", "must be")  # a validator's own message
    begun = isinstance(value, str) and other.startswith(f"{value}: ")  # a message about the file at this path
    stated = "" if begun or value is None or isinstance(value, (dict, BaseModel)) else f" = {shown(value)}{_unit(unit)}"
    limits = {name: plain(limit) if isinstance(limit, (int, float)) else limit for name, limit in context.items()}
    allowed = _MESSAGES[kind].format(**limits) if kind in _MESSAGES else other
    said = f"{stated}: {allowed}"
    return dotted, said if dotted else said.removeprefix(" = ").removeprefix(": ")  # of the whole, the label says what it is


_LENGTHS = {"too_long": "at most {max_length}", "too_short": "at least {min_length}"}
_TYPES = {
    "must be a number": ("float_type", "float_parsing"),
    "must be a finite number": ("finite_number",),
    "must be a whole number": ("int_type", "int_parsing", "int_from_float", "int_parsing_size"),
    "must be true or false": ("bool_type", "bool_parsing"),
    "must be text": ("string_type",),
    "must be a list": ("tuple_type", "list_type"),
    "must be a table of keys": ("dict_type", "model_type", "model_attributes_type"),
}
_MESSAGES = {kind: message for message, kinds in _TYPES.items() for kind in kinds} | {
    "greater_than": "must be greater than {gt}",
    "greater_than_equal": "must be greater than or equal to {ge}",
    "less_than": "must be less than {lt}",
    "less_than_equal": "must be less than or equal to {le}",
    "literal_error": "must be {expected}",
    "string_too_short": "must have {min_length} or more characters",
    "string_too_long": "must have {max_length} or fewer characters",
}
"""What is allowed, by pydantic's type of error; in braces the context that pydantic gives."""


def shown(value: object) -> str:
    """A wrong value as printed in a message."""
    try:
        text = repr(value)
    except ValueError:  # Python does not print whole numbers of thousands of digits
        return "(a number of thousands of digits)"
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


def plain(number: float) -> str:
    """A number with the digits that tell it from its neighbours, whole numbers without a point."""
    return repr(number).removesuffix(".0")


def _unit(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def sections_in(annotation: Any) -> list[type[BaseModel]]:
    """The sections in a key's type: in unions, tuples and lists, but not in tables of free keys."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) is dict:
        return []
    return [section for inner in get_args(annotation) for section in sections_in(inner)]


def _tags(model: type[BaseModel]) -> tuple[Any, ...]:
    """Values of the literal `kind` that discriminates a section from its siblings."""
    return get_args(model.model_fields["kind"].annotation) if "kind" in model.model_fields else ()


def _dict_value(annotation: Any) -> Any:
    """Type of the values of a table of free keys; None if it is not such a table."""
    if get_origin(annotation) is dict:
        return get_args(annotation)[1]
    values = (_dict_value(inner) for inner in get_args(annotation) if get_origin(annotation) is not Literal)
    return next((value for value in values if value is not None), None)


# Types of values in a scenario file, in addition to those of `insenv.base.toml`.


def _check_axes(value: object) -> object:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number and not (isinstance(value, (list, tuple)) and len(value) == 3):
        raise ValueError("must be a number, or a list of three, one for each axis")
    return (value,) * 3 if number else tuple(value)  # type: ignore[arg-type]


_check_axes.takes = "number or 3"  # type: ignore[attr-defined]  # for the table of keys


PerAxis = Annotated[
    tuple[Number, Number, Number],
    BeforeValidator(_check_axes),
    WithJsonSchema(
        {"anyOf": [{"type": "number"}, {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}]}
    ),
]
"""One number for all three axes, or one for each."""


def within(lower: float, upper: float, above: bool = False) -> AfterValidator:
    """Validator: each number is from `lower` (`above`: excluded) to `upper`."""
    limits = f"{'above' if above else 'from'} {plain(lower)} to {plain(upper)}"

    def check(value: tuple[float, ...]) -> tuple[float, ...]:
        if any(not lower <= number <= upper or (above and number == lower) for number in value):
            raise ValueError(f"each must be {limits}")
        return value

    check.limits = limits  # type: ignore[attr-defined]  # for the table of keys
    return AfterValidator(check)


Rotation = Annotated[Vector3, within(-180.0, 180.0)]
LeverArm = Annotated[Vector3, within(-1e3, 1e3)]
NotNegative = Annotated[PerAxis, within(0.0, 1e5)]
Sigmas = Annotated[PerAxis, within(0.0, 1e5, above=True)]

Window = Annotated[tuple[Number, Number], list_of(2, "two, begin and end")]


def one_of(names: Iterable[str]) -> WithJsonSchema:
    """Annotation: in the JSON schema, the value is one of `names`.  It does not check the value."""
    return WithJsonSchema({"type": "string", "enum": list(names)})
