"""The section [vehicle] of a ship: regular sway, irregular sea, course."""

from __future__ import annotations

from functools import lru_cache
from math import radians
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Strict, model_validator

from insenv.base.toml import Number, Section, key
from insenv.vehicles import surroundings
from insenv.vehicles.routes import ship_course
from insenv.vehicles.section import MARGIN_MPS, MAX_LEGS, MAX_WAVES, StartSection, VehicleSection, dumped, fastest, in_legs
from insenv.vehicles.ship import SHIP_TRAITS, regular_sway, ship
from insenv.vehicles.traits import StickCommand, VehicleTraits
from insenv.vehicles.truth import Vehicle
from insenv.vehicles.waves import Hull, irregular_sea


@lru_cache(maxsize=64)
def _ship(
    counts: tuple[tuple[str, int], ...], wave_components: int, under_way: bool, seeded: bool, steered_sea: bool
) -> Vehicle:
    return ship(dict(counts), wave_components, under_way, seeded, steered_sea)


class _Wave(Section):
    """One sinusoid A sin(2 pi t / period + phase)."""

    period_s: Number | None = key(None, "period", "s", gt=0, le=1e5)
    frequency_hz: Number | None = key(None, "frequency, instead of the period", "Hz", gt=0, le=5e3)
    phase_deg: Number = key(0.0, "phase at time 0", "deg", ge=-360, le=360)

    @model_validator(mode="after")
    def _one_of_two(self) -> _Wave:
        if (self.period_s is None) == (self.frequency_hz is None):
            raise ValueError("needs either period_s [s] or frequency_hz [Hz]")
        return self


class AngleWave(_Wave):
    """One sinusoid of an angle."""

    amplitude_deg: Number = key(..., "amplitude", "deg", ge=0, le=80)


class LengthWave(_Wave):
    """One sinusoid of a displacement."""

    amplitude_m: Number = key(..., "amplitude", "m", ge=0, le=100)


_AngleWaves = tuple[AngleWave, ...]
_LengthWaves = tuple[LengthWave, ...]


class SwaySection(Section):
    """Regular sway: a list of sinusoids for each motion."""

    roll: _AngleWaves = key((), "roll about the mean", max_length=MAX_WAVES)
    pitch: _AngleWaves = key((), "pitch about the mean", max_length=MAX_WAVES)
    yaw: _AngleWaves = key((), "yaw about the heading", max_length=MAX_WAVES)
    north: _LengthWaves = key((), "displacement north of the centre of motion", max_length=MAX_WAVES)
    east: _LengthWaves = key((), "displacement east", max_length=MAX_WAVES)
    down: _LengthWaves = key((), "displacement down", max_length=MAX_WAVES)


class HullSection(Section):
    """The hull, which determines the ship's response to waves."""

    length_m: Number = key(100.0, "length", "m", gt=1, le=500)
    beam_m: Number = key(16.0, "beam", "m", gt=0.3, le=100)
    draught_m: Number = key(5.0, "draught", "m", gt=0.1, le=50)
    roll_period_s: Number = key(11.0, "natural period of roll", "s", gt=1, le=60)
    roll_damping: Number = key(0.12, "damping ratio of roll", "", gt=0.005, le=2)


class SeaSection(Section):
    """An irregular sea (JONSWAP spectrum) and the ship's response; phases are drawn from the seed."""

    significant_height_m: Number = key(..., "significant wave height", "m", gt=0, le=20)
    peak_period_s: Number = key(..., "period of the spectrum's peak", "s", ge=1, le=30)
    direction_deg: Number = key(0.0, "direction in which the waves travel, clockwise from north", "deg", ge=-360, le=360)
    enhancement: Number = key(3.3, "peak enhancement; 1 is a fully developed sea (Pierson-Moskowitz)", "", ge=1, le=7)
    components: Annotated[int, Strict()] = key(24, "number of waves that represent the spectrum", "", ge=1, le=64)
    hull: HullSection = key(HullSection(), "the ship's hull")


