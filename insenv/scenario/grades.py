"""What a grade of the catalogue gives for a key that a scenario leaves to it."""

from __future__ import annotations

from typing import Any

from insenv.base.errors import InputError
from insenv.sensors import gnss_grade, imu_grade
from insenv.sensors.figures import FiguresSection
from insenv.sensors.registry import registered

_GNSS = {"velocity_noise_mps": "velocity_noise_m_s"}
"""Fields of `GnssGrade` that have another name than the key."""


def grade_value(section: str, grade: str, key: str) -> Any:
    """The value in the unit of the key, one number or three; None if the section has no such figure.

    Raises `InputError` for an unknown grade.
    """
    if section == "imu":
        return getattr(imu_grade(grade), key, None)
    if section == "gnss":
        return getattr(gnss_grade(grade), _GNSS.get(key, key), None)
    kind = registered().get(section)
    if kind is None or not issubclass(kind, FiguresSection) or key not in kind.figures or not kind.figures[key].vector:
        return None
    if grade not in kind.grades:
        raise InputError(f"{section}.grade = {grade!r}: unknown grade")
    return kind.grades[grade].figures.get(key, 0.0)
