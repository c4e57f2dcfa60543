"""The controls of a page: keys of the scenario whose values the page can change with the numbers of `insenv.run`.

A key becomes a control if its effect is one that the page repeats to the bit: a multiple of the value in some elements of the
parameters.  This is found by building the scenario with other values, for every key of its sections, and checked on values of
all controls together; a key whose effect is another (a division, a spectrum) is no control.  A grade or a sea state is one of
several sets of numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from insenv.core.tables import Vector
from insenv.errors import InputError
from insenv.scenario import Scenario
from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES
from insenv.sensors.grade_file import grade_of
from insenv.sensors.imu_figures import unit_of

Setting = Mapping[str, Any]
"""Values by dotted key, such as ``{"start.latitude_deg": 30.0}``; a number is a place in a list."""
Numbers = tuple[Vector, Vector]
"""Parameters of the page's model, and `insenv.web.start.known_vector`."""

FORMS: Mapping[str, Callable[[float, float], float]] = {
    "product": lambda value, scale: scale * value,
    "degrees": lambda value, scale: value * math.pi / scale,
    "inverse": lambda value, scale: scale * (1.0 / value),
}
"""The ways in which an element may follow from a value, each rounded in one way: the same in web/machine.js."""
TRIALS, COMBINATIONS = 3, 6
FIGURES = (
    "gyro_bias_sigma_deg_h",
    "gyro_arw_deg_sqrt_h",
    "accel_bias_sigma_ug",
    "accel_vrw_ug_sqrt_hz",
    "accel_vrw_m_s_sqrt_h",
)
FACTORS = (0.1, 0.3, 3.0, 10.0)
"""Figures of the scenario's inertial unit that a page changes, and the factors on them."""
LEAST = 1e-6
"""Distance of a control from a bound that its key excludes."""
APART = ("imu.drop_probability",)
"""Keys with which the numbers of a page are not those of `insenv.run`, which interpolates over lost samples."""
WIDE = 1e4
"""Bounds beyond this are those of a file, not of a control's range."""
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


