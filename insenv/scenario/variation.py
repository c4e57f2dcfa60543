"""Scenario keys that are drawn for each run or episode, by dotted name: ``imu.gyro_bias_deg_h=-0.01:0.01``."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.toml import validated
from insenv.core import noise
from insenv.core.tables import Array
from insenv.scenario.description import Scenario
from insenv.scenario.files import grade_value, parse

# Distributions of varied keys: ``0:1``, ``normal(0, 1)``, ``lognormal(1, 0.5)``, ``loguniform(0.1, 10)``, ``choice(a, b)``.


KINDS = {
    "uniform": "LOW, HIGH",
    "loguniform": "LOW, HIGH",
    "normal": "MEAN, SIGMA",
    "lognormal": "MEDIAN, SIGMA of the natural logarithm",
    "choice": "A, B, ...",
}
"""Kinds of distributions and their parameters."""
_CALL = re.compile(r"\s*([a-z]+)\s*\((.*)\)\s*", re.DOTALL)


@dataclass(frozen=True)
class Distribution:
    """A distribution by its kind (`KINDS`) and parameters; those of "choice" are numbers, texts or truth values."""

    kind: str
    parameters: tuple[Any, ...]

    def __post_init__(self) -> None:
        refusal = self._refusal()
        if refusal:
            raise InputError(f"{self}: {refusal}")

    def __str__(self) -> str:
        return f"{self.kind}({', '.join(f'{p:g}' if isinstance(p, float) else str(p) for p in self.parameters)})"

    def _refusal(self) -> str:
        if self.kind not in KINDS:
            return f"no such distribution{nearest(self.kind, KINDS)}"
        if self.kind == "choice" and not all(isinstance(p, (int, float, str)) for p in self.parameters):
            return "allowed are numbers, texts or truth values"
        if self.kind == "choice":
            kinds = {float if isinstance(p, (int, float)) and not isinstance(p, bool) else type(p) for p in self.parameters}
            if len(self.parameters) < 2 or len(set(self.parameters)) < len(self.parameters) or len(kinds) > 1:
                return "allowed are two or more different values of one kind"
            return "" if kinds != {float} or all(map(math.isfinite, self.parameters)) else "allowed are finite numbers"
        numbers = [isinstance(p, (int, float)) and not isinstance(p, bool) and math.isfinite(p) for p in self.parameters]
        if len(numbers) != 2 or not all(numbers):
            return f"allowed are two finite numbers, {KINDS[self.kind]}"
        first, second = self.parameters
        if self.kind in ("uniform", "loguniform") and first > second:
            return "allowed is a range of numbers, the lower first"
        if self.kind in ("loguniform", "lognormal") and first <= 0:
            return "allowed is a first number above 0"
        return "allowed is a sigma of 0 or more" if self.kind in ("normal", "lognormal") and second < 0 else ""

    def numbers(self, uniforms: Array) -> Array:
        """Values (n,) of the distribution for uniforms (n,) in (0, 1): its quantiles; of "choice" the places of the values."""
        if self.kind == "choice":
            return np.floor(uniforms * len(self.parameters))
        first, second = map(float, self.parameters)
        if self.kind == "uniform":
            return first + (second - first) * uniforms
        if self.kind == "loguniform":
            return first * np.exp(math.log(second / first) * uniforms)
        from scipy.special import ndtri

        normal = second * ndtri(uniforms)
        return first + normal if self.kind == "normal" else first * np.exp(normal)

    def value(self, number: float) -> Any:
        """The value of a scenario's key for one of `numbers`."""
        return self.parameters[int(number)] if self.kind == "choice" else float(number)

    def tried(self, numbers: Array) -> list[tuple[Any, str]]:
        """Values with which a plan is checked, and which ones they are: ends of a range, all choices, extremes of `numbers`."""
        if self.kind in ("uniform", "loguniform", "choice"):
            return [(value, "") for value in self.parameters]
        extremes = {"smallest": float(numbers.min()), "largest": float(numbers.max())}
        return [(value, f"the {which} of {len(numbers)} values drawn") for which, value in extremes.items()]

    @property
    def is_of_numbers(self) -> bool:
        """Whether its values are numbers."""
        return self.kind != "choice" or all(isinstance(p, (int, float)) and not isinstance(p, bool) for p in self.parameters)

    def as_json(self) -> dict[str, Any]:
        """Its documented form; of a range with the keys "low" and "high"."""
        ends = {"low": self.parameters[0], "high": self.parameters[1]} if self.kind == "uniform" else {}
        return {"distribution": self.kind, "parameters": list(self.parameters), **ends}


