"""Scenario keys that are drawn for each run, by dotted name: ``imu.gyro_bias_deg_h=-0.01:0.01``."""

from __future__ import annotations

import copy
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core import noise
from insenv.scenario.files import grade_value
from insenv.studies.campaign.distributions import Distribution, parse_distribution

FIXED = {
    "seed": "every run has a seed of its own, counted up from the first one (--seed FIRST)",
    "duration_s": "all runs of a campaign share it (--duration S)",
    "rate_hz": "all runs of a campaign share it: set it in the scenario",
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


def variation_of(key: str, given: object) -> Variation:
    """The variation that Python gives: a pair (low, high), a text as of `parse_distribution`, or a `Distribution`."""
    if isinstance(given, Distribution):
        return Variation(key, given)
    if isinstance(given, str):
        return _variation(key, given, lambda: parse_distribution(given))
    try:
        low, high = (float(limit) for limit in given)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise InputError(
            f"vary[{key!r}] = {given!r}: allowed is a pair of numbers, the lower first, or a text such as 'normal(0, 1)'"
        ) from None
    return _variation(key, given, lambda: Distribution("uniform", (low, high)))


def _variation(key: str, given: object, distribution: Callable[[], Distribution]) -> Variation:
    try:
        return Variation(key, distribution())
    except InputError as error:
        raise InputError(f"vary[{key!r}] = {given!r}: {error}") from None


def varied(data: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a scenario's values with `values`, by dotted key, inserted.  Raises `InputError` for an unknown key.

    Grades come first: an element of a vector that the scenario leaves to the grade replaces one of the grade in force.
    """
    changed = copy.deepcopy(dict(data))
    for key in sorted(values, key=lambda key: (not key.endswith(".grade"), key)):
        _insert(changed, key, values[key])
    return changed


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
    found = None if grade is None else grade_value(section, grade, name)
    if found is None:
        raise InputError(f"vary {key!r}: the scenario gives no {section}.{name}: give it there, or vary it as a whole")
    elements = np.broadcast_to(np.asarray(found, dtype=float), 3)
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
        raise InputError(f"vary {key!r}: no key {part!r}{nearest(part, owner, 'docs/scenarios.md')}")
    return owner[part]


def _is_list_of_others(value: Any) -> bool:
    return isinstance(value, list) and not all(isinstance(item, (int, float)) for item in value)


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
