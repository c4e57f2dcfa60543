"""Figures of an aiding instrument: grades in data-sheet units with their sources, and the keys of a section that replace
them.

The names of the figures are the keys; each shows its unit (``noise_m``).  A figure that a grade omits is the start value of
its parameter row, which means "no such error".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import create_model, field_validator

from insenv.base.errors import LISTED, InputError, nearest
from insenv.base.keys import rows_of
from insenv.base.toml import Number, PerAxis, Section, Window, key, one_of, within
from insenv.base.units import Conversion, check_unit
from insenv.core.tables import Table
from insenv.sensors.contract import SensorSection
from insenv.sensors.sampled import OUTAGES, check_times
from insenv.sensors.units import UNITS, Unit

Named = TypeVar("Named")


@dataclass(frozen=True)
class Figure:
    """One figure, which a key states: the parameter row that it sets, and its unit (`insenv.base.units`), which becomes that of
    the row.

    vector: of three, one for each axis.  convert: to SI; None: that of the unit.  meaning: None: that of the row.
    Raises `InputError` for an unknown unit.
    """

    row: str
    unit: str = ""
    convert: Conversion | None = None
    vector: bool = False
    meaning: str | None = None

    def __post_init__(self) -> None:
        if self.convert is None:
            check_unit(f"the figure of row {self.row!r}", self.unit)

    @property
    def _unit(self) -> Unit:
        return UNITS.get(self.unit) or Unit(self.unit)

    def to_si(self, value: Any) -> Any:
        """The value of the row for a value in the unit."""
        return (self.convert or self._unit.convert)(np.asarray(value))

    def key(self, parameters: Table, otherwise: str) -> tuple[Any, Any]:
        """Type and field of the key, whose meaning and limits are those of the row.  otherwise: what holds if it is absent."""
        row, convert = parameters[self.row], self.convert or self._unit.convert
        text = f"{self.meaning or row.meaning}{' (N, E, D)' if row.frame == 'n' else ''}"
        most = min(self._unit.largest, float(convert.back(row.upper)))
        least = 0.0 if row.lower >= 0.0 else -most
        kind: Any = Number
        limits: dict[str, float] = {"gt": 0.0, "le": most} if row.lower > 0.0 else {"ge": least, "le": most}
        if self.vector:
            kind, limits = Annotated[PerAxis, within(least, most)], {}
        meaning = f"{text[0].lower()}{text[1:]}; {otherwise} if absent"
        return kind | None, key(None, meaning, self.unit, row=self.row, convert=convert, **limits)


def with_sources(source: str, figures: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """The values and the sources by name of figures, each a value, or a value with the source of its own: ``(0.1, "its data
    sheet")``.  source: of all others.
    """
    sourced = {name: value for name, value in figures.items() if isinstance(value, tuple) and isinstance(value[-1], str)}
    sources = {"": source} if source else {}
    sources |= {name: source for name, (_, source) in sourced.items()}
    return {**figures, **{name: value for name, (value, _) in sourced.items()}}, sources


@dataclass(frozen=True)
class Grade:
    """A grade of an instrument: figures by name, in data-sheet units, and their sources by name ("": of all others)."""

    name: str
    title: str
    sources: Mapping[str, str] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, name: str, title: str, source: str = "", **figures: Any) -> Grade:
        """A grade from figures, each with the source of its own if it has one; source: of all others (`with_sources`)."""
        values, sources = with_sources(source, figures)
        return cls(name, title, sources, values)

    def source(self, figure: str) -> str:
        """The source of a figure."""
        return self.sources.get(figure, self.sources.get("", ""))


def find_grade(name: str, grades: Mapping[str, Named], what: str) -> Named:
    """The grade of that name.  Raises `InputError` with the nearest name."""
    if name not in grades:
        raise InputError(f"{what} {name!r}: unknown{nearest(name, grades, LISTED)}")
    return grades[name]


def by_name(*grades: Grade) -> dict[str, Grade]:
    """Grades by name."""
    return {grade.name: grade for grade in grades}


class FiguresSection(Section):
    """Keys of a section of a scenario or of a log description that state the errors of an instrument."""

    grades: ClassVar[Mapping[str, Grade]]
    figures: ClassVar[Mapping[str, Figure]]
    grade: str

    @field_validator("grade", check_fields=False)
    @classmethod
    def _known(cls, value: str) -> str:
        if value not in cls.grades:
            raise ValueError(f"unknown grade{nearest(value, cls.grades)}")
        return value

    def error_rows(self) -> dict[str, Any]:
        """Parameter rows (SI) of the grade's figures, and of all keys of the section that set one."""
        of_grade = self.grades[self.grade].figures
        return {self.figures[name].row: self.figures[name].to_si(value) for name, value in of_grade.items()} | rows_of(self)


def figures_section(
    name: str,
    parameters: Table,
    grades: Mapping[str, Grade],
    figures: Mapping[str, Figure],
    default: str = "perfect",
    page: str = "docs/instruments.md",
) -> type[FiguresSection]:
    """The keys of an instrument: ``grade``, and one key for each figure; meanings and limits are those of the rows.

    page: of the documentation that has the catalogue.
    """
    keys: dict[str, Any] = {
        "grade": (Annotated[str, one_of(grades)], key(default, f"grade of the catalogue ({page})")),
    }
    keys |= {each: figure.key(parameters, "the grade's") for each, figure in figures.items()}
    section = create_model(name, __base__=FiguresSection, **keys)
    section.grades, section.figures = grades, figures
    return section


class TimedSection(SensorSection):
    """The keys of the timing of an instrument in a scenario."""

    interval_s: Number = key(1.0, "interval between measurements, a whole number of samples", "s", gt=0, le=3600)
    latency_s: Number = key(0.0, "delay of a measurement, a whole number of samples, below the interval", "s", ge=0, le=3600)
    outages_s: tuple[Window, ...] = key((), "intervals without measurements, pairs of begin and end", "s", max_length=OUTAGES)

    @property
    def max_age_s(self) -> float:
        """Largest age of a measurement when it arrives, s."""
        return self.latency_s

    @field_validator("outages_s")
    @classmethod
    def _windows(cls, value: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for begin, end in value:
            if not 0.0 <= begin < end:
                raise ValueError(f"the outage from {begin:g} s to {end:g} s must begin at 0 or later and end after it begins")
        return value

    def timing(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows of the timing.  Raises `InputError` for times that do not fit the samples."""
        id = self.sensor.id
        check_times(id, 1.0 / rate_hz, self.interval_s, self.latency_s)
        begin, end = window_rows(self.outages_s)
        return {
            f"{id}_interval": self.interval_s,
            f"{id}_latency": self.latency_s,
            f"{id}_outage_start": begin,
            f"{id}_outage_end": end,
        }


def window_rows(windows: Sequence[Sequence[float]]) -> tuple[Any, Any]:
    """Begins and ends (OUTAGES,) of outage windows, empty ones behind."""
    rows = np.zeros((2, OUTAGES))
    rows[:, : len(windows)] = np.array(windows).reshape(-1, 2).T
    return rows[0], rows[1]
