"""The controls of a page: keys of the scenario whose values the page can change with the numbers of `insenv.run`.

A key declares its conversion (`insenv.base.keys`).  It is a control if all that changes with it follows from its value by that
conversion, so that the page repeats it to the bit; a key with another effect (a spectrum, a hypotenuse) is none.  A grade or a
sea state is one of several sets of numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from insenv.base.errors import InputError
from insenv.base.keys import conversion_of, unit_of
from insenv.base.units import SAME, Conversion
from insenv.core.tables import Vector
from insenv.scenario import Scenario
from insenv.sensors.catalogue import IMU_GRADES
from insenv.sensors.grade_file import grade_of
from insenv.sensors.grades import FIGURES

# The numbers of a scenario that could be controls of a page, with their bounds and usual values.

EXCLUDED = 1e-6
"""Distance of a control from a bound that its key excludes."""
INTERPOLATED = ("imu.drop_probability",)
"""Keys with which the numbers of a page are not those of `insenv.run`, which interpolates over lost samples."""
NARROWER = {"start.latitude_deg": 80.0}
"""Bounds of controls, narrower than those of their keys: near a pole a vehicle is refused (`insenv.scenario.poles`)."""
WIDE = 1e4
"""Bounds beyond this are those of a file, not of a control's range."""
REPEATED = ("product", "quotient", "degrees", "inverse")
"""Forms of a conversion that web/machine.js has."""


Setting = Mapping[str, Any]
"""Values by dotted key, such as ``{"start.latitude_deg": 30.0}``; a number is a place in a list."""


@dataclass(frozen=True)
class Target:
    """Elements that follow from the value.

    into: "p" or "known".  stated: elements of `known` that become 1, because the value is stated.
    """

    into: str
    at: tuple[int, ...]
    stated: tuple[int, ...] = ()


@dataclass(frozen=True)
class Option:
    """One of the values of a control that is no number: its name, the keys that it sets, and the elements that change."""

    value: str
    setting: Setting
    p: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class Control:
    """One control: a number of the scenario with targets, or one of several options.

    key: dotted.  conversion: of the number.  minimum, maximum: bounds of the key.  low, high: a range of usual values.  value:
    the scenario's; None: absent.
    """

    key: str
    label: str
    meaning: str
    value: float | str | None
    unit: str = ""
    conversion: Conversion = SAME
    minimum: float = 0.0
    maximum: float = 0.0
    low: float = 0.0
    high: float = 0.0
    targets: tuple[Target, ...] = ()
    options: tuple[Option, ...] = ()

    @property
    def group(self) -> str:
        """The section of the scenario."""
        return self.key.partition(".")[0]

    @property
    def worst(self) -> float:
        """The bound towards faster and larger motion."""
        return self.minimum if self.conversion.form == "inverse" else self.maximum

    def apply(self, value: float | str, p: Vector, known: Vector) -> None:
        """Set the elements that stand for `value`, as web/machine.js does."""
        for option in self.options:
            if option.value == value:
                for at, number in option.p:
                    p[at] = number
        for target in self.targets:
            into = p if target.into == "p" else known
            into[list(target.at)] = self.conversion(float(value))
            known[list(target.stated)] = 1.0

    def setting(self, value: float | str) -> Setting:
        """The keys of the scenario that `value` sets."""
        return next((option.setting for option in self.options if option.value == value), {self.key: value})


def setting_of(controls: Sequence[Control], values: Mapping[str, float | str]) -> dict[str, Any]:
    """The keys of the scenario that values of controls set."""
    return {
        name: value
        for control in controls
        if control.key in values
        for name, value in control.setting(values[control.key]).items()
    }


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


def numbers(scenario: Scenario) -> Iterator[Control]:
    """The numbers of a scenario: those of its sections and of the lists in them that are present, and errors of the start."""
    for name in ("start", "vehicle", *scenario.sensors, "imu", "knowledge"):
        yield from _numbers_in(getattr(scenario, name), name)


