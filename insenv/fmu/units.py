"""Units of an FMU's variables: base exponents (radian included), display units, declared types.

FMI writes a unit as integer powers of the base units.  A unit with a half power (rad/s^0.5) has a name only.
"""

from __future__ import annotations

from dataclasses import dataclass

from insenv.core.tables import Row
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors.units import DEGREE, HOUR, ZERO_CELSIUS

_MICRO_G = 1e-6 * STANDARD_GRAVITY


@dataclass(frozen=True)
class DisplayUnit:
    """A display unit: ``shown = factor * SI + offset``."""

    name: str
    factor: float
    offset: float = 0.0


@dataclass(frozen=True)
class Unit:
    """A unit of the tables.

    name: as in FMUs.  exponents: of the base units, by FMI's names; None if not all are integers.  displays: display units.
    """

    name: str
    exponents: dict[str, int] | None
    displays: tuple[DisplayUnit, ...] = ()


@dataclass(frozen=True)
class Quantity:
    """A declared type without its bounds: type name, physical quantity, unit, display unit, nominal value."""

    name: str
    quantity: str
    unit: str
    display: str = ""
    nominal: float = 1.0


UNITS = {
    unit.name: unit
    for unit in (
        Unit("1", {}),
        Unit("s", {"s": 1}),
        Unit("m", {"m": 1}),
        Unit("rad", {"rad": 1}, (DisplayUnit("deg", 1 / DEGREE),)),
        Unit("m/s", {"m": 1, "s": -1}),
        Unit("rad/s", {"rad": 1, "s": -1}, (DisplayUnit("deg/s", 1 / DEGREE), DisplayUnit("deg/h", HOUR / DEGREE))),
        Unit("m/s^2", {"m": 1, "s": -2}, (DisplayUnit("ug", 1 / _MICRO_G),)),
        Unit("rad/s^2", {"rad": 1, "s": -2}, (DisplayUnit("deg/s^2", 1 / DEGREE),)),
        Unit("m^2/s^3", {"m": 2, "s": -3}),
        Unit("rad^2", {"rad": 2}),
        Unit("1/rad^2", {"rad": -2}),
        Unit("1/m", {"m": -1}),
        Unit("K", {"K": 1}, (DisplayUnit("degC", 1.0, -ZERO_CELSIUS),)),
        Unit("rad/s/K", {"rad": 1, "s": -1, "K": -1}, (DisplayUnit("deg/h/K", HOUR / DEGREE),)),
        Unit("m/s^2/K", {"m": 1, "s": -2, "K": -1}, (DisplayUnit("ug/K", 1 / _MICRO_G),)),
        Unit("(rad/s)/(m/s^2)", {"rad": 1, "s": 1, "m": -1}, (DisplayUnit("deg/h/g", HOUR * STANDARD_GRAVITY / DEGREE),)),
        Unit("T", {"kg": 1, "s": -2, "A": -1}, (DisplayUnit("nT", 1e9),)),
        Unit("T/m", {"kg": 1, "m": -1, "s": -2, "A": -1}, (DisplayUnit("nT/km", 1e12),)),
        Unit("s^2/m", {"s": 2, "m": -1}),
        Unit("rad/(m/s^2)", {"rad": 1, "s": 2, "m": -1}, (DisplayUnit("deg/(m/s^2)", 1 / DEGREE),)),
        Unit("rad/s^0.5", None, (DisplayUnit("deg/sqrt(h)", HOUR**0.5 / DEGREE),)),
        Unit("m/s^1.5", None, (DisplayUnit("ug/sqrt(Hz)", 1 / _MICRO_G),)),
        Unit("rad/s/sqrt(s)", None, (DisplayUnit("deg/h/sqrt(h)", HOUR**1.5 / DEGREE),)),
        Unit("m/s^2/sqrt(s)", None, (DisplayUnit("ug/sqrt(h)", HOUR**0.5 / _MICRO_G),)),
    )
}
"""Every unit of the tables, by its name in FMUs."""

_SMALL = ("bias", "sigma", "drift", "instability")

_QUANTITIES = {
    "1": Quantity("Number", "Dimensionless", "1"),
    "s": Quantity("Time", "Time", "s"),
    "m": Quantity("Length", "Length", "m", nominal=10.0),
    "rad": Quantity("Angle", "Angle", "rad", "deg"),
    "m/s": Quantity("Velocity", "Velocity", "m/s", nominal=10.0),
    "rad/s": Quantity("AngularVelocity", "AngularVelocity", "rad/s", "deg/s", nominal=0.1),
    "m/s^2": Quantity("Acceleration", "Acceleration", "m/s^2", nominal=10.0),
    "rad/s^2": Quantity("AngularAcceleration", "AngularAcceleration", "rad/s^2", "deg/s^2", nominal=0.1),
    "rad^2": Quantity("AngleVariance", "AngleVariance", "rad^2", nominal=1e-4),
    "T": Quantity("MagneticFluxDensity", "MagneticFluxDensity", "T", "nT", nominal=1e-5),
    "K": Quantity("Temperature", "ThermodynamicTemperature", "K", "degC", nominal=300.0),
    "rad/s^0.5": Quantity("AngleRandomWalk", "AngleRandomWalk", "rad/s^0.5", "deg/sqrt(h)", nominal=1e-6),
    "m/s^1.5": Quantity("VelocityRandomWalk", "VelocityRandomWalk", "m/s^1.5", "ug/sqrt(Hz)", nominal=1e-4),
}
_GYRO_ERROR = Quantity("GyroError", "AngularVelocity", "rad/s", "deg/h", nominal=1e-7)
_ACCEL_ERROR = Quantity("AccelerometerError", "Acceleration", "m/s^2", "ug", nominal=1e-3)


def parts(row: Row) -> tuple[str, ...]:
    """The units of the equal parts of a row: one, several (an innovation in m, then m/s), or none if the row is mixed."""
    if row.unit == "SI":
        return ()
    return tuple(row.unit.split(", "))


def quantity(row: Row, unit: str) -> Quantity:
    """The declared type of a row's elements in `unit`; sensor errors are displayed in data-sheet units."""
    if any(word in row.name for word in _SMALL):
        if unit == "rad/s":
            return _GYRO_ERROR
        if unit == "m/s^2":
            return _ACCEL_ERROR
    if unit in _QUANTITIES:
        return _QUANTITIES[unit]
    known = UNITS.get(unit, Unit(unit, None))
    words = "".join(letter if letter.isalnum() else "_" for letter in unit).strip("_")
    return Quantity(f"Quantity_{words}", "", unit, known.displays[0].name if known.displays else "")
