"""The largest error of an instrument that a key takes, by the unit of its data sheet."""

LARGEST = 1e9
_BY_UNIT = {
    "%": 100.0,
    "ppm": 1e6,
    "% per m/s^2": 100.0,
    "ppm/K": 1e3,
    "deg": 180.0,
    "deg/h/g": 1e6,
    "deg/h/K": 1e4,
    "ug/K": 1e5,
}
"""An error in proportion to a quantity is at most that quantity; one per kelvin or g is ten times that of the poorest units."""


def largest(unit: str) -> float:
    """Bound of a figure, in its unit: `LARGEST` where its unit tells nothing of what is possible."""
    return _BY_UNIT.get(unit, LARGEST)
