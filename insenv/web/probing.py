"""Finds the controls of a page, by building the scenario with other values.

This is done for every key of its sections, one at a time, and checked on values of all controls together; a key whose effect
is not a multiple of its value (a division, a spectrum) is no control.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Vector
from insenv.scenario import Scenario
from insenv.web.controls import (
    FORMS,
    Choice,
    Control,
    Key,
    Option,
    Setting,
    Target,
    choices,
    keys,
    setting_of,
    unit_suffix,
    with_values,
)

Numbers = tuple[Vector, Vector]
"""Parameters of the page's model, and `insenv.web.start.known_vector`."""
TRIALS, COMBINATIONS = 3, 6


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
        choice_controls = map(self._choice, choices(self.scenario))
        found = self._together(list(filter(None, (*choice_controls, *map(self._number, keys(self.scenario))))))
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
                label = rest.removesuffix(unit_suffix(key.unit, rest)).replace(".0.", ".").replace(".", " ").replace("_", " ")
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


def _follows(form: str, scale: float, values: Sequence[float], numbers: Sequence[float]) -> bool:
    if form == "inverse" and 0.0 in values:
        return False
    return all(FORMS[form](value, scale) == number for value, number in zip(values, numbers, strict=True))