def _numbers_in(section: BaseModel, prefix: str) -> Iterator[Control]:
    for name, field in type(section).model_fields.items():
        value, key = getattr(section, name), f"{prefix}.{name}"
        if isinstance(value, BaseModel):
            yield from _numbers_in(value, key)
        elif isinstance(value, tuple) and "." in prefix and all(isinstance(item, BaseModel) for item in value):
            for place, item in enumerate(value):  # of a section in a section: not legs, which are a course
                yield from _numbers_in(item, f"{key}.{place}")
        elif isinstance(value, float) or (value is None and prefix == "knowledge" and name.endswith("_error_deg")):
            conversion, unit = conversion_of(field), unit_of(field)
            if key not in INTERPOLATED and conversion.form in REPEATED:
                minimum, maximum = _bounds(key, field, value or 0.0)
                low, high = _range(value or 0.0, minimum, maximum)
                meaning, label = field.description or "", _label(key, unit)
                yield Control(key, label, meaning, value, unit, conversion, minimum, maximum, low, high)


def _bounds(key: str, field: FieldInfo, value: float) -> tuple[float, float]:
    """Bounds of a control."""
    if key in NARROWER:
        farthest = max(NARROWER[key], abs(value))
        return -farthest, farthest
    minimum, maximum = -1e9, 1e9
    for limit in field.metadata:
        if isinstance(limit, (Ge, Gt)):
            minimum = float(limit.ge if isinstance(limit, Ge) else limit.gt + EXCLUDED)  # type: ignore[arg-type, operator]
        elif isinstance(limit, (Le, Lt)):
            maximum = float(limit.le if isinstance(limit, Le) else limit.lt - EXCLUDED)  # type: ignore[arg-type, operator]
    return minimum, maximum


def _range(value: float, minimum: float, maximum: float) -> tuple[float, float]:
    """Usual values: all, of an angle; else up to ten times the scenario's value."""
    if minimum < 0.0 and max(-minimum, maximum) <= WIDE:
        return minimum, maximum
    size = 10.0 * (abs(value) or 1.0)
    least = -size if minimum < 0.0 else 0.0 if minimum == 0.0 else 0.01 * size
    return max(minimum, least), min(maximum, size)


def _label(key: str, unit: str) -> str:
    """The key without its section and its unit, in words."""
    name = key.partition(".")[2]
    return name.removesuffix(unit_suffix(unit, name)).replace(".0.", ".").replace(".", " ").replace("_", " ")


def unit_suffix(unit: str, name: str) -> str:
    """The unit at the end of a key's name."""
    if not unit:
        return ""
    plain = "_" + unit.lower().replace("/", "_").replace("(", "_").replace(")", "").replace("__", "_")
    return next((ending for ending in (plain, plain.replace("m_s", "mps")) if name.endswith(ending)), "")


# The controls of a page that are one of several sets of numbers: grades, figures of the inertial unit, presets of the vehicle.

VARIED = (
    "gyro_bias_sigma_deg_h",
    "gyro_arw_deg_sqrt_h",
    "accel_bias_sigma_ug",
    "accel_vrw_ug_sqrt_hz",
    "accel_vrw_m_s_sqrt_h",
)
FACTORS = (0.1, 0.3, 3.0, 10.0)
"""Figures of the scenario's inertial unit that a page changes, and the factors on them."""
LABELS = {"imu": "unit", "gnss": "receiver"}
"""Of the grades of what is no aiding instrument."""


def choices(scenario: Scenario) -> Iterator[Control]:
    """Those of a scenario; not all options need be allowed."""
    for id, section in {"imu": scenario.imu, **scenario.sensors}.items():
        label, grades = LABELS.get(id, f"{id} grade"), IMU_GRADES if id == "imu" else getattr(section, "grades", ())
        if grades:
            current = section.grade if isinstance(section.grade, str) else section.grade.name  # type: ignore[attr-defined]
            settings: dict[str, Setting] = {name: {f"{id}.grade": name} for name in grades}
            settings.setdefault(current, {})  # that of a grade file stays as it is
            yield _choice(f"{id}.grade", label, current, settings | (_figures(scenario) if id == "imu" else {}))
    for key, presets in scenario.vehicle.presets.items():
        if (section := getattr(scenario.vehicle, key)) is not None:
            yield _presets(f"vehicle.{key}", section, presets)