class Prober:
    """Finds controls.  numbers: those of a scenario of these values; raises `InputError` for values that it does not take.

    ignored: elements of the parameters that the start fills in.
    """

    def __init__(self, scenario: Scenario, numbers: Callable[[dict[str, Any]], Numbers], ignored: Sequence[int]) -> None:
        self.scenario, self._numbers = scenario, numbers
        self.values: dict[str, Any] = scenario.model_dump(mode="json", exclude_unset=True)
        self._ignored = list(ignored)
        self._base = self._of({})
        self._random = np.random.default_rng(0)

    def controls(self) -> tuple[Control, ...]:
        """All controls, in the order of the scenario's sections."""
        found = self._together([*self._choices(), *filter(None, map(self._number, keys(self.scenario)))])
        found = self._allowed(found)
        order = list(type(self.scenario).model_fields)
        return tuple(sorted(found, key=lambda control: order.index(control.group)))

    def _allowed(self, controls: list[Control]) -> list[Control]:
        """The same with bounds between which all values together are allowed.

        Rules on several keys, such as that on the rotation within a sample, are strictest where amplitudes and frequencies are
        largest.  Bounds of the vehicle's keys are moved towards the scenario's values until that is allowed.
        """
        for share in (1.0, 0.3, 0.1, 0.03, 0.0):
            tried = [_narrowed(control, share) if control.group == "vehicle" else control for control in controls]
            corner = {
                control.key: control.minimum if control.targets[0].form == "inverse" else control.maximum
                for control in tried
                if control.group == "vehicle" and control.targets
            }
            try:
                self._of(setting_of(tried, corner))
            except InputError:
                continue
            return tried
        return [control for control in controls if control.group != "vehicle"]

    def _together(self, controls: list[Control]) -> list[Control]:
        """Those that have their numbers together with values of all before them; in general all."""
        if self._fits(controls):
            return controls
        found: list[Control] = []
        for control in controls:
            if self._fits([*found, control]):
                found.append(control)
        return found

    def _of(self, setting: Setting) -> Numbers:
        p, known = self._numbers(with_values(self.values, setting))
        p = np.array(p)
        p[self._ignored] = 0.0
        return p, np.concatenate([np.zeros(9), known[9:]])

    def _number(self, key: Key) -> Control | None:
        for minimum, maximum in dict.fromkeys(((key.minimum, key.maximum), key.range)):
            if targets := self._targets(key, minimum, maximum):
                low, high = key.range
                group, _, rest = key.key.partition(".")
                label = rest.removesuffix(_suffix(key.unit, rest)).replace(".0.", ".").replace(".", " ").replace("_", " ")
                return Control(
                    key.key, label, group, key.meaning, key.value, key.unit, minimum, maximum, low, high, targets=targets
                )
        return None

    def _targets(self, key: Key, minimum: float, maximum: float) -> tuple[Target, ...] | None:
        """The elements that follow from the key in one of the `FORMS`; None if it has another effect, or none."""
        unit = next((v for v in (1.0, 2.0**-4, -1.0) if minimum <= v <= maximum), None)  # scale x unit is exact
        if unit is None:
            return None
        drawn = self._random.uniform(*key.range, 64).tolist()
        drawn.sort(key=lambda value: FORMS["product"](value, math.pi / 180.0) == FORMS["degrees"](value, 180.0))
        values = [unit, *drawn[:TRIALS], minimum, maximum]  # first those in which the forms differ
        try:
            trials = [self._of({key.key: value}) for value in values]
        except InputError:
            return None
        groups: dict[tuple[str, str, float], list[int]] = {}
        given: list[int] = []
        for place, which in enumerate(("p", "known")):
            several = np.array([trial[place] for trial in trials])
            for at in np.flatnonzero(np.any(several != self._base[place], axis=0)).tolist():
                column = several[:, at].tolist()
                if which == "known" and at >= 27 and all(number == 1.0 for number in column):
                    given.append(at)
                    continue
                scales = {"product": column[0] / unit, "degrees": 180.0, "inverse": column[0] * unit}
                fitting = [form for form, scale in scales.items() if _follows(form, scale, values, column)]
                if not fitting:
                    return None
                groups.setdefault((which, fitting[0], scales[fitting[0]]), []).append(at)
        found = [Target(which, tuple(at), form, scale) for (which, form, scale), at in groups.items()]
        return (replace(found[0], given=tuple(given)), *found[1:]) if found else None

    def _choices(self) -> Iterator[Control]:
        scenario = self.scenario
        for group, section, grades in (("imu", scenario.imu, IMU_GRADES), ("gnss", scenario.gnss, GNSS_GRADES)):
            if section is not None:
                own = section.grade if isinstance(section.grade, str) else section.grade.name
                settings: dict[str, Setting] = {name: {f"{group}.grade": name} for name in grades}
                settings.setdefault(own, {})  # that of a grade file stays as it is
                settings |= self._figures() if group == "imu" else {}
                yield from self._choice(f"{group}.grade", "unit" if group == "imu" else "receiver", group, own, settings)
        sea = getattr(scenario.vehicle, "sea", None)
        if sea is not None:
            own = f"{sea.significant_height_m:g} m, {sea.peak_period_s:g} s"
            states = {f"{name}: {height:g} m, {period:g} s": (height, period) for name, (height, period) in SEA_STATES.items()}
            states[own] = (sea.significant_height_m, sea.peak_period_s)
            seas: dict[str, Setting] = {
                name: {"vehicle.sea.significant_height_m": height, "vehicle.sea.peak_period_s": period}
                for name, (height, period) in states.items()
            }
            yield from self._choice("vehicle.sea", "sea", "vehicle", own, seas)

    def _figures(self) -> dict[str, Setting]:
        """The scenario's own inertial unit with one of its figures worse or better."""
        section, found = self.scenario.imu, dict[str, Setting]()
        grade = grade_of(section.grade)
        for name in FIGURES:
            own = getattr(section, name)
            value = getattr(grade, name) if own is None else own
            if isinstance(value, float) and value > 0.0:
                for factor in FACTORS:
                    number = float(f"{factor * value:.3g}")
                    unit = unit_of(name)
                    shown = name.removesuffix(_suffix(unit, name)).replace("_", " ")
                    found[f"{grade.name}, {shown} {number:g} {unit}"] = {f"imu.{name}": number}
        return found

    def _choice(self, key: str, label: str, group: str, value: str, settings: Mapping[str, Setting]) -> Iterator[Control]:
        options = []
        for name, setting in settings.items():
            try:
                p, known = self._of(setting)
            except InputError:
                continue
            if known.tobytes() == self._base[1].tobytes():
                changed = np.flatnonzero(p != self._base[0]).tolist()
                options.append(Option(name, name, setting, tuple((at, float(p[at])) for at in changed)))
        if len(options) > 1 and any(option.value == value for option in options):
            yield Control(key, label, group, "one of several sets of numbers", value, options=tuple(options))

    def _fits(self, controls: Sequence[Control]) -> bool:
        """Whether the last control has its numbers together with values of those before it."""
        for _ in range(COMBINATIONS):
            values = {control.key: self._drawn(control) for control in controls}
            try:
                expected = self._of(setting_of(controls, values))
            except InputError:
                continue
            p, known = (np.array(numbers) for numbers in self._base)
            for control in controls:
                control.apply(values[control.key], p, known)
            if p.tobytes() != expected[0].tobytes() or known.tobytes() != expected[1].tobytes():
                return False
        return True

    def _drawn(self, control: Control) -> float | str:
        if control.options:
            return control.options[int(self._random.integers(len(control.options)))].value
        return float(self._random.uniform(control.low, control.high))


def _narrowed(control: Control, share: float) -> Control:
    """The control with its bound towards faster and larger motion at a share of the distance from the scenario's value."""
    if share == 1.0 or not control.targets or not isinstance(control.value, float):
        return control
    if control.targets[0].form == "inverse":
        least = control.value + share * (control.minimum - control.value)
        return replace(control, minimum=least, low=max(least, control.low))
    most = control.value + share * (control.maximum - control.value)
    return replace(control, maximum=most, high=min(most, control.high))


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
            extra = field.json_schema_extra
            unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
            if key not in APART:
                yield Key(key, value, field.description or "", unit, minimum, maximum)


def _follows(form: str, scale: float, values: Sequence[float], numbers: Sequence[float]) -> bool:
    if form == "inverse" and 0.0 in values:
        return False
    return all(FORMS[form](value, scale) == number for value, number in zip(values, numbers, strict=True))


def _suffix(unit: str, name: str) -> str:
    """The unit at the end of a key's name."""
    if not unit:
        return ""
    plain = "_" + unit.lower().replace("/", "_").replace("(", "_").replace(")", "").replace("__", "_")
    return next((ending for ending in (plain, plain.replace("m_s", "mps")) if name.endswith(ending)), "")