def parse_distribution(text: str) -> Distribution:
    """Parse ``low:high`` or ``kind(a, b, ...)``.  Raises `InputError` for any other form."""
    call = _CALL.fullmatch(text)
    if call:
        kind, inside = call.groups()
        parameters = tuple(_parameter(part) for part in inside.split(","))
        return Distribution(kind, parameters)
    low, colon, high = text.partition(":")
    try:
        parameters = float(low), float(high)
    except ValueError:
        colon = ""
    if not colon:
        raise InputError(f"allowed is key=low:high, such as imu.gyro_bias_deg_h=-0.01:0.01, or key= one of {_forms()}")
    return Distribution("uniform", parameters)


def _forms() -> str:
    return ", ".join(f"{kind}({parameters})" for kind, parameters in KINDS.items())


def _parameter(text: str) -> Any:
    text = text.strip().strip("\"'")
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


FIXED = {
    "seed": "every run and every episode has a seed of its own; those of a campaign count up from the first one (--seed FIRST)",
    "duration_s": "all runs and episodes share it: it is an option of a campaign and an argument of an environment",
    "rate_hz": "all runs and episodes share it: set it in the scenario",
}
"""Keys that cannot be varied, and why."""


@dataclass(frozen=True)
class Variation:
    """A dotted key of the scenario (elements of lists and vectors are numbered from 0) and its distribution."""

    key: str
    distribution: Distribution

    def __str__(self) -> str:
        return f"{self.key}={self.distribution}"

    def uniforms(self, seeds: Sequence[int]) -> np.ndarray:
        """A uniform in (0, 1) for each seed (n,): a pure function of seed and key, whatever else varies."""
        stream = zlib.crc32(self.key.encode())
        return noise.uniforms(np.array(seeds, dtype=np.uint64), 0, stream, 1)[..., 0]

    def value(self, seed: int) -> Any:
        """The value in the run of `seed`, if the design is "random"."""
        return self.distribution.value(self.distribution.numbers(self.uniforms([seed]))[0])


def parse_variation(text: str) -> Variation:
    """Parse ``key=low:high`` or ``key=kind(a, b)``.  Raises `InputError` for any other form."""
    key, equals, distribution = text.partition("=")
    if not equals or not key.strip():
        raise InputError(f"vary {text!r}: allowed is key=low:high, such as imu.gyro_bias_deg_h=-0.01:0.01")
    try:
        return Variation(key.strip(), parse_distribution(distribution))
    except InputError as error:
        raise InputError(f"vary {text!r}: {error}") from None