def _presets(key: str, section: BaseModel, presets: Mapping[str, Mapping[str, float]]) -> Control:
    """The choice between presets of a section and its own values."""
    units = {name: unit_of(field) for name, field in type(section).model_fields.items()}

    def text(values: Mapping[str, float]) -> str:
        return ", ".join(f"{value:g} {units[name]}" for name, value in values.items())

    current = {name: getattr(section, name) for name in next(iter(presets.values()))}
    sets = {f"{name}: {text(values)}": values for name, values in presets.items()} | {text(current): current}
    settings = {label: {f"{key}.{name}": value for name, value in values.items()} for label, values in sets.items()}
    return _choice(key, key.rpartition(".")[2], text(current), settings)


def _choice(key: str, label: str, value: str, settings: Mapping[str, Setting]) -> Control:
    options = tuple(Option(name, setting) for name, setting in settings.items())
    return Control(key, label, "one of several sets of numbers", value, options=options)


def _figures(scenario: Scenario) -> dict[str, Setting]:
    """The scenario's own inertial unit with one of its figures worse or better."""
    section, settings = scenario.imu, dict[str, Setting]()
    grade = grade_of(section.grade)
    for name in VARIED:
        stated = getattr(section, name)
        value = getattr(grade, name) if stated is None else stated
        if isinstance(value, float) and value > 0.0:
            for factor in FACTORS:
                number, unit = float(f"{factor * value:.3g}"), FIGURES[name].unit
                text = name.removesuffix(unit_suffix(unit, name)).replace("_", " ")
                settings[f"{grade.name}, {text} {number:g} {unit}"] = {f"imu.{name}": number}
    return settings


# The controls that hold: what changes with a value follows from it by the conversion of its key, other controls moved or not.

Numbers = tuple[Vector, Vector]
"""Parameters of the page's model, and `insenv.web.start.known_vector`."""
MIDDLE = 0.3819660112501051
"""Share of a range at which a value is tried, which has no short binary form."""
MOVED = 0.0301
"""Share of the range by which a value is moved for a trial of several controls together; larger ones are refused sooner."""


