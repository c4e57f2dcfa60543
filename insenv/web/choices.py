"""The controls of a page that are one of several sets of numbers: grades, figures of the inertial unit, sea states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from insenv.scenario import Scenario
from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES
from insenv.sensors.grade_file import grade_of
from insenv.sensors.grades import unit_of
from insenv.web.controls import Setting
from insenv.web.keys import unit_suffix

FIGURES = (
    "gyro_bias_sigma_deg_h",
    "gyro_arw_deg_sqrt_h",
    "accel_bias_sigma_ug",
    "accel_vrw_ug_sqrt_hz",
    "accel_vrw_m_s_sqrt_h",
)
FACTORS = (0.1, 0.3, 3.0, 10.0)
"""Figures of the scenario's inertial unit that a page changes, and the factors on them."""
SEA_STATES = {
    "sea state 2": (0.3, 6.3),
    "sea state 3": (0.88, 7.5),
    "sea state 4": (1.88, 8.8),
    "sea state 5": (3.25, 9.7),
    "sea state 6": (5.0, 12.4),
}
"""Significant height (m) and period of the peak (s), most probable in the North Atlantic; Bales, "Designing ships to the
natural environment", Naval Engineers Journal 95 (1983)."""


@dataclass(frozen=True)
class Choice:
    """One of several sets of numbers: by name, the keys that it sets.  value: the name of the scenario's own."""

    key: str
    label: str
    group: str
    value: str
    settings: dict[str, Setting]


def choices(scenario: Scenario) -> Iterator[Choice]:
    """Those of a scenario; not all settings need be allowed."""
    for group, section, grades in (("imu", scenario.imu, IMU_GRADES), ("gnss", scenario.gnss, GNSS_GRADES)):
        if section is not None:
            own = section.grade if isinstance(section.grade, str) else section.grade.name
            settings: dict[str, Setting] = {name: {f"{group}.grade": name} for name in grades}
            settings.setdefault(own, {})  # that of a grade file stays as it is
            settings |= _figures(scenario) if group == "imu" else {}
            yield Choice(f"{group}.grade", "unit" if group == "imu" else "receiver", group, own, settings)
    sea = getattr(scenario.vehicle, "sea", None)
    if sea is not None:
        own = f"{sea.significant_height_m:g} m, {sea.peak_period_s:g} s"
        states = {f"{name}: {height:g} m, {period:g} s": (height, period) for name, (height, period) in SEA_STATES.items()}
        states[own] = (sea.significant_height_m, sea.peak_period_s)
        seas: dict[str, Setting] = {
            name: {"vehicle.sea.significant_height_m": height, "vehicle.sea.peak_period_s": period}
            for name, (height, period) in states.items()
        }
        yield Choice("vehicle.sea", "sea", "vehicle", own, seas)


def _figures(scenario: Scenario) -> dict[str, Setting]:
    """The scenario's own inertial unit with one of its figures worse or better."""
    section, found = scenario.imu, dict[str, Setting]()
    grade = grade_of(section.grade)
    for name in FIGURES:
        own = getattr(section, name)
        value = getattr(grade, name) if own is None else own
        if isinstance(value, float) and value > 0.0:
            for factor in FACTORS:
                number = float(f"{factor * value:.3g}")
                unit = unit_of(name)
                shown = name.removesuffix(unit_suffix(unit, name)).replace("_", " ")
                found[f"{grade.name}, {shown} {number:g} {unit}"] = {f"imu.{name}": number}
    return found
