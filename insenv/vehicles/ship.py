"""Ship, moored or under way, that sways about a mean attitude as a sum of sinusoids.

Attitude = mean + sway; the centre of motion is displaced in north, east and down from its mean position (moored) or
track (under way). Regular sway has separate sinusoids for each of the six motions; an irregular sea has sinusoids
common to all six (`insenv.vehicles.waves`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any

import casadi as ca

from insenv.base.errors import InputError, nearest
from insenv.core.elementary import maximum
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.vehicles import surroundings
from insenv.vehicles.nodes import PLACES
from insenv.vehicles.phasors import Phasors, total, total_rate
from insenv.vehicles.script import Script
from insenv.vehicles.tracker import Tracker, along_all, derivative_all
from insenv.vehicles.traits import StickCommand, VehicleTraits
from insenv.vehicles.truth import SineCosine, Vehicle

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
    airspeed=False,
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
            own = r[used : used + bank.start_uniforms] if bank.seeded else None
            used += bank.start_uniforms
            rows |= bank.start(p, own)
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


def regular_sway(motions: Sequence[Mapping[str, Any]]) -> tuple[dict[str, int], dict[str, list[float]]]:
    """The argument `regular` of `ship`, and its parameters, from sinusoids A sin(2 pi t / period + phase) such as::

        [{"motion": "roll", "amplitude_deg": 10, "period_s": 8},
         {"motion": "down", "amplitude_m": 1, "frequency_hz": 0.125, "phase_deg": 90}]

    ``frequency_hz`` may replace ``period_s``. Raises `InputError` naming the sinusoid, the key and what is
    allowed.
    """
    values: dict[str, list[float]] = {}
    for number, motion in enumerate(motions, 1):
        name = motion.get("motion")
        if name not in CHANNELS:
            raise InputError(f"sway {number}: motion = {name!r}{nearest(str(name), CHANNELS)}")
        size = "amplitude_deg" if CHANNELS[name] == "rad" else "amplitude_m"
        keys = {"motion", size, "period_s", "frequency_hz", "phase_deg"}
        for key in motion:
            if key not in keys:
                raise InputError(f"sway {number}: no key {key!r}{nearest(key, sorted(keys))}")
        if size not in motion or ("period_s" in motion) == ("frequency_hz" in motion):
            raise InputError(f"sway {number}: needs {size} and either period_s or frequency_hz")
        frequency = float(motion.get("frequency_hz", 0.0)) or 1.0 / (float(motion.get("period_s", 0.0)) or -1.0)
        if frequency <= 0.0:
            raise InputError(f"sway {number}: period_s or frequency_hz: allowed is a number above 0")
        scale = pi / 180.0 if size == "amplitude_deg" else 1.0
        for row, value in (
            ("amplitude", float(motion[size]) * scale),
            ("angular_frequency", 2.0 * pi * frequency),
            ("phase", float(motion.get("phase_deg", 0.0)) * pi / 180.0),
        ):
            values.setdefault(f"{name}_{row}", []).append(value)
    counts = {name: len(values[f"{name}_phase"]) for name in CHANNELS if f"{name}_phase" in values}
    return counts, values