def variation_of(key: str, value: object) -> Variation:
    """The variation that Python gives: a pair (low, high), a list of choices, a text as of `parse_distribution`, or a
    `Distribution`.
    """
    if isinstance(value, Distribution):
        return Variation(key, value)
    if isinstance(value, list):
        return _variation(key, value, lambda: Distribution("choice", tuple(value)))
    if isinstance(value, str):
        return _variation(key, value, lambda: parse_distribution(value))
    try:
        low, high = (float(limit) for limit in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError(
            f"vary[{key!r}] = {value!r}: allowed is a pair of numbers, the lower first, a list of choices, or a text such as "
            "'normal(0, 1)'"
        ) from None
    return _variation(key, value, lambda: Distribution("uniform", (low, high)))


def _variation(key: str, value: object, distribution: Callable[[], Distribution]) -> Variation:
    try:
        return Variation(key, distribution())
    except InputError as error:
        raise InputError(f"vary[{key!r}] = {value!r}: {error}") from None


def varied(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario's values with `values`, by dotted key, inserted; sections that have such a key are copies.

    Raises `InputError` for an unknown key.  Grades come first: an element of a vector that the scenario leaves to the grade
    replaces one of the grade in force.
    """
    sections = {key.split(".")[0] for key in values}
    changed = {name: _copied(value) if name in sections else value for name, value in data.items()}
    for key in sorted(values, key=lambda key: (not key.endswith(".grade"), key)):
        _insert(changed, key, values[key])
    return changed


def _copied(value: Any) -> Any:
    """A copy of tables and lists of plain values, in less time than `copy.deepcopy`."""
    if isinstance(value, dict):
        return {name: _copied(part) for name, part in value.items()}
    return [_copied(part) for part in value] if isinstance(value, (list, tuple)) else value


def _insert(changed: dict[str, Any], key: str, value: Any) -> None:
    *path, last = key.split(".")
    owner: Any = changed
    for done, part in enumerate(path):
        before, owner = owner, _inside(owner, part, key)
        if owner is None and done == 1 and last.isdigit():
            owner = before[part] = _of_grade(changed, path[0], part, key)
        if owner is None:
            raise InputError(f"vary {key!r}: the scenario has no [{'.'.join(path[: done + 1])}]")
        if path[0] == "estimator" and done == 0:
            owner.setdefault(path[1] if len(path) > 1 else last, {})
    present = None if path[:1] == ["estimator"] else _inside(owner, last, key)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if number and (isinstance(present, (bool, str, dict)) or _is_list_of_others(present)):
        raise InputError(f"vary {key!r}: allowed is a key whose value is a number")
    if not number and present is not None and not isinstance(present, type(value)):
        what = {str: "a name", bool: "true or false"}.get(type(value), "of another kind")
        raise InputError(f"vary {key!r}: {value!r} is {what}, which the value of this key is not")
    owner[int(last) if isinstance(owner, list) else last] = value


def _of_grade(data: Mapping[str, Any], section: str, name: str, key: str) -> list[float]:
    """The three elements of a vector that the scenario leaves to the grade of a section."""
    grade = data[section].get("grade")
    value = None if grade is None else grade_value(section, grade, name)
    if value is None:
        raise InputError(f"vary {key!r}: the scenario gives no {section}.{name}: give it there, or vary it as a whole")
    elements = np.broadcast_to(np.asarray(value, dtype=float), 3)
    return [float(element) for element in elements]


def _inside(owner: Any, part: str, key: str) -> Any:
    """The value named `part` of a section, or element number `part` of a list."""
    if isinstance(owner, list):
        if not part.isdigit() or int(part) >= len(owner):
            raise InputError(f"vary {key!r}: {part!r} is not an element of a list of {len(owner)}, numbered from 0")
        return owner[int(part)]
    if not isinstance(owner, dict):
        raise InputError(f"vary {key!r}: a number has no key {part!r}")
    if part not in owner:
        raise InputError(f"vary {key!r}: no key {part!r}{nearest(part, owner, 'docs/scenario-keys.md')}")
    return owner[part]


def _is_list_of_others(value: Any) -> bool:
    return isinstance(value, list) and not all(isinstance(item, (int, float)) for item in value)


def with_values(scenario: Scenario, data: Mapping[str, Any], values: Mapping[str, Any]) -> Scenario:
    """The scenario with `values`, by dotted key; a section that has no such key is the same object.

    data: the scenario's values, `Scenario.stated`.  Raises `InputError` as `varied` and `parse`; conflicts of a section with
    others are found where the plant is built.
    """
    changed, sections = varied(data, values), sorted({key.split(".")[0] for key in values})
    if "vehicle" in sections and scenario.vehicle.start_values() is not None:  # it sets the start and the duration too
        return parse(changed, scenario.name or "scenario", scenario.name)
    update = {name: validated(type(getattr(scenario, name)), changed[name], name) for name in sections}
    made = scenario.model_copy(update=update)
    made._name = scenario.name
    return made


def check_variations(variations: Sequence[Variation]) -> None:
    """Raise `InputError` for a key that is given twice or cannot be varied."""
    keys = [variation.key for variation in variations]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"vary {key!r}: given more than once")
        if key in FIXED:
            raise InputError(f"vary {key!r}: {FIXED[key]}")
        whole = [other for other in keys if other.startswith(f"{key}.")]
        if whole:
            raise InputError(f"vary {key!r} and {whole[0]!r}: allowed is the whole or its elements")
