"""The controls of a page: keys of the scenario whose values the page can change with the numbers of `insenv.run`.

A key is a control if its effect is one that the page repeats to the bit: a multiple of the value in some elements of the
parameters.  A grade or a sea state is one of several sets of numbers.  `insenv.web.probing` finds them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from insenv.core.tables import Vector
from insenv.scenario import Scenario
from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES
from insenv.sensors.grade_file import grade_of
from insenv.sensors.grades import unit_of

# The numbers of a scenario that could be controls of a page, with their bounds and usual values.

LEAST = 1e-6
"""Distance of a control from a bound that its key excludes."""
APART = ("imu.drop_probability",)
"""Keys with which the numbers of a page are not those of `insenv.run`, which interpolates over lost samples."""
FARTHEST = {"start.latitude_deg": 80.0}
"""Bounds of controls, narrower than those of their keys: near a pole a vehicle is refused (`insenv.scenario.poles`)."""
WIDE = 1e4
"""Bounds beyond this are those of a file, not of a control's range."""


@dataclass(frozen=True)
class Key:
    """A number of a scenario: its dotted key, value and bounds."""

    key: str
    value: float | None
    meaning: str
    unit: str
    minimum: float
    maximum: float

    @property
    def range(self) -> tuple[float, float]:
        """Usual values: all, of an angle; else up to ten times the scenario's value."""
        if self.minimum < 0.0 and max(-self.minimum, self.maximum) <= WIDE:
            return self.minimum, self.maximum
        size = 10.0 * (abs(self.value or 0.0) or 1.0)
        least = -size if self.minimum < 0.0 else 0.0 if self.minimum == 0.0 else 0.01 * size
        return max(self.minimum, least), min(self.maximum, size)


def keys(scenario: Scenario) -> Iterator[Key]:
    """The numbers of a scenario: those of its sections and of the lists in them that are present, and errors of the start."""
    for name in ("start", "vehicle", *scenario.sensors, "imu", "knowledge"):
        yield from _keys_of(getattr(scenario, name), name)


def _keys_of(section: BaseModel, prefix: str) -> Iterator[Key]:
    for name, field in type(section).model_fields.items():
        value, key = getattr(section, name), f"{prefix}.{name}"
        if isinstance(value, BaseModel):
            yield from _keys_of(value, key)
        elif isinstance(value, tuple) and "." in prefix and all(isinstance(item, BaseModel) for item in value):
            for place, item in enumerate(value):  # of a section in a section: not legs, which are a course
                yield from _keys_of(item, f"{key}.{place}")
        elif isinstance(value, float) or (value is None and prefix == "knowledge" and name.endswith("_error_deg")):
            bounds = [limit for limit in field.metadata if isinstance(limit, (Ge, Gt, Le, Lt))]
            limits = {type(limit): float(getattr(limit, type(limit).__name__.lower())) for limit in bounds}
            minimum = limits.get(Ge, limits[Gt] + LEAST if Gt in limits else -1e9)
            maximum = limits.get(Le, limits[Lt] - LEAST if Lt in limits else 1e9)
            if key in FARTHEST:
                farthest = max(FARTHEST[key], abs(value or 0.0))
                minimum, maximum = -farthest, farthest
            extra = field.json_schema_extra
            unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
            if key not in APART:
                yield Key(key, value, field.description or "", unit, minimum, maximum)


def unit_suffix(unit: str, name: str) -> str:
    """The unit at the end of a key's name."""
    if not unit:
        return ""
    plain = "_" + unit.lower().replace("/", "_").replace("(", "_").replace(")", "").replace("__", "_")
    return next((ending for ending in (plain, plain.replace("m_s", "mps")) if name.endswith(ending)), "")


Setting = Mapping[str, Any]
"""Values by dotted key, such as ``{"start.latitude_deg": 30.0}``; a number is a place in a list."""

FORMS: Mapping[str, Callable[[float, float], float]] = {
    "product": lambda value, scale: scale * value,
    "degrees": lambda value, scale: value * math.pi / scale,
    "inverse": lambda value, scale: scale * (1.0 / value),
}
"""The ways in which an element may follow from a value, each rounded in one way: the same in web/machine.js."""


@dataclass(frozen=True)
class Target:
    """Elements that follow from the value.

    into: "p" or "known".  form: of the arithmetic, see `FORMS`.  given: elements of `known` that become 1, because the value
    is given.
    """

    into: str
    at: tuple[int, ...]
    form: str
    scale: float
    given: tuple[int, ...] = ()

    def number(self, value: float) -> float:
        """The elements' value."""
        return FORMS[self.form](value, self.scale)


@dataclass(frozen=True)
class Option:
    """One of the values of a control that is no number: the keys that it sets, and the elements that change with it."""

    value: str
    label: str
    setting: Setting
    p: tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Control:
    """One control.

    key: dotted.  minimum, maximum: bounds of the key.  low, high: a range of usual values.  value: the scenario's; None: not
    given.  A control has targets or options.
    """

    key: str
    label: str
    group: str
    meaning: str
    value: float | str | None
    unit: str = ""
    minimum: float = 0.0
    maximum: float = 0.0
    low: float = 0.0
    high: float = 0.0
    targets: tuple[Target, ...] = ()
    options: tuple[Option, ...] = ()

    def apply(self, value: float | str, p: Vector, known: Vector) -> None:
        """Set the elements that stand for `value`, as web/machine.js does."""
        for option in self.options:
            if option.value == value:
                for at, number in option.p:
                    p[at] = number
        for target in self.targets:
            into = p if target.into == "p" else known
            into[list(target.at)] = target.number(float(value))
            known[list(target.given)] = 1.0

    def setting(self, value: float | str) -> Setting:
        """The keys of the scenario that `value` sets."""
        return next((option.setting for option in self.options if option.value == value), {self.key: value})


def setting_of(controls: Sequence[Control], values: Mapping[str, float | str]) -> dict[str, Any]:
    """The keys of the scenario that values of controls set."""
    by_key = {control.key: control for control in controls}
    return {name: value for key, given in values.items() for name, value in by_key[key].setting(given).items()}


def with_values(values: Mapping[str, Any], setting: Setting) -> dict[str, Any]:
    """The values of a scenario with some changed, by dotted key."""
    changed = deepcopy(dict(values))
    for key, value in setting.items():
        *path, last = [int(part) if part.isdigit() else part for part in key.split(".")]
        here: Any = changed
        for part in path:
            here = here.setdefault(part, {}) if isinstance(here, dict) else here[part]
        here[last] = value
    return changed


# The controls of a page that are one of several sets of numbers: grades, figures of the inertial unit, sea states.

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
