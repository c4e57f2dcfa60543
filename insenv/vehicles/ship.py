"""Ship, moored or under way, that sways about a mean attitude as a sum of sinusoids.

Attitude = mean + sway; the centre of motion is displaced in north, east and down from its mean position (moored) or
track (under way). Regular sway has separate sinusoids for each of the six motions; an irregular sea has sinusoids
common to all six (`insenv.vehicles.waves`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import pi, radians
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
from pydantic import Strict, model_validator

from insenv.base.errors import InputError, nearest
from insenv.base.keys import rows_of
from insenv.base.toml import Number, Section, key, validated
from insenv.base.units import Conversion
from insenv.core.elementary import maximum
from insenv.core.model import Values
from insenv.core.tables import Array, Row, Table
from insenv.vehicles import surroundings
from insenv.vehicles.phasors import Phasors, total, total_rate
from insenv.vehicles.script import Script, Tracker, along_all, derivative_all
from insenv.vehicles.section import (
    MARGIN_MPS,
    MAX_LEGS,
    MAX_WAVES,
    Legs,
    LegSection,
    StartSection,
    StickCommand,
    VehicleSection,
    VehicleTraits,
    fastest,
    in_legs,
    lasting,
    legs_of,
    turning,
)
from insenv.vehicles.truth import PLACES, SineCosine, Vehicle
from insenv.vehicles.waves import Hull, irregular_sea

ANGLES = ("roll", "pitch", "yaw")
DISPLACEMENTS = ("north", "east", "down")
CHANNELS = {**dict.fromkeys(ANGLES, "rad"), **dict.fromkeys(DISPLACEMENTS, "m")}
"""The six motions, with the unit of their amplitudes."""

SCRIPT = Script((
    Row("speed", "Speed over ground along the heading of the track", "m/s", lower=0.0, upper=60.0),
    Row("turn_rate", "Turn rate of the track", "rad/s", lower=-0.5, upper=0.5),
))  # fmt: skip
SHIP_TRAITS = VehicleTraits(
    mavlink_type=11,  # MAV_TYPE_SURFACE_BOAT
    shape="ship",
    floats=True,
    sticks=(
        StickCommand("speed", "SPEED", "Speed", ("z",), 10.0, 340.0, "m/s", one_sided=True),
        StickCommand("turn_rate", "TURN", "Turn rate", ("r", "y"), 3.0, 90.0, "deg/s"),
    ),
)
_SPEED = Tracker(("speed", "speed_rate", "speed_second"), "Speed along the heading of the track", "m/s")
_TURN = Tracker(("turn_rate", "turn_rate_rate", "turn_rate_second"), "Turn rate of the track", "rad/s")


def ship(
    regular: int | Mapping[str, int] = 1,
    wave_components: int = 0,
    under_way: bool = False,
    seeded: bool = False,
    steered_sea: bool = False,
) -> Vehicle:
    """A ship.

    regular: number of sinusoids of each of the six motions, or by motion ("roll", "pitch", "yaw", "north",
    "east", "down").
    wave_components: number of angular frequencies of an irregular sea, common to the six motions, with random phases.
    under_way: whether the ship moves, with commands for speed and turn rate; otherwise it is moored.
    seeded: whether random angles are added to the phases of the regular sinusoids as well.
    steered_sea: of a moored ship: whether commands change the size of its motion and send a wave past it
        (`insenv.vehicles.surroundings`).

    Parameters: ``mean_roll``, ``mean_pitch``, ``start_heading`` (rad); by motion ``<motion>_amplitude`` (rad,
    m), ``<motion>_angular_frequency`` (rad/s), ``<motion>_phase`` (rad) of A sin(w t + phase);
    ``wave_angular_frequency`` and ``wave_<motion>_amplitude``, ``wave_<motion>_phase``; under way
    ``start_speed`` (m/s), ``speed_bandwidth``, ``turn_bandwidth`` (rad/s), ``acceleration_limit`` (m/s^2),
    ``turn_acceleration_limit`` (rad/s^2), ``segments``, ``segments_repeat``.
    """
    counts = dict.fromkeys(CHANNELS, regular) if isinstance(regular, int) else dict(regular)
    banks = tuple(Phasors(name, {name: CHANNELS[name]}, count, seeded) for name, count in counts.items() if count)
    if wave_components:
        banks += (Phasors("wave", CHANNELS, wave_components, seeded=True),)
    heading = Row("start_heading", "Mean heading (moored) or heading of the track (under way) at time 0", "rad")
    parameters = sum((bank.parameters for bank in banks), Table((
        Row("mean_roll", "Mean roll", "rad", lower=-1.5, upper=1.5),
        Row("mean_pitch", "Mean pitch", "rad", lower=-1.5, upper=1.5),
        heading,
    )))  # fmt: skip
    state = sum((bank.state for bank in banks), Table())
    if under_way:
        parameters += _UNDER_WAY_PARAMETERS + SCRIPT.parameters
        state += Table((Row("way_heading", "Heading of the track, not wrapped", "rad"),)) + _SPEED.state + _TURN.state
        state += SCRIPT.state
    if steered_sea:
        parameters, state = parameters + surroundings.PARAMETERS, state + surroundings.STATE

    def start(p: Values, r: Any = None) -> dict[str, Any]:
        rows: dict[str, Any] = {}
        used = 0
        for bank in banks:
            angles_drawn = r[used : used + bank.start_uniforms] if bank.seeded else None
            used += bank.start_uniforms
            rows |= bank.start(p, angles_drawn)
        if under_way:
            rows |= {"way_heading": p.start_heading, "speed": p.start_speed}
            rows |= SCRIPT.start(p, {"speed": p.start_speed})
        return rows

    def hold(p: Values, x: Values, u: Values) -> dict[str, Any]:
        h = p.sample_interval
        return {
            **_SPEED.hold(x, h, maximum(x.commanded_speed, 0.0), p.speed_bandwidth, p.acceleration_limit),
            **_TURN.hold(x, h, x.commanded_turn_rate, p.turn_bandwidth, p.turn_acceleration_limit),
            **SCRIPT.count(p, x),
        }

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        places: list[dict[str, Any]] = [{} for _ in PLACES]
        for bank in banks:
            for rows, moved in zip(places, bank.along(x), strict=True):
                rows.update(moved)
        if under_way:
            for rows, place in zip(places, PLACES, strict=True):
                t = place * p.sample_interval
                rows.update(along_all((_SPEED, _TURN), x, t))
                rows["way_heading"] = x.way_heading + _TURN.integral(x, t)
        if steered_sea:
            for rows, place in zip(places, PLACES, strict=True):
                rows.update(surroundings.along(x, place * p.sample_interval))
        return places

    def derivative(p: Values, x: Values) -> dict[str, Any]:
        rates = {name: rate for bank in banks for name, rate in bank.derivative(p, x).items()}
        if under_way:
            rates |= {**derivative_all((_SPEED, _TURN), x), "way_heading": x.turn_rate}
        return {**rates, **surroundings.derivative(x)} if steered_sea else rates

    def angles(p: Values, x: Values) -> list[Any]:
        way = x.way_heading if under_way else p.start_heading
        mean = dict(zip(ANGLES, (p.mean_roll, p.mean_pitch, way), strict=True))
        sway = [total(banks, x, channel) for channel in ANGLES]
        sway = surroundings.angles(p, x, sway) if steered_sea else sway
        attitude = [mean[channel] + angle for channel, angle in zip(ANGLES, sway, strict=True)]
        return [*attitude, way] if under_way else attitude

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        displaced = ca.vertcat(*[total_rate(banks, p, x, channel) for channel in DISPLACEMENTS])
        if steered_sea:
            return surroundings.velocity(x, ca.vertcat(*[total(banks, x, channel) for channel in DISPLACEMENTS]), displaced)
        if not under_way:
            return displaced
        sine, cosine = pairs[3]
        return displaced + ca.vertcat(x.speed * cosine, x.speed * sine, 0.0)

    return Vehicle(
        id="ship",
        title="Ship under way" if under_way else "Moored ship",
        parameters=parameters,
        state=state,
        along=along,
        derivative=derivative,
        angles=angles,
        velocity_n=velocity_n,
        start=start,
        start_uniforms=sum(bank.start_uniforms for bank in banks),
        hold=hold if under_way else surroundings.hold if steered_sea else None,
        inputs=SCRIPT.inputs if under_way else surroundings.INPUTS if steered_sea else Table(),
        steps=SCRIPT.steps if under_way else {},
    )


_UNDER_WAY_PARAMETERS = Table((
    Row("start_speed", "Speed along the heading of the track at time 0", "m/s", lower=0.0, upper=60.0),
    Row("speed_bandwidth", "Bandwidth of the speed loop", "rad/s", start=0.1, lower=1e-3, upper=10.0),
    Row("turn_bandwidth", "Bandwidth of the turn-rate loop", "rad/s", start=0.3, lower=1e-3, upper=10.0),
    Row("acceleration_limit", "Largest acceleration along the track", "m/s^2", start=0.3, lower=1e-6, upper=10.0),
    Row("turn_acceleration_limit", "Largest angular acceleration of the track", "rad/s^2", start=0.02, lower=1e-6, upper=10.0),
))  # fmt: skip


# The section [vehicle] of a ship: regular sway, irregular sea, course.


@lru_cache(maxsize=64)
def _ship(
    counts: tuple[tuple[str, int], ...], wave_components: int, under_way: bool, seeded: bool, steered_sea: bool
) -> Vehicle:
    return ship(dict(counts), wave_components, under_way, seeded, steered_sea)


class _Wave(Section):
    """One sinusoid A sin(2 pi t / period + phase) of the motion ``{}``."""

    period_s: Number | None = key(
        None, "period", "s", row="{}_angular_frequency", convert=Conversion("inverse", 2.0 * pi), gt=0, le=1e5
    )
    frequency_hz: Number | None = key(None, "frequency, instead of the period", "Hz", row="{}_angular_frequency", gt=0, le=5e3)
    phase_deg: Number = key(
        0.0, "phase at time 0", "deg", row="{}_phase", convert=Conversion("degrees", 180.0), ge=-360, le=360
    )

    @model_validator(mode="after")
    def _one_of_two(self) -> _Wave:
        if (self.period_s is None) == (self.frequency_hz is None):
            raise ValueError("needs either period_s [s] or frequency_hz [Hz]")
        return self


class AngleWave(_Wave):
    """One sinusoid of an angle."""

    amplitude_deg: Number = key(..., "amplitude", "deg", row="{}_amplitude", ge=0, le=80)


class LengthWave(_Wave):
    """One sinusoid of a displacement."""

    amplitude_m: Number = key(..., "amplitude", "m", row="{}_amplitude", ge=0, le=100)


def regular_sway(motions: Sequence[Mapping[str, Any]]) -> tuple[dict[str, int], dict[str, list[float]]]:
    """The argument `regular` of `ship`, and its parameters, from sinusoids A sin(2 pi t / period + phase) such as::

        [{"motion": "roll", "amplitude_deg": 10, "period_s": 8},
         {"motion": "down", "amplitude_m": 1, "frequency_hz": 0.125, "phase_deg": 90}]

    The other keys are those of `AngleWave` and `LengthWave`. Raises `InputError` naming the sinusoid, the key and what is
    allowed.
    """
    waves: dict[str, list[_Wave]] = {}
    for number, motion in enumerate(motions, 1):
        name = motion.get("motion")
        if name not in CHANNELS:
            raise InputError(f"sway {number}: motion = {name!r}{nearest(str(name), CHANNELS)}")
        kind: type[_Wave] = AngleWave if name in ANGLES else LengthWave
        stated = {key: value for key, value in motion.items() if key != "motion"}
        waves.setdefault(name, []).append(validated(kind, stated, f"sway {number}"))
    return _sway_rows(waves)


def _sway_rows(waves: Mapping[str, Sequence[_Wave]]) -> tuple[dict[str, int], dict[str, list[float]]]:
    """Number of sinusoids by motion, in the order of `CHANNELS`, and the rows of their parameters."""
    rows: dict[str, list[float]] = {}
    for name, several in waves.items():
        for wave in several:
            for row, value in rows_of(wave, name).items():
                rows.setdefault(row, []).append(value)
    return {name: len(waves[name]) for name in CHANNELS if waves.get(name)}, rows


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


SEA_STATES = {
    "sea state 2": {"significant_height_m": 0.3, "peak_period_s": 6.3},
    "sea state 3": {"significant_height_m": 0.88, "peak_period_s": 7.5},
    "sea state 4": {"significant_height_m": 1.88, "peak_period_s": 8.8},
    "sea state 5": {"significant_height_m": 3.25, "peak_period_s": 9.7},
    "sea state 6": {"significant_height_m": 5.0, "peak_period_s": 12.4},
}
"""Most probable in the North Atlantic: Bales, "Designing ships to the natural environment", Naval Engineers J. 95 (1983)."""


class ShipLeg(LegSection):
    """One leg of a course: exactly one of speed_mps, turn_deg, hold_s."""

    kinds: ClassVar[tuple[str, ...]] = ("speed_mps", "turn_deg", "hold_s")

    speed_mps: Number | None = key(None, "go straight on and change to this speed in duration_s", "m/s", ge=0, le=60)
    turn_deg: Number | None = turning("turn by this angle in duration_s, right positive", SCRIPT.fastest_deg("turn_rate"))
    hold_s: Number | None = lasting("go straight on for this time")
    duration_s: Number | None = lasting("duration of the leg")


def ship_course(legs: Legs, start_speed_mps: float = 0.0) -> Array:
    """Segments of ``ship(under_way=True)`` from legs, each a `ShipLeg` or its values, such as ``[{"speed_mps": 8,
    "duration_s": 300}, {"turn_deg": 90, "duration_s": 120}, {"hold_s": 600}]``.

    Raises `InputError` naming the leg, the key and what is allowed.
    """
    speed, segments = start_speed_mps, []
    for where, leg, kind, value in legs_of(ShipLeg, legs):
        duration = value if kind == "hold_s" else leg.duration_s
        if duration is None:
            raise InputError(f"{where}: {kind} needs duration_s")
        speed = value if kind == "speed_mps" else speed
        rate = SCRIPT.turn_rate(where, "turn_rate", leg.turn_deg or 0.0, duration)
        segments.append({"duration": duration, "speed": speed, "turn_rate": rate})
    return SCRIPT.table(segments)


class ShipSection(VehicleSection):
    """A ship: under way if it has legs or a start speed, otherwise moored."""

    traits: ClassVar[VehicleTraits] = SHIP_TRAITS
    presets: ClassVar[Mapping[str, Mapping[str, Mapping[str, float]]]] = {"sea": SEA_STATES}

    kind: Literal["ship"] = key(..., "kind of vehicle")
    sway: SwaySection | None = key(None, "regular sway; not together with sea")
    random_phases: bool = key(False, "add random phases, drawn from the seed, to those of the sway", strict=True)
    sea: SeaSection | None = key(None, "irregular sea; not together with sway")
    steered_sea: bool = key(
        False, "whether commands change the size of a moored ship's motion and send a wave past it; pages use it", strict=True
    )
    start_speed_mps: Number = key(0.0, "speed along the heading at time 0", "m/s", row=_UNDER_WAY_PARAMETERS["start_speed"])
    legs: tuple[ShipLeg, ...] = key((), "the course, leg by leg", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", row="segments_repeat", strict=True)

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
        return _sway_rows(vars(self.sway or SwaySection()))

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
            segments = in_legs(lambda: ship_course(self.legs, self.start_speed_mps))
            rows |= {**rows_of(self), "segments": segments}
        return rows
