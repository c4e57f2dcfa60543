"""Multirotor: hovering, climbing, flying and turning, by script or command.

Velocities along and across the heading, the rate of climb and the yaw rate follow their commands.  The body tilts as its thrust
must: forward to accelerate and against the drag, sideways likewise, with a bandwidth of its own.  Turbulence is a small
Gauss-Markov disturbance of attitude and velocity; nothing holds the position against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, ClassVar, Literal

import casadi as ca

from insenv.base.errors import InputError
from insenv.base.keys import rows_of
from insenv.base.toml import Number, key
from insenv.core.elementary import clamp
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles.script import Script, Tracker
from insenv.vehicles.scripted import AIR_GUSTS, engine_phasors, scripted
from insenv.vehicles.section import (
    MAX_LEGS,
    Engine,
    GustsSection,
    Legs,
    LegSection,
    StartSection,
    StickCommand,
    VehicleTraits,
    fastest,
    in_legs,
    lasting,
    legs_of,
    turning,
)
from insenv.vehicles.truth import SineCosine, Vehicle

SCRIPT = Script((
    Row("forward", "Velocity to reach along the heading", "m/s", lower=-50.0, upper=50.0),
    Row("right", "Velocity to reach to the right of the heading", "m/s", lower=-50.0, upper=50.0),
    Row("climb_rate", "Rate of climb to reach", "m/s", lower=-20.0, upper=20.0),
    Row("yaw_rate", "Yaw rate to reach", "rad/s", lower=-4.0, upper=4.0),
))  # fmt: skip

MULTIROTOR_TRAITS = VehicleTraits(
    mavlink_type=2,  # MAV_TYPE_QUADROTOR
    shape="multirotor",
    flies=True,
    floats=True,
    sticks=(
        StickCommand("forward", "FORWARD", "Forward speed", ("x",), 5.0, 50.0, "m/s"),
        StickCommand("right", "RIGHT", "Speed to the right", ("y",), 5.0, 50.0, "m/s"),
        StickCommand("climb_rate", "CLIMB", "Climb rate", ("z",), 3.0, 20.0, "m/s"),
        StickCommand("yaw_rate", "TURN", "Turn rate", ("r",), 45.0, 200.0, "deg/s"),
    ),
)

_FORWARD = Tracker(("forward", "forward_rate", "forward_second"), "Velocity along the heading", "m/s")
_RIGHT = Tracker(("right", "right_rate", "right_second"), "Velocity to the right of the heading", "m/s")
_CLIMB = Tracker(("climb", "climb_rate", "climb_second"), "Rate of climb", "m/s")
_YAW = Tracker(("yaw_rate", "yaw_acceleration", "yaw_second"), "Yaw rate", "rad/s")
_ROLL = Tracker(("tilt_roll", "tilt_roll_rate", "tilt_roll_second"), "Roll by which the thrust is inclined", "rad")
_PITCH = Tracker(("tilt_pitch", "tilt_pitch_rate", "tilt_pitch_second"), "Pitch by which the thrust is inclined", "rad")
_TRACKERS = (_FORWARD, _RIGHT, _CLIMB, _YAW, _ROLL, _PITCH)

PARAMETERS = Table((
    Row("mean_roll", "Roll of the unit's frame while the thrust is vertical", "rad", lower=-0.5, upper=0.5),
    Row("mean_pitch", "Pitch of the unit's frame while the thrust is vertical", "rad", lower=-0.5, upper=0.5),
    Row("start_heading", "Heading at time 0", "rad"),
    Row("velocity_bandwidth", "Bandwidth of the velocity loops", "rad/s", start=1.5, lower=1e-2, upper=20.0),
    Row("yaw_bandwidth", "Bandwidth of the yaw rate loop", "rad/s", start=4.0, lower=1e-2, upper=20.0),
    Row("tilt_bandwidth", "Bandwidth of the attitude loop", "rad/s", start=8.0, lower=1e-1, upper=60.0),
    Row("gust_bandwidth", "Bandwidth with which the motion follows gusts", "rad/s", start=4.0, lower=1e-1, upper=60.0),
    Row("acceleration_limit", "Largest acceleration of each velocity", "m/s^2", start=3.0, lower=1e-2, upper=20.0),
    Row("drag", "Deceleration by drag per speed", "1/s", start=0.15, lower=0.0, upper=5.0),
    Row("tilt_limit", "Largest roll and pitch of the thrust", "rad", start=0.6, lower=0.0, upper=1.2),
))  # fmt: skip


@lru_cache(maxsize=16)
def multirotor(rotor_components: int = 1) -> Vehicle:
    """A multirotor.

    rotor_components: number of angular frequencies of the rotors' vibration in roll, pitch (rad) and down (m).

    Parameters: those of `PARAMETERS`, ``engine_angular_frequency`` and ``engine_<roll|pitch|down>_amplitude``, ``_phase``,
    turbulence (``gust_time_constant``, ``gust_<roll|pitch|yaw>_sigma`` rad, ``gust_<north|east|down>_sigma`` m/s), script
    (``segments``, ``segments_repeat``).
    """
    rotors = engine_phasors(rotor_components)

    def angles(p: Values, x: Values) -> list[Any]:
        return [
            p.mean_roll + x.tilt_roll + x.gust_roll + rotors.value(x, "roll"),
            p.mean_pitch + x.tilt_pitch + x.gust_pitch + rotors.value(x, "pitch"),
            x.yaw + x.gust_yaw,
            x.yaw,
        ]

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        sine, cosine = pairs[3]
        return ca.vertcat(
            x.forward * cosine - x.right * sine + x.gust_north,
            x.forward * sine + x.right * cosine + x.gust_east,
            x.gust_down - x.climb + rotors.rate(p, x, "down"),
        )

    return scripted(
        "multirotor",
        "Multirotor",
        parameters=PARAMETERS,
        script=SCRIPT,
        trackers=_TRACKERS,
        gusts=AIR_GUSTS,
        engine=rotors,
        heading=Table((Row("yaw", "Heading without gusts, not wrapped", "rad"),)),
        start=lambda p: {"yaw": p.start_heading},
        turned=lambda x, t: {"yaw": x.yaw + _YAW.integral(x, t)},
        turning=lambda x: {"yaw": x.yaw_rate},
        angles=angles,
        velocity_n=velocity_n,
        hold=_hold,
    )


def _hold(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
    h, most = p.sample_interval, p.acceleration_limit
    ahead = x.forward_rate - x.yaw_rate * x.right + p.drag * x.forward
    aside = x.right_rate + x.yaw_rate * x.forward + p.drag * x.right
    pitch, roll = (
        clamp(sign * wanted / STANDARD_GRAVITY, -p.tilt_limit, p.tilt_limit) for sign, wanted in ((-1.0, ahead), (1.0, aside))
    )
    return {
        **_FORWARD.hold(x, h, x.commanded_forward, p.velocity_bandwidth, most),
        **_RIGHT.hold(x, h, x.commanded_right, p.velocity_bandwidth, most),
        **_CLIMB.hold(x, h, x.commanded_climb_rate, p.velocity_bandwidth, most),
        **_YAW.hold(x, h, x.commanded_yaw_rate, p.yaw_bandwidth),
        **_PITCH.hold(x, h, pitch, p.tilt_bandwidth),
        **_ROLL.hold(x, h, roll, p.tilt_bandwidth),
        **AIR_GUSTS.hold(p, x, p.gust_bandwidth, r),
        **SCRIPT.count(p, x),
    }


# The section [vehicle] of a multirotor: rotors, gusts, flight.


class MultirotorLeg(LegSection):
    """One leg of a flight: exactly one of hover_s, fly_s, turn_deg."""

    kinds: ClassVar[tuple[str, ...]] = ("hover_s", "fly_s", "turn_deg")

    hover_s: Number | None = lasting("stay for this time")
    fly_s: Number | None = lasting("fly for this time with forward_mps, right_mps and climb_mps")
    turn_deg: Number | None = turning(
        "turn by this angle, right positive, over duration_s, with the velocities of the leg before",
        SCRIPT.fastest_deg("yaw_rate"),
    )
    duration_s: Number | None = lasting("duration of the turn")
    forward_mps: Number | None = key(None, "velocity along the heading; 0 if absent", "m/s", row=SCRIPT["forward"])
    right_mps: Number | None = key(None, "velocity to the right of the heading; 0 if absent", "m/s", row=SCRIPT["right"])
    climb_mps: Number | None = key(None, "rate of climb; 0 if absent", "m/s", row=SCRIPT["climb_rate"])


class MultirotorSection(GustsSection):
    """A multirotor, in the air from time 0 on; without legs it hovers."""

    traits: ClassVar[VehicleTraits] = MULTIROTOR_TRAITS

    kind: Literal["multirotor"] = key(..., "kind of vehicle")
    engine: Engine = key((), "the rotors' vibration")
    gust_correlation_s: Number = key(2.0, "correlation time of the gusts", "s", row="gust_time_constant", ge=0.01, le=1e6)
    legs: tuple[MultirotorLeg, ...] = key((), "the flight, leg by leg", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", row="segments_repeat", strict=True)

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
        return multirotor(max(1, len(self.engine)))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        return {**self.air_rows(), "segments": in_legs(lambda: SCRIPT.table(flight(self.legs)))}


FITTING = {"hover_s": set[str](), "fly_s": {"forward_mps", "right_mps", "climb_mps"}, "turn_deg": {"duration_s"}}
"""Keys that go with each kind of leg."""


def flight(legs: Legs) -> list[dict[str, float]]:
    """Segments of the script from legs.  Raises `InputError` naming the leg, the key and what is allowed.

    The yaw rate follows its command as a linear system with the gain 1: the angle turned is that of the command.
    """
    hovering = {"forward": 0.0, "right": 0.0, "climb_rate": 0.0}
    velocity, segments = hovering, []
    for where, leg, kind, value in legs_of(MultirotorLeg, legs):
        fitting = FITTING[kind]
        for name in leg.model_dump(exclude_none=True):
            if name != kind and name not in fitting:
                allowed = ", ".join(sorted(fitting)) or "nothing"
                raise InputError(f"{where}: {name} does not go with {kind}: allowed is {allowed}")
        duration, rate = value, 0.0
        if kind == "turn_deg":
            if leg.duration_s is None:
                raise InputError(f"{where}: turn_deg needs duration_s")
            duration, rate = leg.duration_s, SCRIPT.turn_rate(where, "yaw_rate", value, leg.duration_s)
        else:
            velocity = hovering | rows_of(leg)
        segments.append({"duration": duration, **velocity, "yaw_rate": rate})
    return segments
