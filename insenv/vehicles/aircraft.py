"""Aircraft: parked in gusts, taxiing, taking off, climbing, on straight lines and in coordinated turns, by script or
command.

The track turns at the rate of a coordinated turn, g tan(bank) / V, exact at the end of every sample and linear in
between, so that the heading is a polynomial within a sample. On the ground the same command steers and the wings stay
level. Turbulence is a small Gauss-Markov disturbance of attitude and velocity.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv.core.elementary import clamp, maximum, select, sin_cos
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles.car import climb_angle
from insenv.vehicles.gusts import Gusts
from insenv.vehicles.nodes import PLACES
from insenv.vehicles.phasors import Phasors
from insenv.vehicles.script import Script
from insenv.vehicles.tracker import Tracker, along_all, derivative_all
from insenv.vehicles.traits import StickCommand, VehicleTraits
from insenv.vehicles.truth import SineCosine, Vehicle

SLOW = 5.0
"""Speed (m/s) below which the turn rate falls with the speed, to zero at rest."""

SCRIPT = Script((
    Row("speed", "Speed to reach, horizontal, over ground", "m/s", lower=0.0, upper=340.0),
    Row("acceleration", "Largest acceleration towards this speed", "m/s^2", start=2.5, lower=0.0, upper=30.0),
    Row("bank", "Bank of the turn, right wing down; on the ground it steers the same turn rate", "rad", lower=-1.2, upper=1.2),
    Row("climb_rate", "Rate of climb, in the air", "m/s", lower=-100.0, upper=100.0),
))  # fmt: skip

AIRCRAFT_TRAITS = VehicleTraits(
    mavlink_type=1,  # MAV_TYPE_FIXED_WING
    airspeed=True,
    sticks=(
        StickCommand("speed", "SPEED", "Speed", ("z",), 80.0, 340.0, "m/s", one_sided=True, released=None),
        StickCommand("bank", "BANK", "Bank", ("y",), 30.0, 60.0, "deg"),
        StickCommand("climb_rate", "CLIMB", "Climb rate", ("x",), 5.0, 100.0, "m/s", sign=-1.0),
    ),
)

_SPEED = Tracker(("speed", "speed_rate", "speed_second"), "Horizontal speed over ground", "m/s")
BANK = Tracker(("bank", "bank_rate", "bank_second"), "Bank of the turn", "rad")
_SLOPE = Tracker(("slope", "slope_rate", "slope_second"), "Slope of the path, climb over horizontal distance", "1")
_AIRBORNE = Tracker(
    ("airborne", "airborne_rate", "airborne_second"), "Share of the weight on the wings, 0 on the ground to 1", "1"
)
_GUSTS = Gusts("gust", (
    ("gust_roll", "rad"), ("gust_pitch", "rad"), ("gust_yaw", "rad"),
    ("gust_north", "m/s"), ("gust_east", "m/s"), ("gust_down", "m/s"),
))  # fmt: skip
_TRACKERS = (_SPEED, BANK, _SLOPE, _AIRBORNE)
_MOVING = (*_TRACKERS, *_GUSTS.trackers)

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


def aircraft(engine_components: int = 1) -> Vehicle:
    """An aircraft.

    engine_components: number of angular frequencies of the engine's vibration in roll, pitch (rad) and down
    (m).

    Parameters: those of `PARAMETERS`, ``engine_angular_frequency`` and ``engine_<roll|pitch|down>_amplitude``,
    ``_phase``, turbulence (``gust_time_constant``, ``gust_<roll|pitch|yaw>_sigma`` rad,
    ``gust_<north|east|down>_sigma`` m/s), script (``segments``, ``segments_repeat``).
    `insenv.vehicles.routes.flight_plan` builds the script from physical quantities.
    """
    engine = Phasors("engine", {"roll": "rad", "pitch": "rad", "down": "m"}, engine_components)
    track = (
        Row("track", "Heading of the path, not wrapped", "rad"),
        Row("turn_rate", "Rate of the track", "rad/s"),
        Row("turn_acceleration", "Second time derivative of the track, held over a sample", "rad/s^2"),
    )
    state = Table(track) + engine.state + _GUSTS.state + SCRIPT.state
    state = sum((tracker.state for tracker in _TRACKERS), state)

    def start(p: Values, r: Any) -> dict[str, Any]:
        moving = {"track": p.start_heading, "speed": p.start_speed, "airborne": p.start_speed > p.take_off_speed}
        return moving | engine.start(p) | _GUSTS.start(p, r) | SCRIPT.start(p, {"speed": p.start_speed})

    def along(p: Values, x: Values) -> list[dict[str, Any]]:
        places = engine.along(x)
        for rows, place in zip(places, PLACES, strict=True):
            t = place * p.sample_interval
            rows |= along_all(_MOVING, x, t)
            rows["track"] = x.track + t * (x.turn_rate + 0.5 * t * x.turn_acceleration)
            rows["turn_rate"] = x.turn_rate + t * x.turn_acceleration
        return places

    def derivative(p: Values, x: Values) -> dict[str, Any]:
        turning = {"track": x.turn_rate, "turn_rate": x.turn_acceleration}
        return {**engine.derivative(p, x), **derivative_all(_MOVING, x), **turning}

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

    return Vehicle(
        id="aircraft",
        title="Aircraft",
        parameters=PARAMETERS + engine.parameters + _GUSTS.parameters + SCRIPT.parameters,
        state=state,
        along=along,
        derivative=derivative,
        angles=angles,
        velocity_n=velocity_n,
        start=start,
        start_uniforms=_GUSTS.uniforms,
        hold=_hold,
        hold_uniforms=_GUSTS.uniforms,
        inputs=SCRIPT.inputs,
        steps=SCRIPT.steps,
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
        **_GUSTS.hold(p, x, p.gust_bandwidth, r),
        **SCRIPT.count(p, x),
    }
    end = along_all((_SPEED, BANK), SimpleNamespace(**{**vars(x), **held}), h)
    return held | {"turn_acceleration": (turn_rate_of(end["bank"], end["speed"]) - x.turn_rate) / h}
