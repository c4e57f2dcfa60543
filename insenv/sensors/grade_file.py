"""Grades of inertial units in files of one's own: ``grade = "my-unit.toml"`` stands wherever a name of the catalogue does.

A scenario holds the figures themselves from then on, not the path: a run that is repeated elsewhere, or continued after the
file has changed, has the unit that it began with.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import BeforeValidator, WithJsonSchema, create_model, model_validator

from insenv.base.errors import InputError
from insenv.base.toml import Number, Section, is_log, is_scenario, key, read_toml, validated
from insenv.sensors.catalogue import IMU_GRADES, imu_grade
from insenv.sensors.grades import FIGURES, WAYS, WHITE, ImuGrade
from insenv.sensors.imu_tables import IMU_PARAMETERS

SUFFIX = ".toml"


class _GradeTable(Section):
    """The grade of an inertial unit in a file: figures as in a data sheet; one that is missing means: no such error."""

    name: str = key("", "name; that of the file, if absent", max_length=200)
    title: str = key(..., "one line for lists", min_length=1, max_length=120)
    sources: dict[str, str] = key({}, 'source of each figure by its key; "" of all others')
    white_rate_hz: Number = key(200.0, "sample rate of white noise that is given per sample", "Hz", gt=0, le=1e5)

    @model_validator(mode="after")
    def _one_way(self) -> _GradeTable:
        for group in WAYS:
            ways = [name for name in group if getattr(self, name) is not None]
            if len(ways) > 1:
                raise ValueError(f"{' and '.join(ways)} describe the same noise: allowed is one of them")
        return self

    def grade(self) -> ImuGrade:
        """The grade."""
        stated = {name: getattr(self, name) for name in FIGURES if getattr(self, name) is not None}
        return ImuGrade(self.name, self.title, self.sources, white_rate_hz=self.white_rate_hz, **stated)


if TYPE_CHECKING:
    GradeTable = _GradeTable
else:
    GradeTable = create_model(
        "GradeTable",
        __base__=_GradeTable,
        __doc__=_GradeTable.__doc__,
        **{name: figure.key(IMU_PARAMETERS, "0") for name, figure in FIGURES.items()},
    )


def is_grade(data: Mapping[str, Any]) -> bool:
    """Whether the values of a TOML file are those of a grade file: a figure at the top, and nothing of a log or a scenario."""
    return bool(set(data) & set(FIGURES)) and not is_log(data) and not is_scenario(data)


def refuse_grade(data: Mapping[str, Any], path: Path, wanted: str) -> None:
    """Raise `InputError` if the values in the file at `path` are those of a grade file, where a `wanted` is."""
    if is_grade(data):
        raise InputError(
            f'{path}: the grade of an inertial unit, not {wanted}: `grade = "{path.name}"` in [imu] of a scenario or a log '
            "uses it"
        )


def read_grade(path: str | Path) -> GradeTable:
    """The grade file at `path`.  Raises `InputError` for a missing file, a wrong key or value."""
    data = read_toml(path)
    if is_log(data) or is_scenario(data):
        kind = "a scenario" if is_scenario(data) else "the description of a recorded log"
        raise InputError(
            f"{path}: {kind}, not the grade of an inertial unit: `insenv allan` writes one of a log (docs/allan.md)"
        )
    table = validated(GradeTable, data, str(path))
    return table if table.name else table.model_copy(update={"name": Path(path).stem})


def _value(value: Any) -> Any:
    """A grade: the name of one of the catalogue, the path of a file, which is read, or the values of such a file."""
    if isinstance(value, str) and value.endswith(SUFFIX):
        return read_grade(value)
    if isinstance(value, str):
        imu_grade(value)
        return value
    if isinstance(value, Mapping):
        return validated(GradeTable, value, "the table of a grade")
    if not isinstance(value, GradeTable):
        raise ValueError("must be the name of a grade, the path of a grade file, or a table of figures")
    return value


GradeValue = Annotated[
    str | GradeTable,
    BeforeValidator(_value),
    WithJsonSchema({"anyOf": [{"type": "string", "enum": list(IMU_GRADES)}, {"type": "string", "pattern": r"\.toml$"}]}),
]


def grade_of(grade: str | GradeTable) -> ImuGrade:
    """The grade of that name, of the file at that path, or of that table.  Raises `InputError`."""
    if isinstance(grade, str):
        return read_grade(grade).grade() if grade.endswith(SUFFIX) else imu_grade(grade)
    return grade.grade()


def beside(values: dict[str, Any], folder: Path, *section: str, key: str = "grade") -> dict[str, Any]:
    """The values of a TOML file with the path at a key of `section` beginning at its folder; the name of a grade is none."""
    inner: Any = values
    for name in section:
        inner = inner.get(name) if isinstance(inner, Mapping) else None
    path = inner.get(key) if isinstance(inner, Mapping) else None
    if not isinstance(path, str) or (key == "grade" and not path.endswith(SUFFIX)) or Path(path).is_absolute():
        return values
    changed: dict[str, Any] = {**inner, key: str(folder / path)}
    for name in reversed(section):
        changed = {name: changed}
    return {**values, **changed}


def in_folder(folder: Path) -> tuple[dict[str, ImuGrade], tuple[str, ...]]:
    """The grades in the grade files of a folder, by file name, and what is wrong in others of them."""
    grades, faults = {}, []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            if not is_grade(read_toml(path)):
                continue
        except InputError:
            continue
        try:
            grades[path.name] = read_grade(path).grade()
        except InputError as error:
            faults.append(str(error))
    return grades, tuple(faults)


def toml_text(grade: ImuGrade, remarks: Mapping[str, str] | None = None) -> str:
    """The text of the grade file of a grade.  remarks: comments by figure, those of "" at the top, one a line."""
    remarks = remarks or {}
    lines = [f"# {line}" for line in remarks.get("", "").splitlines()]
    lines += [f"title = {_text(grade.title)}", ""]
    for figure, value in grade.figures().items():
        comment = f"    # {remarks[figure]}" if figure in remarks else ""
        if figure == "white_rate_hz" and not any(getattr(grade, name) for name in WHITE):
            continue
        texts = [f"{number:.6g}" for number in np.atleast_1d(value)]
        texts = [text if any(c in text for c in ".en") else f"{text}.0" for text in texts]
        lines.append(f"{figure} = {texts[0] if len(texts) == 1 else '[' + ', '.join(texts) + ']'}{comment}")
    if grade.sources:
        lines += ["", "[sources]", *(f"{_text(name)} = {_text(text)}" for name, text in grade.sources.items())]
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    """A basic string of TOML."""
    escaped = value.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
