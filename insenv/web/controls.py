"""The controls of a page: keys of the scenario whose values the page can change with the numbers of `insenv.run`.

A key is a control if its effect is one that the page repeats to the bit: a multiple of the value in some elements of the
parameters.  A grade or a sea state is one of several sets of numbers.  `insenv.web.probing` finds them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from insenv.core.tables import Vector

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
