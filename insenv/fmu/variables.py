"""The variables of an FMU: the rows of the model's tables, in the order of the array of variables in C."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from insenv.core.tables import Row, Vector
from insenv.fmu.reading import element_names
from insenv.fmu.subject import Subject
from insenv.geodesy import STANDARD_GRAVITY
from insenv.scenario.loop import PREFIX as LOOP_PREFIX
from insenv.sensors.units import DEGREE, HOUR, ZERO_CELSIUS

PREFIX = "parameters."
"""Prefix of parameters, because an output may have the same name (`velocity_sigma`)."""
_AXES = {
    "n": ("north", "east", "down"),
    "b": ("forward", "right", "down"),
    "e": ("x", "y", "z"),
    "w": ("x", "y", "down"),
}
_FRAMES = {
    "n": "north, east, down",
    "b": "forward, right, down",
    "e": "Earth-fixed x, y, z",
    "w": "wander azimuth",
    "n at the start": "north, east, down at the start",
}
"""Frames in the words of a description."""
SAMPLED = ("delta_angle", "delta_velocity")
_NOT_INTERPOLATED = "; one sample for each step, held over it and not interpolated"


STEP_IS_ONE_INCREMENT = Row(
    "step_is_one_increment",
    "Whether the inputs are the increments over the whole communication step, whose length dt then takes (1), or over one "
    "sample interval, which is then the only step allowed (0)",
    lower=0,
    upper=1,
    flag=True,
)
"""Parameter of the FMU of an estimator that is no row of its model."""
NOT_GIVEN = -1.0
SAMPLE_NUMBER = Row(
    "sample_number",
    "Number of the inertial sample, a whole number that is 1 larger in each step: shows that the importer neither repeats, "
    "omits nor interpolates samples; -1: not given",
    start=NOT_GIVEN,
    lower=NOT_GIVEN,
    upper=2.0**53,
)
"""Input of the FMU of an estimator that is no row of its model.  It is not checked for being whole when it is set."""


class Kind(IntEnum):
    """Kinds of variables, with the numbers of fmu/c/instance.h."""

    NONE, TIME, CONSTANT, PARAMETER, INPUT, OUTPUT = range(6)


@dataclass(frozen=True)
class Variable:
    """A row as a variable.

    name: in the FMU.  number: of the row.  place: of its first element.  start: flat, or None.  tunable: whether it is a
    parameter that may be set between steps.
    """

    row: Row
    name: str
    kind: Kind
    number: int
    place: int
    start: Vector | None
    tunable: bool = False

    @property
    def elements(self) -> list[str]:
        """The names of its elements, by rows and counted from 1 as in FMI; its own name if it is a scalar."""
        return list(element_names(self.name, self.row.shape))

    @property
    def description(self) -> str:
        """Meaning and frame."""
        frame = _FRAMES.get(self.row.frame, self.row.frame)
        components = "scalar first" if self._is_quaternion else frame
        is_named = not components or components in self.row.meaning or not self.row.shape
        return self.row.meaning + ("" if is_named else f" ({components})") + self._further

    def element_description(self, element: int) -> str:
        """Meaning and axis of one element."""
        axes = ("w", "x", "y", "z") if self._is_quaternion else _AXES.get(self.row.frame.split(" ")[0], ())
        if not self.row.shape:
            return self.row.meaning + self._further
        if len(self.row.shape) == 1 and axes and self.row.size % len(axes) == 0:
            return f"{self.row.meaning}: {axes[element % len(axes)]}{self._further}"
        return f"{self.row.meaning}: element {element + 1}"

    @property
    def _further(self) -> str:
        return _NOT_INTERPOLATED if self.kind is Kind.INPUT and self.row.name in SAMPLED else ""

    @property
    def _is_quaternion(self) -> bool:
        return self.row.shape == (4,) and self.row.name.startswith(("q_", "start_quaternion"))


def variables(subject: Subject) -> list[Variable]:
    """All rows in order: time, sample interval, how a step is read and `SAMPLE_NUMBER` (of an estimator), parameters, inputs,
    outputs.

    Rows of kind NONE are not variables of the FMU.
    """
    model, interval = subject.model, np.array([subject.sample_interval])
    rows: list[tuple[Row, str, Kind, Vector | None]] = [(Row("time", "Time", "s"), "time", Kind.TIME, None)]
    if "sample_interval" not in model.parameters:
        row = Row("sample_interval", "Time from one inertial sample to the next", "s")
        rows.append((row, row.name, Kind.CONSTANT, interval))
    if subject.kind == "estimator" and "dt" in model.inputs:
        row = STEP_IS_ONE_INCREMENT
        rows.append((row, PREFIX + row.name, Kind.PARAMETER, np.array([float(subject.step_is_one_increment)])))
        if all(name in model.inputs and model.inputs[name].size == 3 for name in SAMPLED):
            rows.append((SAMPLE_NUMBER, SAMPLE_NUMBER.name, Kind.INPUT, SAMPLE_NUMBER.flat_start()))
    for row in model.parameters:
        name, kind = _name(subject, row.name, PREFIX), Kind.PARAMETER
        if row.name == "sample_interval":
            name, kind = row.name, Kind.CONSTANT
        rows.append((row, name, kind, subject.parameters[model.parameters.slice(row.name)]))
    for row in model.inputs:
        rows.append((row, row.name, Kind.INPUT, interval if row.name == "dt" else row.flat_start()))
    for row in model.outputs:
        kind = Kind.NONE if row.name == "time" else Kind.OUTPUT  # FMI has its own variable for the time
        rows.append((row, _name(subject, row.name), kind, None))

    result, place = [], 0
    for number, (row, name, kind, start) in enumerate(rows):
        result.append(Variable(row, name, kind, number, place, start, kind is Kind.PARAMETER and row.name in subject.tunable))
        place += row.size
    names = [v.name for v in result if v.kind is not Kind.NONE]
    if len(set(names)) != len(names):
        raise ValueError(f"{subject.id}: two variables have the same name")
    return result


def _name(subject: Subject, row: str, prefix: str = "") -> str:
    """The name of a row; in a loop, those of the estimator begin with ``estimator.``."""
    if subject.kind == "loop" and row.startswith(LOOP_PREFIX):
        return f"estimator.{prefix}{row.removeprefix(LOOP_PREFIX)}"
    return prefix + row


# Units of an FMU's variables: base exponents (radian included), display units, declared types.
#
# FMI writes a unit as integer powers of the base units.  A unit with a half power (rad/s^0.5) has a name only.


class DisplayUnit(NamedTuple):
    """A display unit: ``shown = factor * SI + offset``."""

    name: str
    factor: float
    offset: float = 0.0


@dataclass(frozen=True)
class Quantity:
    """A declared type without its bounds: type name, physical quantity, unit, display unit, nominal value."""

    name: str
    quantity: str
    unit: str
    display: str = ""
    nominal: float = 1.0


@dataclass(frozen=True)
class Unit:
    """A unit of the tables.

    name: as in FMUs.  exponents: of the base units, by FMI's names; None if not all are integers.  type, physical, nominal: of
    the declared type; by default the type is named after the unit, or has the name of the physical quantity.  displays: display
    units; the type has the first if `displayed`.
    """

    name: str
    exponents: dict[str, int] | None
    type: str = ""
    displays: tuple[DisplayUnit, ...] = ()
    physical: str = ""
    nominal: float = 1.0
    displayed: bool = True

    @property
    def quantity(self) -> Quantity:
        """The declared type of values in this unit."""
        words = "".join(letter if letter.isalnum() else "_" for letter in self.name).strip("_")
        display = self.displays[0].name if self.displays and self.displayed else ""
        return Quantity(self.type or f"Quantity_{words}", self.physical or self.type, self.name, display, self.nominal)


_DEG, _DEG_H, _UG = 1 / DEGREE, HOUR / DEGREE, 1 / (1e-6 * STANDARD_GRAVITY)

UNITS = {
    unit.name: unit
    for unit in (
        Unit("1", {}, "Number", physical="Dimensionless"),
        Unit("s", {"s": 1}, "Time"),
        Unit("m", {"m": 1}, "Length", nominal=10.0),
        Unit("rad", {"rad": 1}, "Angle", (DisplayUnit("deg", _DEG),)),
        Unit("m/s", {"m": 1, "s": -1}, "Velocity", nominal=10.0),
        Unit("rad/s", {"rad": 1, "s": -1}, "AngularVelocity", (DisplayUnit("deg/s", _DEG), DisplayUnit("deg/h", _DEG_H)),
             nominal=0.1),
        Unit("m/s^2", {"m": 1, "s": -2}, "Acceleration", (DisplayUnit("ug", _UG),), nominal=10.0, displayed=False),
        Unit("rad/s^2", {"rad": 1, "s": -2}, "AngularAcceleration", (DisplayUnit("deg/s^2", _DEG),), nominal=0.1),
        Unit("m^2/s^3", {"m": 2, "s": -3}),
        Unit("rad^2", {"rad": 2}, "AngleVariance", nominal=1e-4),
        Unit("1/rad^2", {"rad": -2}),
        Unit("1/m", {"m": -1}),
        Unit("K", {"K": 1}, "Temperature", (DisplayUnit("degC", 1.0, -ZERO_CELSIUS),), "ThermodynamicTemperature", 300.0),
        Unit("rad/s/K", {"rad": 1, "s": -1, "K": -1}, "", (DisplayUnit("deg/h/K", _DEG_H),)),
        Unit("m/s^2/K", {"m": 1, "s": -2, "K": -1}, "", (DisplayUnit("ug/K", _UG),)),
        Unit("(rad/s)/(m/s^2)", {"rad": 1, "s": 1, "m": -1}, "", (DisplayUnit("deg/h/g", HOUR * STANDARD_GRAVITY / DEGREE),)),
        Unit("T", {"kg": 1, "s": -2, "A": -1}, "MagneticFluxDensity", (DisplayUnit("nT", 1e9),), nominal=1e-5),
        Unit("T/m", {"kg": 1, "m": -1, "s": -2, "A": -1}, "", (DisplayUnit("nT/km", 1e12),)),
        Unit("s^2/m", {"s": 2, "m": -1}),
        Unit("rad/(m/s^2)", {"rad": 1, "s": 2, "m": -1}, "", (DisplayUnit("deg/(m/s^2)", _DEG),)),
        Unit("rad/s^0.5", None, "AngleRandomWalk", (DisplayUnit("deg/sqrt(h)", HOUR**0.5 / DEGREE),), nominal=1e-6),
        Unit("m/s^1.5", None, "VelocityRandomWalk", (DisplayUnit("ug/sqrt(Hz)", _UG),), nominal=1e-4),
        Unit("rad/s/sqrt(s)", None, "", (DisplayUnit("deg/h/sqrt(h)", HOUR**1.5 / DEGREE),)),
        Unit("m/s^2/sqrt(s)", None, "", (DisplayUnit("ug/sqrt(h)", HOUR**0.5 / (1e-6 * STANDARD_GRAVITY)),)),
    )
}  # fmt: skip
"""Every unit of the tables, by its name in FMUs."""
_SENSOR_ERRORS = {
    "rad/s": Quantity("GyroError", "AngularVelocity", "rad/s", "deg/h", nominal=1e-7),
    "m/s^2": Quantity("AccelerometerError", "Acceleration", "m/s^2", "ug", nominal=1e-3),
}
"""Declared types of small values, which are displayed in data-sheet units."""
_SMALL = ("bias", "sigma", "drift", "instability")


def parts(row: Row) -> tuple[str, ...]:
    """The units of the equal parts of a row: one, several (an innovation in m, then m/s), or none if the row is mixed."""
    return () if row.unit == "SI" else tuple(row.unit.split(", "))


def unit_of(name: str) -> Unit:
    """The unit of this name."""
    return UNITS.get(name) or Unit(name, None)


def quantity(row: Row, unit: str) -> Quantity:
    """The declared type of a row's elements in `unit`."""
    small = any(word in row.name for word in _SMALL)
    return (small and _SENSOR_ERRORS.get(unit)) or unit_of(unit).quantity
