"""Aircraft: parked in gusts, taxiing, taking off, climbing, on straight lines and in coordinated turns, by script or
command.

The track turns at the rate of a coordinated turn, g tan(bank) / V, exact at the end of every sample and linear in
between, so that the heading is a polynomial within a sample. On the ground the same command steers and the wings stay
level. Turbulence is a small Gauss-Markov disturbance of attitude and velocity.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import pi, radians, tan
from types import SimpleNamespace
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
from pydantic import Strict

from insenv.base.errors import InputError
from insenv.base.toml import Number, key
from insenv.core.elementary import clamp, maximum, select, sin_cos
from insenv.core.model import Values
from insenv.core.tables import Array, Row, Table
from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles.car import climb_angle
from insenv.vehicles.script import Script, Tracker, along_all
from insenv.vehicles.scripted import AIR_GUSTS, engine_phasors, scripted
from insenv.vehicles.section import (
    MAX_LEGS,
    Actions,
    GustsSection,
    Legs,
    LegSection,
    StartSection,
    StickCommand,
    VehicleTraits,
    action,
    fastest,
    in_legs,
    lasting,
    of_kinds,
    placed,
    turning,
)
from insenv.vehicles.truth import SineCosine, Vehicle

SLOW = 5.0
"""Speed (m/s) below which the turn rate falls with the speed, to zero at rest."""

SCRIPT = Script((
    Row("speed", "Speed to reach, horizontal, over ground", "m/s", lower=0.0, upper=340.0),
    Row("acceleration", "Largest acceleration towards this speed", "m/s^2", start=2.5, lower=0.0, upper=30.0),
    Row("bank", "Bank of the turn, right wing down; on the ground it steers the same turn rate", "rad", lower=-1.2, upper=1.2),
    Row("climb_rate", "Rate of climb, in the air", "m/s", lower=-100.0, upper=100.0),
))  # fmt: skip

AGENT_ACCELERATION = 2.5
"""m/s^2, along the path, by a full action of an agent."""
AGENT_SPEEDS = (60.0, 120.0)
"""Lowest and highest speed that an agent reaches, m/s."""
AGENT_BANK = 0.7
"""Bank by a full action, rad (40 deg)."""
AGENT_CLIMB = 10.0
"""Rate of climb by a full action, m/s."""


def _commands(x: Any, action: Any) -> dict[str, Any]:
    along = clamp(action.accelerate, -1.0, 1.0)
    return {
        "speed": select(along > 0.0, AGENT_SPEEDS[1], AGENT_SPEEDS[0]),
        "acceleration": ca.fabs(along) * AGENT_ACCELERATION,
        "bank": clamp(action.bank, -1.0, 1.0) * AGENT_BANK,
        "climb_rate": clamp(action.climb, -1.0, 1.0) * AGENT_CLIMB,
    }


AIRCRAFT_TRAITS = VehicleTraits(
    mavlink_type=1,  # MAV_TYPE_FIXED_WING
    shape="aircraft",
    flies=True,
    airspeed=True,
    sticks=(
        StickCommand("speed", "SPEED", "Speed", ("z",), 80.0, 340.0, "m/s", one_sided=True, released=None),
        StickCommand("bank", "BANK", "Bank", ("y",), 30.0, 60.0, "deg"),
        StickCommand("climb_rate", "CLIMB", "Climb rate", ("x",), 5.0, 100.0, "m/s", sign=-1.0),
    ),
    parks=True,
    actions=Actions(
        Table((
            action("accelerate", f"Acceleration along the path, in {AGENT_ACCELERATION:g} m/s^2"),
            action("bank", f"Bank of a coordinated turn, positive to the right, in {AGENT_BANK:g} rad"),
            action("climb", f"Rate of climb, in {AGENT_CLIMB:g} m/s"),
        )),
        _commands,
        (70.0, 110.0),
    ),
)  # fmt: skip

_SPEED = Tracker(("speed", "speed_rate", "speed_second"), "Horizontal speed over ground", "m/s")
BANK = Tracker(("bank", "bank_rate", "bank_second"), "Bank of the turn", "rad")
_SLOPE = Tracker(("slope", "slope_rate", "slope_second"), "Slope of the path, climb over horizontal distance", "1")
_AIRBORNE = Tracker(
    ("airborne", "airborne_rate", "airborne_second"), "Share of the weight on the wings, 0 on the ground to 1", "1"
)
_TRACKERS = (_SPEED, BANK, _SLOPE, _AIRBORNE)
_TRACK = Table((
    Row("track", "Heading of the path, not wrapped", "rad"),
    Row("turn_rate", "Rate of the track", "rad/s"),
    Row("turn_acceleration", "Second time derivative of the track, held over a sample", "rad/s^2"),
))  # fmt: skip

PARAMETERS = Table((
    Row("mean_roll", "Roll at rest", "rad", lower=-0.5, upper=0.5),
    Row("mean_pitch", "Pitch at rest", "rad", lower=-0.5, upper=0.5),
    Row("angle_of_attack", "Pitch above the path in the air", "rad", start=0.035, lower=-0.3, upper=0.3),
    Row("start_heading", "Heading at time 0", "rad"),
    Row("start_speed", "Speed at time 0; above the take-off speed the aircraft is in the air", "m/s", lower=0.0, upper=340.0),
    Row("take_off_speed", "Speed above which the aircraft flies", "m/s", start=45.0, lower=1.0, upper=200.0),
    Row("speed_bandwidth", "Bandwidth of the speed loop", "rad/s", start=1.0, lower=1e-2, upper=20.0),
    Row("bank_bandwidth", "Bandwidth of the bank loop", "rad/s", start=1.5, lower=1e-2, upper=20.0),
    Row("climb_bandwidth", "Bandwidth of the slope loop and of take-off", "rad/s", start=0.8, lower=1e-2, upper=20.0),
    Row("gust_bandwidth", "Bandwidth with which the motion follows gusts", "rad/s", start=4.0, lower=1e-1, upper=60.0),
    Row("bank_limit", "Largest bank", "rad", start=0.8, lower=0.0, upper=1.2),
    Row("bank_rate_limit", "Largest rate of the bank", "rad/s", start=0.15, lower=1e-3, upper=3.0),
    Row("pull_limit", "Largest vertical acceleration normal to the path", "m/s^2", start=2.0, lower=1e-2, upper=50.0),
))  # fmt: skip


@lru_cache(maxsize=16)
def aircraft(engine_components: int = 1) -> Vehicle:
    """An aircraft.

    engine_components: number of angular frequencies of the engine's vibration in roll, pitch (rad) and down
    (m).

    Parameters: those of `PARAMETERS`, ``engine_angular_frequency`` and ``engine_<roll|pitch|down>_amplitude``,
    ``_phase``, turbulence (``gust_time_constant``, ``gust_<roll|pitch|yaw>_sigma`` rad,
    ``gust_<north|east|down>_sigma`` m/s), script (``segments``, ``segments_repeat``).
    `flight_plan` builds the script from physical quantities.
    """
    engine = engine_phasors(engine_components)

    def angles(p: Values, x: Values) -> list[Any]:
        pitch = p.mean_pitch + climb_angle(x.slope) + p.angle_of_attack * x.airborne
        return [
            p.mean_roll + x.bank * x.airborne + x.gust_roll + engine.value(x, "roll"),
            pitch + x.gust_pitch + engine.value(x, "pitch"),
            x.track + x.gust_yaw,
            x.track,
        ]

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        sine, cosine = pairs[3]
        return ca.vertcat(
            x.speed * cosine + x.gust_north,
            x.speed * sine + x.gust_east,
            x.gust_down - x.speed * x.slope + engine.rate(p, x, "down"),
        )

    return scripted(
        "aircraft",
        "Aircraft",
        parameters=PARAMETERS,
        script=SCRIPT,
        trackers=_TRACKERS,
        gusts=AIR_GUSTS,
        engine=engine,
        heading=_TRACK,
        start=lambda p: {"track": p.start_heading, "speed": p.start_speed, "airborne": p.start_speed > p.take_off_speed},
        turned=lambda x, t: {
            "track": x.track + t * (x.turn_rate + 0.5 * t * x.turn_acceleration),
            "turn_rate": x.turn_rate + t * x.turn_acceleration,
        },
        turning=lambda x: {"track": x.turn_rate, "turn_rate": x.turn_acceleration},
        angles=angles,
        velocity_n=velocity_n,
        hold=_hold,
    )


def turn_rate_of(bank: Any, speed: Any) -> Any:
    """Rate (rad/s) of the track in a coordinated turn at a bank (rad) and speed (m/s); zero at rest."""
    sine, cosine = sin_cos(bank)
    fast = maximum(speed, SLOW)
    return STANDARD_GRAVITY * sine * speed / (cosine * fast * fast)


def _hold(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
    h = p.sample_interval
    flies = x.speed > p.take_off_speed
    fast = maximum(x.speed, p.take_off_speed)
    slope = select(flies, x.commanded_climb_rate / fast, 0.0)
    bank = clamp(x.commanded_bank, -p.bank_limit, p.bank_limit)
    held = {
        **_SPEED.hold(x, h, maximum(x.commanded_speed, 0.0), p.speed_bandwidth, ca.fabs(x.commanded_acceleration)),
        **BANK.hold(x, h, bank, p.bank_bandwidth, p.bank_rate_limit),
        **_SLOPE.hold(x, h, slope, p.climb_bandwidth, p.pull_limit / fast),
        **_AIRBORNE.hold(x, h, flies, p.climb_bandwidth),
        **AIR_GUSTS.hold(p, x, p.gust_bandwidth, r),
        **SCRIPT.count(p, x),
    }
    end = along_all((_SPEED, BANK), SimpleNamespace(**{**vars(x), **held}), h)
    return held | {"turn_acceleration": (turn_rate_of(end["bank"], end["speed"]) - x.turn_rate) / h}


def survey_pattern(lines: int, length_m: float, bank_deg: float = 20.0) -> list[dict[str, float]]:
    """Legs for `flight_plan`: parallel lines joined by half turns, alternately to the right and to the left."""
    if lines < 1:
        raise InputError(f"lines = {lines}: allowed is at least 1")
    legs: list[dict[str, float]] = []
    for number in range(lines):
        if number:
            legs.append({"turn_deg": 180.0 if number % 2 else -180.0, "bank_deg": bank_deg})
        legs.append({"line_m": length_m})
    return legs


@lru_cache(maxsize=256)
def turn_timing(angle: float, bank: float, speed: float) -> tuple[float, float]:
    """For a turn by an angle (rad) at a bank (rad) and speed (m/s): the time (s) for which to command the bank, and
    then to level.

    Simulates roll-in and roll-out with the aircraft's own tracker and its default parameters. Raises `InputError` if
    the bank is too large for the aircraft or for so short a turn.
    """
    table = PARAMETERS
    bandwidth, limit = float(table["bank_bandwidth"].start), float(table["bank_rate_limit"].start)
    if bank > float(table["bank_limit"].start):
        raise InputError(f"bank {bank:g} rad: allowed is up to {table['bank_limit'].start:g} rad")
    h, settling = 0.01, bank / limit + 8.0 / bandwidth

    def turned(target: float, begin: float) -> float:
        """Angle turned while the bank settles from `begin` to `target`."""
        x = SimpleNamespace(bank=begin, bank_rate=0.0, bank_second=0.0)
        total = 0.0
        for _ in range(round(settling / h)):
            vars(x).update(BANK.hold(x, h, target, bandwidth, limit))
            before = tan(x.bank)
            vars(x).update(BANK.along(x, h))
            total += 0.5 * h * (before + tan(x.bank))
        return total * STANDARD_GRAVITY * speed / max(speed, SLOW) ** 2

    rest = abs(angle) - turned(bank, 0.0) - turned(0.0, bank)
    duration = settling + rest * max(speed, SLOW) ** 2 / (speed * STANDARD_GRAVITY * tan(bank))
    if duration < settling:
        raise InputError(
            f"a turn by {abs(angle) * 180 / pi:g} deg at a bank of {bank * 180 / pi:g} deg and {speed:g} m/s is over before "
            f"the bank has settled: allowed is a smaller bank"
        )
    return duration, settling


# The section [vehicle] of an aircraft: engine, gusts, flight.


class AircraftLeg(LegSection):
    """One leg of a flight: exactly one of wait_s, fly_s, line_m, speed_mps, climb_to_m, turn_deg, survey_lines."""

    kinds: ClassVar[tuple[str, ...]] = ("wait_s", "fly_s", "line_m", "speed_mps", "climb_to_m", "turn_deg")

    wait_s: Number | None = lasting("keep speed and direction for this time")
    fly_s: Number | None = lasting("go straight on for this time")
    line_m: Number | None = key(None, "go straight on for this distance over ground", "m", gt=0, le=1e7)
    speed_mps: Number | None = key(None, "change to this speed; the leg ends when it is reached", "m/s", ge=0, le=340)
    climb_to_m: Number | None = key(None, "climb or descend to this height above the ellipsoid", "m", ge=-1000, le=50000)
    turn_deg: Number | None = turning("coordinated turn by this angle, right positive")
    survey_lines: Annotated[int, Strict()] | None = key(
        None, "number of parallel lines of length line_m, with half turns between them, the first to the right", "", ge=1, le=32
    )
    acceleration_mps2: Number | None = key(None, "largest acceleration, from this leg on (initially 2.5)", "m/s2", gt=0, le=30)
    climb_mps: Number | None = key(None, "rate of climb; 5 if absent", "m/s", gt=0, le=100)
    bank_deg: Number | None = key(None, "bank angle of the turn; 20 if absent", "deg", gt=0, le=45)


def flight_plan(legs: Legs, start_speed_mps: float = 0.0, start_height_m: float = 0.0) -> Array:
    """Segments of `aircraft` from legs, each an `AircraftLeg` or its values, such as::

        [{"wait_s": 300}, {"speed_mps": 8}, {"turn_deg": 90, "bank_deg": 5}, {"speed_mps": 80, "acceleration_mps2": 3},
         {"climb_to_m": 6000, "climb_mps": 8}, {"line_m": 20000}, {"turn_deg": -180, "bank_deg": 20},
         {"fly_s": 60}]

    Assumes the default bandwidths and limits of the vehicle; turns are accurate to 0.1 deg, and end with level wings. Raises
    `InputError` naming the leg, the key and what is allowed.
    """
    speed, height, acceleration, segments = start_speed_mps, start_height_m, 2.5, []
    take_off = float(PARAMETERS["take_off_speed"].start)
    for where, leg, kind, value in of_kinds(_without_surveys(legs)):
        acceleration = leg.acceleration_mps2 or acceleration
        level = {"acceleration": acceleration, "bank": 0.0, "climb_rate": 0.0}
        least = take_off if kind == "climb_to_m" else 0.0
        if kind in ("line_m", "turn_deg", "climb_to_m") and speed <= least:
            raise InputError(
                f"{where}: {kind} = {value:g} at {speed:g} m/s: allowed is above {least:g} m/s; give a speed_mps first"
            )
        if kind == "speed_mps":
            segments.append(level | {"speed": value, "duration": abs(value - speed) / acceleration + 6.0})
            speed = value
        elif kind == "climb_to_m":
            rate, climb = leg.climb_mps or 5.0, value - height
            duration = max(abs(climb) / rate, 1e-3)
            segments.append(level | {"speed": speed, "climb_rate": rate if climb > 0 else -rate, "duration": duration})
            segments.append(level | {"speed": speed, "duration": 12.0})
            height = value
        elif kind == "turn_deg":
            bank = radians(leg.bank_deg or 20.0)
            try:
                duration, settling = turn_timing(radians(value), bank, speed)
            except InputError as error:
                raise InputError(f"{where}: {error}") from None
            segments.append(level | {"speed": speed, "bank": bank if value > 0 else -bank, "duration": duration})
            segments.append(level | {"speed": speed, "duration": settling})
        else:
            segments.append(level | {"speed": speed, "duration": value / speed if kind == "line_m" else value})
    return SCRIPT.table(segments)


def _without_surveys(legs: Legs) -> Iterator[tuple[str, AircraftLeg]]:
    """The legs with their places for messages, each survey as its lines and turns."""
    for where, leg in placed(AircraftLeg, legs):
        keys = set(leg.model_dump(exclude_none=True)) - {"survey_lines"}
        if leg.survey_lines is None:
            yield where, leg
        elif leg.line_m is None or keys - {"line_m", "bank_deg"}:
            raise InputError(f"{where}: survey_lines needs line_m; of the other keys only bank_deg is allowed")
        else:
            for each in survey_pattern(leg.survey_lines, leg.line_m, leg.bank_deg or 20.0):
                yield where, AircraftLeg(**each)


class AircraftSection(GustsSection):
    """An aircraft: parked if its legs only wait, otherwise moving."""

    traits: ClassVar[VehicleTraits] = AIRCRAFT_TRAITS

    kind: Literal["aircraft"] = key(..., "kind of vehicle")
    angle_of_attack_deg: Number = key(
        2.0, "pitch above the flight path in the air", "deg", row="angle_of_attack", ge=-15, le=15
    )
    take_off_speed_mps: Number = key(45.0, "speed above which it flies", "m/s", row=PARAMETERS["take_off_speed"])
    start_speed_mps: Number = key(
        0.0, "speed at time 0; in the air if above the take-off speed", "m/s", row=PARAMETERS["start_speed"]
    )
    legs: tuple[AircraftLeg, ...] = key((), "the flight, leg by leg; a parked aircraft only waits", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", row="segments_repeat", strict=True)

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
        return aircraft(max(1, len(self.engine)))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        segments = in_legs(lambda: flight_plan(self.legs, self.start_speed_mps, start.height_m))
        return {**self.air_rows(), "segments": segments}
