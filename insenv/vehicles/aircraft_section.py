"""The section [vehicle] of an aircraft: engine, gusts, flight."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import radians
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Strict

from insenv.base.errors import InputError
from insenv.base.toml import Number, Section, key
from insenv.vehicles.aircraft import AIRCRAFT_TRAITS, aircraft
from insenv.vehicles.routes import flight_plan, survey_pattern
from insenv.vehicles.section import MAX_LEGS, GustsSection, StartSection, dumped, fastest, in_legs
from insenv.vehicles.traits import VehicleTraits
from insenv.vehicles.truth import Vehicle


@lru_cache(maxsize=16)
def _aircraft(engine_components: int) -> Vehicle:
    return aircraft(engine_components)


class AircraftLeg(Section):
    """One leg of a flight: exactly one of wait_s, fly_s, line_m, speed_mps, climb_to_m, turn_deg, survey_lines."""

    wait_s: Number | None = key(None, "keep speed and direction for this time", "s", gt=0, le=86400)
    fly_s: Number | None = key(None, "go straight on for this time", "s", gt=0, le=86400)
    line_m: Number | None = key(None, "go straight on for this distance over ground", "m", gt=0, le=1e7)
    speed_mps: Number | None = key(None, "change to this speed; the leg ends when it is reached", "m/s", ge=0, le=340)
    climb_to_m: Number | None = key(None, "climb or descend to this height above the ellipsoid", "m", ge=-1000, le=50000)
    turn_deg: Number | None = key(None, "coordinated turn by this angle, right positive", "deg", ge=-3600, le=3600)
    survey_lines: Annotated[int, Strict()] | None = key(
        None, "number of parallel lines of length line_m, with half turns between them, the first to the right", "", ge=1, le=32
    )
    acceleration_mps2: Number | None = key(None, "largest acceleration, from this leg on (initially 2.5)", "m/s2", gt=0, le=30)
    climb_mps: Number | None = key(None, "rate of climb; 5 if absent", "m/s", gt=0, le=100)
    bank_deg: Number | None = key(None, "bank angle of the turn; 20 if absent", "deg", gt=0, le=45)


class AircraftSection(GustsSection):
    """An aircraft: parked if its legs only wait, otherwise moving."""

    traits: ClassVar[VehicleTraits] = AIRCRAFT_TRAITS

    kind: Literal["aircraft"] = key(..., "kind of vehicle")
    angle_of_attack_deg: Number = key(2.0, "pitch above the flight path in the air", "deg", ge=-15, le=15)
    take_off_speed_mps: Number = key(45.0, "speed above which it flies", "m/s", ge=1, le=200)
    start_speed_mps: Number = key(0.0, "speed at time 0; in the air if above the take-off speed", "m/s", ge=0, le=340)
    legs: tuple[AircraftLeg, ...] = key((), "the flight, leg by leg; a parked aircraft only waits", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", strict=True)

    @property
    def in_place(self) -> bool:
        """Whether it is parked."""
        return self.start_speed_mps == 0.0 and all(leg.wait_s is not None for leg in self.legs)

    @property
    def fastest_mps(self) -> float:
        """A speed over the ground that it does not exceed, unless it is steered."""
        return fastest(self.start_speed_mps, self.legs, "speed_mps") + self.gusting_mps

    def vehicle(self) -> Vehicle:
        """Equations of motion."""
        return _aircraft(max(1, len(self.engine)))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        return {
            **self.air_rows(),
            "angle_of_attack": radians(self.angle_of_attack_deg),
            "take_off_speed": self.take_off_speed_mps,
            "start_speed": self.start_speed_mps,
            "segments": in_legs(lambda: flight_plan(self._plan(), self.start_speed_mps, start.height_m)),
            "segments_repeat": float(self.repeat_legs),
        }

    def _plan(self) -> list[Mapping[str, float]]:
        """The legs, with each survey as its lines and turns."""
        plan: list[Mapping[str, float]] = []
        for number, leg in enumerate(dumped(self.legs), 1):
            if "survey_lines" not in leg:
                plan.append(leg)
            elif set(leg) - {"survey_lines", "line_m", "bank_deg"} or "line_m" not in leg:
                raise InputError(f"leg {number}: survey_lines needs line_m; of the other keys only bank_deg is allowed")
            else:
                plan += survey_pattern(int(leg["survey_lines"]), leg["line_m"], leg.get("bank_deg", 20.0))
        return plan
