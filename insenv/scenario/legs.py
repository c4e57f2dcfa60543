"""What the vehicles of a scenario have in common: legs, an engine's vibration."""

from __future__ import annotations

from collections.abc import Callable
from math import pi, radians
from typing import Annotated, Any, TypeVar

from pydantic import Field

from insenv.errors import InputError
from insenv.files.toml import Number, Section, key

Structure = tuple[Any, ...]
"""What of a vehicle its equations depend on, hashable: scenarios of equal structure share one compiled model."""

MAX_WAVES = 16
MAX_LEGS = 64

Made = TypeVar("Made")


def dumped(legs: tuple[Section, ...]) -> list[dict[str, float]]:
    """The keys that each leg has."""
    return [leg.model_dump(exclude_none=True) for leg in legs]


def in_legs(make: Callable[[], Made]) -> Made:
    """What `make` makes of the legs; an error says that it is in them."""
    try:
        return make()
    except InputError as error:
        raise InputError(f"vehicle.legs: {error}") from None


class EngineWave(Section):
    """One frequency of an engine's vibration."""

    frequency_hz: Number = key(..., "its frequency, below half the sample rate", "Hz", gt=0, le=5e3)
    roll_deg: Number = key(0.0, "amplitude of roll", "deg", ge=0, le=5)
    pitch_deg: Number = key(0.0, "amplitude of pitch", "deg", ge=0, le=5)
    down_m: Number = key(0.0, "amplitude of the displacement down", "m", ge=0, le=0.1)
    roll_phase_deg: Number = key(0.0, "phase of roll at time 0", "deg", ge=-360, le=360)
    pitch_phase_deg: Number = key(0.0, "phase of pitch at time 0", "deg", ge=-360, le=360)
    down_phase_deg: Number = key(0.0, "phase of the displacement at time 0", "deg", ge=-360, le=360)


Engine = Annotated[tuple[EngineWave, ...], Field(max_length=MAX_WAVES)]


def engine_rows(engine: tuple[EngineWave, ...]) -> dict[str, Any]:
    """Parameter rows of the vibration, SI; without an engine one still frequency."""
    waves = engine or (EngineWave(frequency_hz=1.0),)
    rows: dict[str, Any] = {"engine_angular_frequency": [2.0 * pi * wave.frequency_hz for wave in waves]}
    for channel, amplitude in (("roll", "roll_deg"), ("pitch", "pitch_deg"), ("down", "down_m")):
        scale = 1.0 if channel == "down" else pi / 180.0
        rows[f"engine_{channel}_amplitude"] = [scale * getattr(wave, amplitude) for wave in waves]
        rows[f"engine_{channel}_phase"] = [radians(getattr(wave, f"{channel}_phase_deg")) for wave in waves]
    return rows
