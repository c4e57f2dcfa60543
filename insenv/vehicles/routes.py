"""Scripts from physical quantities in user units: the route of a car, the course of a ship, the flight of an aircraft.

Each builder returns the value of the vehicle's parameter ``segments``. Durations include the response time of the
vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from math import isfinite, pi, radians, tan
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, nearest
from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles.aircraft import BANK, SLOW
from insenv.vehicles.aircraft import PARAMETERS as AIRCRAFT_PARAMETERS
from insenv.vehicles.aircraft import SCRIPT as AIRCRAFT_SCRIPT
from insenv.vehicles.car import SCRIPT as CAR_SCRIPT
from insenv.vehicles.ship import SCRIPT as SHIP_SCRIPT

Leg = Mapping[str, float]
Array = NDArray[np.float64]


def car_route(legs: Sequence[Leg], start_speed_mps: float = 0.0, speed_bandwidth: float = 3.0) -> Array:
    """Segments of `car` from legs such as::

        [{"wait_s": 60, "load_roll_deg": 0.5}, {"accelerate_to_mps": 15, "acceleration_mps2": 2}, {"drive_s": 20},
         {"turn_deg": 90, "duration_s": 6}, {"stop_s": 30}]

    Each leg has one of ``accelerate_to_mps`` (ends when the speed is reached, or after ``duration_s``), ``drive_s``
    (straight ahead), ``turn_deg`` (positive to the right, at the current speed; with ``duration_s`` or ``radius_m``),
    ``stop_s`` (brake, then stand for this time), ``wait_s``. Any leg may set ``acceleration_mps2`` (2),
    ``grade_percent``, ``load_roll_deg``, ``load_pitch_deg``, ``load_down_m``, which remain in effect. Raises
    `InputError` naming the leg, the key and what is allowed.
    """
    allowed = {"acceleration_mps2", "grade_percent", "load_roll_deg", "load_pitch_deg", "load_down_m", "duration_s", "radius_m"}
    speed, acceleration, segments = start_speed_mps, 2.0, []
    for number, leg in enumerate(legs, 1):
        kind = _kind(number, leg, ("accelerate_to_mps", "drive_s", "turn_deg", "stop_s", "wait_s"), allowed)
        acceleration = _positive(number, leg, "acceleration_mps2", acceleration)
        segment = {"acceleration": acceleration, "yaw_rate": 0.0}
        for key, name, factor in (
            ("grade_percent", "slope", 0.01),
            ("load_roll_deg", "load_roll", pi / 180.0),
            ("load_pitch_deg", "load_pitch", pi / 180.0),
            ("load_down_m", "load_down", 1.0),
        ):
            if key in leg:
                segment[name] = float(leg[key]) * factor
        if kind in ("accelerate_to_mps", "stop_s"):
            new = leg[kind] if kind == "accelerate_to_mps" else 0.0
            reaching = abs(new - speed) / acceleration + 6.0 / speed_bandwidth
            segment["duration"] = reaching + leg["stop_s"] if kind == "stop_s" else leg.get("duration_s", reaching)
            speed = new
        elif kind == "turn_deg":
            angle = radians(leg["turn_deg"])
            if speed <= 0.0:
                raise InputError(f"leg {number}: turn_deg = {leg['turn_deg']}: a stationary car cannot turn")
            if ("duration_s" in leg) == ("radius_m" in leg):
                raise InputError(f"leg {number}: turn_deg needs either duration_s or radius_m")
            radius = _positive(number, leg, "radius_m", 1.0)
            duration = _positive(number, leg, "duration_s", abs(angle) * radius / speed)
            segment |= {"duration": duration, "yaw_rate": angle / duration}
        else:
            segment["duration"] = leg[kind]
        segments.append(segment | {"speed": speed})
    return CAR_SCRIPT.table(segments)


def ship_course(legs: Sequence[Leg], start_speed_mps: float = 0.0) -> Array:
    """Segments of ``ship(under_way=True)`` from legs such as ``[{"speed_mps": 8, "duration_s": 300},
    {"turn_deg": 90, "duration_s": 120}, {"hold_s": 600}]``.

    Each leg has one of ``speed_mps`` (straight ahead, over ``duration_s``), ``turn_deg`` (positive to the right, over
    ``duration_s``), ``hold_s`` (straight ahead). Raises `InputError` naming the leg, the key and what is
    allowed.
    """
    speed, segments = start_speed_mps, []
    for number, leg in enumerate(legs, 1):
        kind = _kind(number, leg, ("speed_mps", "turn_deg", "hold_s"), {"duration_s"})
        if kind != "hold_s" and "duration_s" not in leg:
            raise InputError(f"leg {number}: {kind} needs duration_s")
        duration = float(leg["hold_s"]) if kind == "hold_s" else _positive(number, leg, "duration_s", 0.0)
        speed = leg.get("speed_mps", speed)
        rate = radians(leg.get("turn_deg", 0.0)) / duration
        segments.append({"duration": duration, "speed": speed, "turn_rate": rate})
    return SHIP_SCRIPT.table(segments)


def flight_plan(legs: Sequence[Leg], start_speed_mps: float = 0.0, start_height_m: float = 0.0) -> Array:
    """Segments of `aircraft` from legs such as::

        [{"wait_s": 300}, {"speed_mps": 8}, {"turn_deg": 90, "bank_deg": 5}, {"speed_mps": 80, "acceleration_mps2": 3},
         {"climb_to_m": 6000, "climb_mps": 8}, {"line_m": 20000}, {"turn_deg": -180, "bank_deg": 20},
         {"fly_s": 60}]

    Each leg has one of ``wait_s`` or ``fly_s`` (straight ahead), ``line_m`` (straight ahead for a ground distance),
    ``speed_mps`` (until it is reached), ``climb_to_m`` (height above the ellipsoid, at ``climb_mps``, 5), ``turn_deg``
    (positive to the right, at ``bank_deg``, 20; wings level at its end). Any leg may set ``acceleration_mps2`` (2.5).
    Assumes the default bandwidths and limits of the vehicle; turns are accurate to 0.1 deg. Raises `InputError` naming
    the leg, the key and what is allowed.
    """
    kinds = ("wait_s", "fly_s", "line_m", "speed_mps", "climb_to_m", "turn_deg")
    speed, height, acceleration, segments = start_speed_mps, start_height_m, 2.5, []
    take_off = float(AIRCRAFT_PARAMETERS["take_off_speed"].start)
    for number, leg in enumerate(legs, 1):
        kind = _kind(number, leg, kinds, {"acceleration_mps2", "climb_mps", "bank_deg"})
        acceleration = _positive(number, leg, "acceleration_mps2", acceleration)
        level = {"acceleration": acceleration, "bank": 0.0, "climb_rate": 0.0}
        least = take_off if kind == "climb_to_m" else 0.0
        if kind in ("line_m", "turn_deg", "climb_to_m") and speed <= least:
            raise InputError(
                f"leg {number}: {kind} = {leg[kind]} at {speed:g} m/s: allowed is above {least:g} m/s; give a speed_mps first"
            )
        if kind == "speed_mps":
            segments.append(level | {"speed": leg[kind], "duration": abs(leg[kind] - speed) / acceleration + 6.0})
            speed = leg[kind]
        elif kind == "climb_to_m":
            rate = _positive(number, leg, "climb_mps", 5.0)
            climb = leg[kind] - height
            duration = max(abs(climb) / rate, 1e-3)
            segments.append(level | {"speed": speed, "climb_rate": rate if climb > 0 else -rate, "duration": duration})
            segments.append(level | {"speed": speed, "duration": 12.0})
            height = leg[kind]
        elif kind == "turn_deg":
            bank = radians(_positive(number, leg, "bank_deg", 20.0))
            duration, settling = turn_timing(radians(leg[kind]), bank, speed)
            signed = bank if leg[kind] > 0 else -bank
            segments.append(level | {"speed": speed, "bank": signed, "duration": duration})
            segments.append(level | {"speed": speed, "duration": settling})
        else:
            segments.append(level | {"speed": speed, "duration": leg[kind] / speed if kind == "line_m" else leg[kind]})
    return AIRCRAFT_SCRIPT.table(segments)


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
    table = AIRCRAFT_PARAMETERS
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
            f"turn by {abs(angle) * 180 / pi:g} deg at a bank of {bank * 180 / pi:g} deg and {speed:g} m/s is over before "
            f"the bank has settled: allowed is a smaller bank"
        )
    return duration, settling


def _kind(number: int, leg: Leg, kinds: Sequence[str], others: set[str]) -> str:
    """The one key of `kinds` in a leg; raises `InputError` for keys and values that are not allowed."""
    for key, value in leg.items():
        if key not in kinds and key not in others:
            raise InputError(f"leg {number}: no key {key!r}{nearest(key, [*kinds, *sorted(others)])}")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
            raise InputError(f"leg {number}: {key} = {value!r}: allowed is a finite number")
    found = [key for key in kinds if key in leg]
    if len(found) != 1:
        raise InputError(f"leg {number} has {' and '.join(found) or 'none'}: allowed is exactly one of {', '.join(kinds)}")
    signed = ("turn_deg", "climb_to_m", "accelerate_to_mps", "speed_mps")
    if (leg[found[0]] <= 0 and found[0] not in signed) or (leg[found[0]] < 0 and found[0].endswith("mps")):
        raise InputError(f"leg {number}: {found[0]} = {leg[found[0]]}: allowed is a positive number")
    return found[0]


def _positive(number: int, leg: Leg, key: str, otherwise: float) -> float:
    value = float(leg.get(key, otherwise))
    if not value > 0.0:
        raise InputError(f"leg {number}: {key} = {value:g}: allowed is a positive number")
    return value