class Trials:
    """Finds controls.  numbers: those of a scenario of these values; raises `InputError` for values that it does not take.

    ignored: elements of the parameters that the start fills in.
    """

    def __init__(self, scenario: Scenario, numbers: Callable[[dict[str, Any]], Numbers], ignored: Sequence[int]) -> None:
        self.scenario, self._numbers = scenario, numbers
        self.values: dict[str, Any] = scenario.model_dump(mode="json", exclude_unset=True)
        self._ignored = list(ignored)
        self._base = self._of({})

    def controls(self) -> tuple[Control, ...]:
        """All controls, in the order of the scenario's sections."""
        options = [control for control in map(self._with_options, choices(self.scenario)) if control]
        targets = [control for control in map(self._with_targets, numbers(self.scenario)) if control]
        order = list(type(self.scenario).model_fields)
        controls = self._allowed(self._together(options, targets))
        return tuple(sorted(controls, key=lambda control: order.index(control.group)))

    def _of(self, setting: Setting) -> Numbers:
        p, known = self._numbers(with_values(self.values, setting))
        p = np.array(p)
        p[self._ignored] = 0.0
        return p, np.concatenate([np.zeros(9), known[9:]])

    def _with_targets(self, control: Control) -> Control | None:
        """The control with the elements that follow from its value; None if others change too, or none does."""
        low, high = control.low, control.high
        for minimum, maximum in dict.fromkeys(((control.minimum, control.maximum), (low, high))):
            values = (minimum, maximum, low + MIDDLE * (high - low))
            try:
                trials = [self._of({control.key: value}) for value in values]
            except InputError:
                continue
            if targets := self._targets(control.conversion(np.array(values)), trials):
                return replace(control, minimum=minimum, maximum=maximum, targets=targets)
        return None

    def _targets(self, expected: Vector, trials: Sequence[Numbers]) -> tuple[Target, ...]:
        """The elements that have the `expected` values in the trials; none if others change too."""
        targets: list[Target] = []
        for place, into in enumerate(("p", "known")):
            columns = np.array([trial[place] for trial in trials])
            changed = np.flatnonzero(np.any(columns != self._base[place], axis=0))
            stated = changed[(changed >= 27) & np.all(columns[:, changed] == 1.0, axis=0)] if into == "known" else changed[:0]
            at = np.setdiff1d(changed, stated)
            if np.any(columns[:, at] != expected[:, None]):
                return ()
            if len(at):
                targets.append(Target(into, tuple(at.tolist()), tuple(stated.tolist())))
        return tuple(targets)

    def _with_options(self, control: Control) -> Control | None:
        """The control with the options that are allowed, and the elements that they change; None if there are not two."""
        options = []
        for option in control.options:
            try:
                p, known = self._of(option.setting)
            except InputError:
                continue
            if known.tobytes() == self._base[1].tobytes():
                changed = np.flatnonzero(p != self._base[0]).tolist()
                options.append(replace(option, p=tuple((at, float(p[at])) for at in changed)))
        if len(options) < 2 or all(option.value != control.value for option in options):
            return None
        return replace(control, options=tuple(options))

    def _together(self, choices: list[Control], numbers: list[Control]) -> list[Control]:
        """The controls that hold together, with each option; in general all."""
        if not self._hold(numbers):
            held: list[Control] = []
            for control in numbers:
                held += [control] if self._hold([*held, control]) else []
            numbers = held
        for k in range(max(len(control.options) for control in choices) if choices else 0):
            chosen = [replace(control, value=control.options[k % len(control.options)].value) for control in choices]
            while not self._hold(chosen):
                chosen.pop()
            choices = choices[: len(chosen)]
            if not self._hold([*chosen, *numbers]):
                numbers = [number for number in numbers if self._hold([*chosen, number])]
        return [*choices, *numbers]

    def _hold(self, controls: Sequence[Control]) -> bool:
        """Whether controls with moved numbers and chosen options have the numbers of the scenario; refused ones do."""
        values = {control.key: _moved(control) for control in controls}
        try:
            expected = self._of(setting_of(controls, values))
        except InputError:
            return True
        p, known = (np.array(each) for each in self._base)
        for control in controls:
            control.apply(values[control.key], p, known)
        return p.tobytes() == expected[0].tobytes() and known.tobytes() == expected[1].tobytes()

    def _allowed(self, controls: list[Control]) -> list[Control]:
        """The same with bounds between which all values together are allowed.

        Rules on several keys, such as that on the rotation within a sample, are strictest where amplitudes and frequencies are
        largest.  Bounds of the vehicle's keys are moved towards the scenario's values until that is allowed.
        """
        for share in (1.0, 0.3, 0.1, 0.03, 0.0):
            tried = [_narrowed(control, share) if control.group == "vehicle" else control for control in controls]
            corner = {control.key: control.worst for control in tried if control.group == "vehicle" and control.targets}
            try:
                self._of(setting_of(tried, corner))
            except InputError:
                continue
            return tried
        return [control for control in controls if control.group != "vehicle"]


def _moved(control: Control) -> float | str:
    """The chosen option; a number other than the scenario's, near it."""
    if control.options:
        return str(control.value)
    value = control.low if control.value is None else float(control.value)
    farther = control.high if control.high > value else control.low
    return value + MOVED * (farther - value)


def _narrowed(control: Control, share: float) -> Control:
    """The control with its bound towards faster and larger motion at a share of the distance from the scenario's value."""
    if share == 1.0 or not control.targets or not isinstance(control.value, float):
        return control
    worst = control.value + share * (control.worst - control.value)
    if control.conversion.form == "inverse":
        return replace(control, minimum=worst, low=max(worst, control.low))
    return replace(control, maximum=worst, high=min(worst, control.high))
