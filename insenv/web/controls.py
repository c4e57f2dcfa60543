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
from insenv.base.keys import FORMS, Conversion, conversion_of, unit_of
from insenv.core.tables import Vector
from insenv.scenario import Scenario
from insenv.sensors.catalogue import GNSS_GRADES, IMU_GRADES
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


@dataclass(frozen=True)
class Key:
    """A number of a scenario: its dotted key, value, conversion and bounds."""

    key: str
    value: float | None
    meaning: str
    unit: str
    conversion: Conversion
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
            conversion = conversion_of(field)
            if key not in INTERPOLATED and conversion.form in REPEATED:
                minimum, maximum = _bounds(key, field, value or 0.0)
                yield Key(key, value, field.description or "", unit_of(field), conversion, minimum, maximum)


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


def unit_suffix(unit: str, name: str) -> str:
    """The unit at the end of a key's name."""
    if not unit:
        return ""
    plain = "_" + unit.lower().replace("/", "_").replace("(", "_").replace(")", "").replace("__", "_")
    return next((ending for ending in (plain, plain.replace("m_s", "mps")) if name.endswith(ending)), "")


Setting = Mapping[str, Any]
"""Values by dotted key, such as ``{"start.latitude_deg": 30.0}``; a number is a place in a list."""


@dataclass(frozen=True)
class Target:
    """Elements that follow from the value.

    into: "p" or "known".  form, scale: of the conversion, see `insenv.base.keys.FORMS`.  given: elements of `known` that become
    1, because the value is given.
    """

    into: str
    at: tuple[int, ...]
    form: str
    scale: float
    given: tuple[int, ...] = ()

    def number(self, value: float) -> float:
        """The elements' value."""
        return float(FORMS[self.form](value, self.scale))


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

VARIED = (
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
    for name in VARIED:
        own = getattr(section, name)
        value = getattr(grade, name) if own is None else own
        if isinstance(value, float) and value > 0.0:
            for factor in FACTORS:
                number = float(f"{factor * value:.3g}")
                unit = FIGURES[name].unit
                shown = name.removesuffix(unit_suffix(unit, name)).replace("_", " ")
                found[f"{grade.name}, {shown} {number:g} {unit}"] = {f"imu.{name}": number}
    return found


# The controls that hold: what changes with a value follows from it by the conversion of its key, other controls moved or not.

Numbers = tuple[Vector, Vector]
"""Parameters of the page's model, and `insenv.web.start.known_vector`."""
MIDDLE = 0.3819660112501051
"""Share of a range at which a value is tried, which has no short binary form."""
MOVED = 0.03
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
        options = [control for control in map(self._choice, choices(self.scenario)) if control]
        found = self._together([control for control in map(self._number, keys(self.scenario)) if control], options)
        order = list(type(self.scenario).model_fields)
        return tuple(sorted(self._allowed([*options, *found]), key=lambda control: order.index(control.group)))

    def _of(self, setting: Setting) -> Numbers:
        p, known = self._numbers(with_values(self.values, setting))
        p = np.array(p)
        p[self._ignored] = 0.0
        return p, np.concatenate([np.zeros(9), known[9:]])

    def _number(self, key: Key) -> Control | None:
        low, high = key.range
        for minimum, maximum in dict.fromkeys(((key.minimum, key.maximum), (low, high))):
            values = (minimum, maximum, low + MIDDLE * (high - low))
            try:
                trials = [self._of({key.key: value}) for value in values]
            except InputError:
                continue
            if targets := self._targets(key.conversion, values, trials):
                group, _, rest = key.key.partition(".")
                label = rest.removesuffix(unit_suffix(key.unit, rest)).replace(".0.", ".").replace(".", " ").replace("_", " ")
                bounds = (minimum, maximum, low, high)
                return Control(key.key, label, group, key.meaning, key.value, key.unit, *bounds, targets=targets)
        return None

    def _targets(self, conversion: Conversion, values: Sequence[float], trials: Sequence[Numbers]) -> tuple[Target, ...]:
        """The elements that follow from the values by a conversion; none if others change too."""
        targets: list[Target] = []
        expected = conversion(np.array(values))
        for place, into in enumerate(("p", "known")):
            columns = np.array([trial[place] for trial in trials])
            changed = np.flatnonzero(np.any(columns != self._base[place], axis=0))
            given = changed[(changed >= 27) & np.all(columns[:, changed] == 1.0, axis=0)] if into == "known" else changed[:0]
            at = np.setdiff1d(changed, given)
            if np.any(columns[:, at] != expected[:, None]):
                return ()
            if len(at):
                targets.append(Target(into, tuple(at.tolist()), conversion.form, conversion.scale, tuple(given.tolist())))
        return tuple(targets)

    def _choice(self, choice: Choice) -> Control | None:
        options = []
        for name, setting in choice.settings.items():
            try:
                p, known = self._of(setting)
            except InputError:
                continue
            if known.tobytes() == self._base[1].tobytes():
                changed = np.flatnonzero(p != self._base[0]).tolist()
                options.append(Option(name, name, setting, tuple((at, float(p[at])) for at in changed)))
        if len(options) < 2 or all(option.value != choice.value for option in options):
            return None
        meaning = "one of several sets of numbers"
        return Control(choice.key, choice.label, choice.group, meaning, choice.value, options=tuple(options))

    def _together(self, numbers: list[Control], options: Sequence[Control]) -> list[Control]:
        """The numbers that hold together, and with each option; in general all."""
        if not self._hold(numbers):
            held: list[Control] = []
            for control in numbers:
                held += [control] if self._hold([*held, control]) else []
            numbers = held
        for control in options:
            for option in control.options:
                chosen = replace(control, value=option.value)
                if not self._hold([chosen, *numbers]):
                    numbers = [number for number in numbers if self._hold([chosen, number])]
        return numbers

    def _hold(self, controls: Sequence[Control]) -> bool:
        """Whether controls with moved values, of options the chosen one, have the numbers of the scenario; refused ones do."""
        values = {control.key: _moved(control) for control in controls}
        try:
            expected = self._of(setting_of(controls, values))
        except InputError:
            return True
        p, known = (np.array(numbers) for numbers in self._base)
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


def _moved(control: Control) -> float | str:
    """The value of an option; a number other than the scenario's, near it."""
    if control.options:
        return str(control.value)
    value = control.low if control.value is None else float(control.value)
    farther = control.high if control.high > value else control.low
    return value + MOVED * (farther - value) * (1.0 + MIDDLE)


def _narrowed(control: Control, share: float) -> Control:
    """The control with its bound towards faster and larger motion at a share of the distance from the scenario's value."""
    if share == 1.0 or not control.targets or not isinstance(control.value, float):
        return control
    if control.targets[0].form == "inverse":
        least = control.value + share * (control.minimum - control.value)
        return replace(control, minimum=least, low=max(least, control.low))
    most = control.value + share * (control.maximum - control.value)
    return replace(control, maximum=most, high=min(most, control.high))
