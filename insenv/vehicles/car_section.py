"""The section [vehicle] of a car: engine, wind, load, drive."""

from __future__ import annotations

from functools import lru_cache
from math import radians
from typing import Any, ClassVar, Literal

from insenv.base.toml import Number, Section, key
from insenv.vehicles.car import CAR_TRAITS, car
from insenv.vehicles.routes import car_route
from insenv.vehicles.section import (
    MARGIN_MPS,
    MAX_LEGS,
    Engine,
    StartSection,
    VehicleSection,
    dumped,
    engine_rows,
    fastest,
    in_legs,
)
from insenv.vehicles.traits import VehicleTraits
from insenv.vehicles.truth import Vehicle


@lru_cache(maxsize=16)
def _car(engine_components: int) -> Vehicle:
    return car(engine_components)


class CarLeg(Section):
    """One leg of a drive: exactly one of accelerate_to_mps, drive_s, turn_deg, stop_s, wait_s."""

    accelerate_to_mps: Number | None = key(
        None, "change to this speed; the leg ends when it is reached, or after duration_s", "m/s", ge=0, le=100
    )
    drive_s: Number | None = key(None, "drive straight on for this time", "s", gt=0, le=86400)
    turn_deg: Number | None = key(
        None, "turn by this angle, right positive, with duration_s or radius_m", "deg", ge=-3600, le=3600
    )
    stop_s: Number | None = key(None, "brake, then stand for this time", "s", gt=0, le=86400)
    wait_s: Number | None = key(None, "keep speed and direction for this time", "s", gt=0, le=86400)
    duration_s: Number | None = key(None, "duration of the turn or of the change of speed", "s", gt=0, le=86400)
    radius_m: Number | None = key(None, "radius of the turn", "m", gt=0, le=1e6)
    acceleration_mps2: Number | None = key(None, "largest acceleration, from this leg on (initially 2)", "m/s2", gt=0, le=15)
    grade_percent: Number | None = key(None, "slope of the road, from this leg on", "%", ge=-40, le=40)
    load_roll_deg: Number | None = key(None, "roll due to the load, from this leg on", "deg", ge=-10, le=10)
    load_pitch_deg: Number | None = key(None, "pitch due to the load, from this leg on", "deg", ge=-10, le=10)
    load_down_m: Number | None = key(None, "displacement down due to the load, from this leg on", "m", ge=-0.2, le=0.2)


class CarSection(VehicleSection):
    """A car: parked if its legs only wait, otherwise driving."""

    traits: ClassVar[VehicleTraits] = CAR_TRAITS

    kind: Literal["car"] = key(..., "kind of vehicle")
    engine: Engine = key((), "the engine's vibration")
    wind_roll_sigma_deg: Number = key(0.0, "roll due to wind, standard deviation", "deg", ge=0, le=5)
    wind_pitch_sigma_deg: Number = key(0.0, "pitch due to wind, standard deviation", "deg", ge=0, le=5)
    wind_correlation_s: Number = key(3.0, "correlation time of the wind", "s", ge=0.01, le=1e6)
    start_speed_mps: Number = key(0.0, "speed along the heading at time 0", "m/s", ge=0, le=100)
    legs: tuple[CarLeg, ...] = key((), "the drive, leg by leg; a parked car only waits", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", strict=True)

    @property
    def in_place(self) -> bool:
        """Whether it is parked."""
        return self.start_speed_mps == 0.0 and all(leg.wait_s is not None for leg in self.legs)

    @property
    def fastest_mps(self) -> float:
        """A speed over the ground that it does not exceed, unless it is steered."""
        return fastest(self.start_speed_mps, self.legs, "accelerate_to_mps") + MARGIN_MPS

    def vehicle(self) -> Vehicle:
        """Equations of motion."""
        return _car(max(1, len(self.engine)))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        return {
            **engine_rows(self.engine),
            "wind_roll_sigma": radians(self.wind_roll_sigma_deg),
            "wind_pitch_sigma": radians(self.wind_pitch_sigma_deg),
            "wind_time_constant": self.wind_correlation_s,
            "start_speed": self.start_speed_mps,
            "segments": in_legs(lambda: car_route(dumped(self.legs), self.start_speed_mps)),
            "segments_repeat": float(self.repeat_legs),
        }