class ShipLeg(Section):
    """One leg of a course: exactly one of speed_mps, turn_deg, hold_s."""

    speed_mps: Number | None = key(None, "go straight on and change to this speed in duration_s", "m/s", ge=0, le=60)
    turn_deg: Number | None = key(None, "turn by this angle in duration_s, right positive", "deg", ge=-3600, le=3600)
    hold_s: Number | None = key(None, "go straight on for this time", "s", gt=0, le=86400)
    duration_s: Number | None = key(None, "duration of the leg", "s", gt=0, le=86400)


class ShipSection(VehicleSection):
    """A ship: under way if it has legs or a start speed, otherwise moored."""

    traits: ClassVar[VehicleTraits] = SHIP_TRAITS

    kind: Literal["ship"] = key(..., "kind of vehicle")
    sway: SwaySection | None = key(None, "regular sway; not together with sea")
    random_phases: bool = key(False, "add random phases, drawn from the seed, to those of the sway", strict=True)
    sea: SeaSection | None = key(None, "irregular sea; not together with sway")
    steered_sea: bool = key(
        False, "whether commands change the size of a moored ship's motion and send a wave past it; pages use it", strict=True
    )
    start_speed_mps: Number = key(0.0, "speed along the heading at time 0", "m/s", ge=0, le=60)
    legs: tuple[ShipLeg, ...] = key((), "the course, leg by leg", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", strict=True)

    @model_validator(mode="after")
    def _one_motion(self) -> ShipSection:
        if self.sway is not None and self.sea is not None:
            raise ValueError("has both sway and sea: allowed is one of them")
        return self

    @property
    def _steered(self) -> bool:
        return self.steered_sea and self.in_place

    @property
    def in_place(self) -> bool:
        """Whether it is moored."""
        return not self.legs and self.start_speed_mps == 0.0

    @property
    def sticks(self) -> tuple[StickCommand, ...]:
        """Those of a ship under way, or of the surroundings of a moored one."""
        return surroundings.STICKS if self.in_place else self.traits.sticks

    def steerable(self) -> ShipSection:
        """A moored ship whose surroundings commands can change."""
        return self.model_copy(update={"steered_sea": True}) if self.in_place else self

    def _regular(self) -> tuple[dict[str, int], dict[str, list[float]]]:
        sway = self.sway or SwaySection()
        waves = ((name, wave) for name in SwaySection.model_fields for wave in getattr(sway, name))
        return regular_sway([{"motion": name, **wave.model_dump(exclude_none=True)} for name, wave in waves])

    @property
    def fastest_mps(self) -> float:
        """A speed over the ground that it does not exceed, unless it is steered."""
        return fastest(self.start_speed_mps, self.legs, "speed_mps") + MARGIN_MPS

    def vehicle(self) -> Vehicle:
        """Equations of motion."""
        counts, _ = self._regular()
        components = self.sea.components if self.sea else 0
        return _ship(tuple(counts.items()), components, not self.in_place, self.random_phases and bool(counts), self._steered)

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        rows: dict[str, Any] = dict(self._regular()[1])
        if self.sea is not None:
            hull = self.sea.hull
            rows |= irregular_sea(
                self.sea.significant_height_m,
                self.sea.peak_period_s,
                self.sea.components,
                hull=Hull(hull.length_m, hull.beam_m, hull.draught_m, hull.roll_period_s, hull.roll_damping),
                wave_direction=radians(self.sea.direction_deg),
                heading=radians(start.heading_deg),
                speed=self.start_speed_mps,
                enhancement=self.sea.enhancement,
            )
        if not self.in_place:
            segments = in_legs(lambda: ship_course(dumped(self.legs), self.start_speed_mps))
            rows |= {"start_speed": self.start_speed_mps, "segments": segments, "segments_repeat": float(self.repeat_legs)}
        return rows
