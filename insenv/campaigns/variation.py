"""Scenario keys that are drawn from a range for each run, by dotted name: ``imu.gyro_bias_deg_h=-0.01:0.01``."""

from __future__ import annotations

import copy
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from insenv.core import noise
from insenv.errors import InputError, nearest

FIXED = ("seed", "duration_s", "rate_hz")
"""Keys that cannot be varied: all runs of a campaign share them, and the seeds increase by one."""


@dataclass(frozen=True)
class Variation:
    """A dotted key of the scenario (list elements are numbered from 0) and the range of its uniform distribution."""

    key: str
    low: float
    high: float

    def value(self, seed: int) -> float:
        """The value in the run of `seed`: a pure function of seed and key, whatever else varies."""
        stream = zlib.crc32(self.key.encode())
        uniform = float(noise.uniforms(seed, 0, stream, 1)[0])
        return self.low + (self.high - self.low) * uniform


def parse_variation(text: str) -> Variation:
    """Parse ``key=low:high``.  Raises `InputError` for any other form."""
    key, equals, span = text.partition("=")
    low, colon, high = span.partition(":")
    try:
        variation = Variation(key.strip(), float(low), float(high))
    except ValueError:
        equals = ""
    if not (equals and colon and key.strip()):
        raise InputError(f"vary {text!r}: allowed is key=low:high, such as imu.gyro_bias_deg_h=-0.01:0.01")
    if not (math.isfinite(variation.low) and math.isfinite(variation.high) and variation.low <= variation.high):
        raise InputError(f"vary {text!r}: allowed is a range of finite numbers, the lower first")
    return variation


def varied(data: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, Any]:
    """A copy of a scenario's values with `values`, by dotted key, inserted.  Raises `InputError` for an unknown key."""
    changed = copy.deepcopy(dict(data))
    for key, value in values.items():
        *path, last = key.split(".")
        owner: Any = changed
        for done, part in enumerate(path):
            owner = _inside(owner, part, key)
            if owner is None:
                raise InputError(f"vary {key!r}: the scenario has no [{'.'.join(path[: done + 1])}]")
            if path[0] == "estimator" and done == 0:
                owner.setdefault(path[1] if len(path) > 1 else last, {})
        present = None if path[:1] == ["estimator"] else _inside(owner, last, key)
        if isinstance(present, (bool, str, dict)) or _is_list_of_others(present):
            raise InputError(f"vary {key!r}: allowed is a key whose value is a number")
        owner[int(last) if isinstance(owner, list) else last] = value
    return changed


def _inside(owner: Any, part: str, key: str) -> Any:
    """The value named `part` of a section, or element number `part` of a list."""
    if isinstance(owner, list):
        if not part.isdigit() or int(part) >= len(owner):
            raise InputError(f"vary {key!r}: {part!r} is not an element of a list of {len(owner)}, numbered from 0")
        return owner[int(part)]
    if not isinstance(owner, dict):
        raise InputError(f"vary {key!r}: a number has no key {part!r}")
    if part not in owner:
        raise InputError(f"vary {key!r}: no key {part!r}{nearest(part, owner)}")
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
            raise InputError(f"vary {key!r}: all runs of a campaign share it; set it with --seed and --duration")
