"""The numbers of a scenario that could be controls of a page, with their bounds and usual values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel

from insenv.scenario import Scenario

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
