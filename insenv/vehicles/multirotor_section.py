"""The section [vehicle] of a multirotor: rotors, gusts, flight."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import radians
from typing import Any, ClassVar, Literal

from insenv.base.errors import InputError
from insenv.base.toml import Number, Section, key
from insenv.vehicles.multirotor import MULTIROTOR_TRAITS, SCRIPT, multirotor
from insenv.vehicles.section import MAX_LEGS, Engine, GustsSection, StartSection, fastest, in_legs
from insenv.vehicles.traits import VehicleTraits
from insenv.vehicles.truth import Vehicle


@lru_cache(maxsize=16)
def _multirotor(rotor_components: int) -> Vehicle:
    return multirotor(rotor_components)


class MultirotorLeg(Section):
    """One leg of a flight: exactly one of hover_s, fly_s, turn_deg."""

    hover_s: Number | None = key(None, "stay for this time", "s", gt=0, le=86400)
    fly_s: Number | None = key(None, "fly for this time with forward_mps, right_mps and climb_mps", "s", gt=0, le=86400)
    turn_deg: Number | None = key(
        None,
        "turn by this angle, right positive, over duration_s, with the velocities of the leg before",
        "deg",
        ge=-3600,
        le=3600,
    )
    duration_s: Number | None = key(None, "duration of the turn", "s", gt=0, le=86400)
    forward_mps: Number | None = key(None, "velocity along the heading; 0 if absent", "m/s", ge=-50, le=50)
    right_mps: Number | None = key(None, "velocity to the right of the heading; 0 if absent", "m/s", ge=-50, le=50)
    climb_mps: Number | None = key(None, "rate of climb; 0 if absent", "m/s", ge=-20, le=20)


class MultirotorSection(GustsSection):
    """A multirotor, in the air from time 0 on; without legs it hovers."""

    traits: ClassVar[VehicleTraits] = MULTIROTOR_TRAITS

    kind: Literal["multirotor"] = key(..., "kind of vehicle")
    engine: Engine = key((), "the rotors' vibration")
    gust_correlation_s: Number = key(2.0, "correlation time of the gusts", "s", ge=0.01, le=1e6)
    legs: tuple[MultirotorLeg, ...] = key((), "the flight, leg by leg", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", strict=True)

    @property
    def in_place(self) -> bool:
        """False: gusts move it by more than metres."""
        return False

    @property
    def fastest_mps(self) -> float:
        """A speed over the ground that it does not exceed, unless it is steered."""
        return fastest(0.0, self.legs, "forward_mps", "right_mps") + self.gusting_mps

    def vehicle(self) -> Vehicle:
        """Equations of motion."""
        return _multirotor(max(1, len(self.engine)))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        return {
            **self.air_rows(),
            "segments": in_legs(lambda: SCRIPT.table(flight(self.legs))),
            "segments_repeat": float(self.repeat_legs),
        }


def flight(legs: Sequence[MultirotorLeg]) -> list[dict[str, float]]:
    """Segments of the script from legs.  Raises `InputError` naming the leg, the key and what is allowed.

    The yaw rate follows its command as a linear system with the gain 1: the angle turned is that of the command.
    """
    velocity = {"forward": 0.0, "right": 0.0, "climb_rate": 0.0}
    segments = []
    for number, leg in enumerate(legs, 1):
        given = {name: value for name, value in leg.model_dump().items() if value is not None}
        kinds = [name for name in ("hover_s", "fly_s", "turn_deg") if name in given]
        if len(kinds) != 1:
            raise InputError(
                f"leg {number} has {' and '.join(kinds) or 'none'}: allowed is exactly one of hover_s, fly_s, turn_deg"
            )
        kind = kinds[0]
        fitting = {"hover_s": set(), "fly_s": {"forward_mps", "right_mps", "climb_mps"}, "turn_deg": {"duration_s"}}[kind]
        for name in given:
            if name != kind and name not in fitting:
                raise InputError(
                    f"leg {number}: {name} does not go with {kind}: allowed is {', '.join(sorted(fitting)) or 'nothing'}"
                )
        if kind == "turn_deg":
            if "duration_s" not in given:
                raise InputError(f"leg {number}: turn_deg needs duration_s")
            rate = radians(given[kind]) / given["duration_s"]
            segments.append({"duration": given["duration_s"], **velocity, "yaw_rate": rate})
            continue
        names = (("forward", "forward_mps"), ("right", "right_mps"), ("climb_rate", "climb_mps"))
        velocity = {row: given.get(name, 0.0) for row, name in names}
        segments.append({"duration": given[kind], **velocity, "yaw_rate": 0.0})
    return segments
