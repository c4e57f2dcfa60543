"""Car: parked (engine, wind, people getting in) or driving (speed, turns, grades, stops), by script or command.

The path is that of a wheeled vehicle without side slip: heading rate = curvature * speed, so that a stationary car does
not turn. The body on its suspension leans out of turns, squats under acceleration, yields to wind and load, and
vibrates with the engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import radians
from typing import Any, ClassVar, Literal

import casadi as ca

from insenv.base.errors import InputError
from insenv.base.keys import rows_of
from insenv.base.toml import Number, key
from insenv.base.units import Conversion
from insenv.core.elementary import clamp, maximum, select
from insenv.core.model import Values
from insenv.core.tables import Array, Row, Table
from insenv.vehicles.script import Script, Tracker
from insenv.vehicles.scripted import Gusts, engine_phasors, scripted
from insenv.vehicles.section import (
    MARGIN_MPS,
    MAX_LEGS,
    Actions,
    Engine,
    Legs,
    LegSection,
    StartSection,
    StickCommand,
    VehicleSection,
    VehicleTraits,
    action,
    engine_rows,
    fastest,
    in_legs,
    lasting,
    legs_of,
    turning,
)
from insenv.vehicles.truth import SineCosine, Vehicle

SCRIPT = Script((
    Row("speed", "Speed to reach, over ground", "m/s", lower=0.0, upper=100.0),
    Row("acceleration", "Largest acceleration towards this speed; if negative, brake to a stop", "m/s^2", start=2.0,
        lower=-15.0, upper=15.0),
    Row("yaw_rate", "Heading rate, reached by steering", "rad/s", lower=-2.0, upper=2.0),
    Row("slope", "Slope of the road, rise over run", lower=-0.4, upper=0.4),
    Row("load_roll", "Roll due to load (people getting in)", "rad", lower=-0.2, upper=0.2),
    Row("load_pitch", "Pitch due to load", "rad", lower=-0.2, upper=0.2),
    Row("load_down", "Sinking due to load", "m", lower=-0.2, upper=0.2),
))  # fmt: skip

AGENT_ACCELERATION = 3.0
"""m/s^2, along and across the path, by a full action of an agent."""
TOP_SPEED = 25.0
"""Speed up to which an agent accelerates, m/s."""
SLOW = 2.0
"""Speed (m/s) below which the yaw rate of an action is that at this speed."""


def _commands(x: Any, action: Any) -> dict[str, Any]:
    """Accelerate to the top speed, brake to a stop, or (at 0) hold the speed."""
    along, across = clamp(action.accelerate, -1.0, 1.0), clamp(action.steer, -1.0, 1.0)
    return {
        "speed": ca.SX(TOP_SPEED),
        "acceleration": along * AGENT_ACCELERATION,
        "yaw_rate": across * AGENT_ACCELERATION / maximum(x.speed, SLOW),
        **{name: getattr(x, f"commanded_{name}") for name in ("slope", "load_roll", "load_pitch", "load_down")},
    }


CAR_TRAITS = VehicleTraits(
    mavlink_type=10,  # MAV_TYPE_GROUND_ROVER
    shape="car",
    parks=True,
    wheels=True,
    sticks=(
        StickCommand("speed", "SPEED", "Speed", ("z",), 15.0, 340.0, "m/s", one_sided=True),
        StickCommand("yaw_rate", "TURN", "Turn rate", ("r", "y"), 20.0, 90.0, "deg/s"),
    ),
    actions=Actions(
        Table((
            action("accelerate", f"Acceleration along the path, in {AGENT_ACCELERATION:g} m/s^2; negative: brake to a stop"),
            action("steer", f"Acceleration across the path, positive to the right, in {AGENT_ACCELERATION:g} m/s^2"),
        )),
        _commands,
        (2.0, 12.0),
    ),
)  # fmt: skip

_SPEED = Tracker(("speed", "speed_rate", "speed_second"), "Speed over ground", "m/s")
_CURVATURE = Tracker(("curvature", "curvature_rate", "curvature_second"), "Curvature of the path, positive to the right", "1/m")
_SLOPE = Tracker(("slope", "slope_rate", "slope_second"), "Slope of the road, rise over run", "1")
_ROLL = Tracker(("suspension_roll", "suspension_roll_rate", "suspension_roll_second"), "Roll on the suspension", "rad")
_PITCH = Tracker(("suspension_pitch", "suspension_pitch_rate", "suspension_pitch_second"), "Pitch on the suspension", "rad")
_SINK = Tracker(("sinking", "sinking_rate", "sinking_second"), "Sinking of the suspension", "m")
_TRACKERS = (_SPEED, _CURVATURE, _SLOPE, _ROLL, _PITCH, _SINK)
_WIND = Gusts("wind", (("wind_roll", "rad"), ("wind_pitch", "rad")))

PARAMETERS = Table((
    Row("mean_roll", "Roll of the ground", "rad", lower=-0.5, upper=0.5),
    Row("mean_pitch", "Pitch of the body on level ground at rest", "rad", lower=-0.5, upper=0.5),
    Row("start_heading", "Heading at time 0", "rad"),
    Row("start_speed", "Speed at time 0", "m/s", lower=0.0, upper=100.0),
    Row("speed_bandwidth", "Bandwidth of the speed loop", "rad/s", start=3.0, lower=1e-2, upper=20.0),
    Row("steering_bandwidth", "Bandwidth of the steering", "rad/s", start=4.0, lower=1e-2, upper=20.0),
    Row("road_bandwidth", "Bandwidth of the slope loop", "rad/s", start=1.5, lower=1e-2, upper=20.0),
    Row("suspension_bandwidth", "Bandwidth of the suspension", "rad/s", start=9.0, lower=1e-1, upper=60.0),
    Row("curvature_limit", "Largest curvature of the path", "1/m", start=0.2, lower=1e-6, upper=1.0),
    Row("roll_per_acceleration", "Lean out of turns per lateral acceleration", "rad/(m/s^2)", start=0.006, lower=0, upper=0.05),
    Row("pitch_per_acceleration", "Squat per forward acceleration", "rad/(m/s^2)", start=0.004, lower=0.0, upper=0.05),
))  # fmt: skip

_STEERING_SPEED = 2.0  # m/s: below this speed a commanded heading rate is not reached


@lru_cache(maxsize=16)
def car(engine_components: int = 1) -> Vehicle:
    """A car.

    engine_components: number of angular frequencies of the engine's vibration in roll, pitch (rad) and down
    (m).

    Parameters: those of `PARAMETERS`, ``engine_angular_frequency`` and
    ``engine_<roll|pitch|down>_amplitude``, ``_phase``, wind (``wind_time_constant``, ``wind_roll_sigma``,
    ``wind_pitch_sigma``), script (``segments``, ``segments_repeat``). `car_route`
    builds the script from physical quantities.
    """
    engine = engine_phasors(engine_components)

    def angles(p: Values, x: Values) -> list[Any]:
        return [
            p.mean_roll + x.suspension_roll + x.wind_roll + engine.value(x, "roll"),
            p.mean_pitch + climb_angle(x.slope) + x.suspension_pitch + x.wind_pitch + engine.value(x, "pitch"),
            x.path_heading,
        ]

    def velocity_n(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Any:
        sine, cosine = pairs[2]
        down = x.sinking_rate - x.speed * x.slope + engine.rate(p, x, "down")
        return ca.vertcat(x.speed * cosine, x.speed * sine, down)

    return scripted(
        "car",
        "Car",
        parameters=PARAMETERS,
        script=SCRIPT,
        trackers=_TRACKERS,
        gusts=_WIND,
        engine=engine,
        heading=Table((Row("path_heading", "Heading, not wrapped", "rad"),)),
        start=lambda p: {"path_heading": p.start_heading, "speed": p.start_speed},
        turned=lambda x, t: {"path_heading": x.path_heading + _turned(x, t)},
        turning=lambda x: {"path_heading": x.curvature * x.speed},
        angles=angles,
        velocity_n=velocity_n,
        hold=_hold,
    )


def climb_angle(slope: Any) -> Any:
    """Angle (rad) of a slope: a polynomial that approximates atan to 2e-6 rad for slopes up to 0.2."""
    square = slope * slope
    return slope * (1.0 - square * (1.0 / 3.0 - square * 0.2))


def _turned(x: Values, t: Any) -> Any:
    """Integral of curvature * speed, each a parabola, over the first t seconds of the sample."""
    k0, k1, k2 = x.curvature, x.curvature_rate, 0.5 * x.curvature_second
    v0, v1, v2 = x.speed, x.speed_rate, 0.5 * x.speed_second
    terms = (k0 * v0, k0 * v1 + k1 * v0, k0 * v2 + k1 * v1 + k2 * v0, k1 * v2 + k2 * v1, k2 * v2)
    total: Any = 0.0
    for power in reversed(range(5)):
        total = t * (terms[power] / (power + 1.0) + total)
    return total


def _hold(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
    h, suspension = p.sample_interval, p.suspension_bandwidth
    braking = x.commanded_acceleration < 0.0
    target = select(braking, 0.0, maximum(x.commanded_speed, 0.0))
    curvature = x.commanded_yaw_rate / maximum(x.speed, _STEERING_SPEED)
    lateral = x.curvature * x.speed * x.speed
    roll = x.commanded_load_roll - p.roll_per_acceleration * lateral
    pitch = x.commanded_load_pitch + p.pitch_per_acceleration * x.speed_rate
    return {
        **_SPEED.hold(x, h, target, p.speed_bandwidth, ca.fabs(x.commanded_acceleration)),
        **_CURVATURE.hold(x, h, clamp(curvature, -p.curvature_limit, p.curvature_limit), p.steering_bandwidth),
        **_SLOPE.hold(x, h, x.commanded_slope, p.road_bandwidth),
        **_ROLL.hold(x, h, roll, suspension),
        **_PITCH.hold(x, h, pitch, suspension),
        **_SINK.hold(x, h, x.commanded_load_down, suspension),
        **_WIND.hold(p, x, suspension, r),
        **SCRIPT.count(p, x),
    }


# The section [vehicle] of a car: engine, wind, load, drive.


class CarLeg(LegSection):
    """One leg of a drive: exactly one of accelerate_to_mps, drive_s, turn_deg, stop_s, wait_s."""

    kinds: ClassVar[tuple[str, ...]] = ("accelerate_to_mps", "drive_s", "turn_deg", "stop_s", "wait_s")

    accelerate_to_mps: Number | None = key(
        None, "change to this speed; the leg ends when it is reached, or after duration_s", "m/s", ge=0, le=100
    )
    drive_s: Number | None = lasting("drive straight on for this time")
    turn_deg: Number | None = turning(
        "turn by this angle, right positive, with duration_s or radius_m", SCRIPT.fastest_deg("yaw_rate")
    )
    stop_s: Number | None = lasting("brake, then stand for this time")
    wait_s: Number | None = lasting("keep speed and direction for this time")
    duration_s: Number | None = lasting("duration of the turn or of the change of speed")
    radius_m: Number | None = key(None, "radius of the turn", "m", gt=0, le=1e6)
    acceleration_mps2: Number | None = key(None, "largest acceleration, from this leg on (initially 2)", "m/s2", gt=0, le=15)
    grade_percent: Number | None = key(
        None, "slope of the road, from this leg on", "%", row=SCRIPT["slope"], convert=Conversion("product", 0.01)
    )
    load_roll_deg: Number | None = key(None, "roll due to the load, from this leg on", "deg", row="load_roll", ge=-10, le=10)
    load_pitch_deg: Number | None = key(None, "pitch due to the load, from this leg on", "deg", row="load_pitch", ge=-10, le=10)
    load_down_m: Number | None = key(None, "displacement down due to the load, from this leg on", "m", row=SCRIPT["load_down"])


def car_route(legs: Legs, start_speed_mps: float = 0.0, speed_bandwidth: float = 3.0) -> Array:
    """Segments of `car` from legs, each a `CarLeg` or its values, such as::

        [{"wait_s": 60, "load_roll_deg": 0.5}, {"accelerate_to_mps": 15, "acceleration_mps2": 2}, {"drive_s": 20},
         {"turn_deg": 90, "duration_s": 6}, {"stop_s": 30}]

    Raises `InputError` naming the leg, the key and what is allowed.
    """
    speed, acceleration, segments = start_speed_mps, 2.0, []
    for where, leg, kind, value in legs_of(CarLeg, legs):
        acceleration = leg.acceleration_mps2 or acceleration
        segment = {"acceleration": acceleration, "yaw_rate": 0.0, **rows_of(leg)}
        if kind in ("accelerate_to_mps", "stop_s"):
            target = value if kind == "accelerate_to_mps" else 0.0
            reaching = abs(target - speed) / acceleration + 6.0 / speed_bandwidth
            segment["duration"] = reaching + value if kind == "stop_s" else leg.duration_s or reaching
            speed = target
        elif kind == "turn_deg":
            if speed <= 0.0:
                raise InputError(f"{where}: turn_deg = {value:g}: a stationary car cannot turn")
            if (leg.duration_s is None) == (leg.radius_m is None):
                raise InputError(f"{where}: turn_deg needs either duration_s or radius_m")
            duration = leg.duration_s or abs(radians(value)) * (leg.radius_m or 1.0) / speed
            if duration <= 0.0:
                raise InputError(f"{where}: turn_deg = {value:g} with radius_m: allowed is an angle other than 0")
            on = "" if leg.radius_m is None else f" with radius_m = {leg.radius_m:g} at {speed:g} m/s"
            segment |= {"duration": duration, "yaw_rate": SCRIPT.turn_rate(where + on, "yaw_rate", value, duration)}
        else:
            segment["duration"] = value
        segments.append(segment | {"speed": speed})
    return SCRIPT.table(segments)


class CarSection(VehicleSection):
    """A car: parked if its legs only wait, otherwise driving."""

    traits: ClassVar[VehicleTraits] = CAR_TRAITS

    kind: Literal["car"] = key(..., "kind of vehicle")
    engine: Engine = key((), "the engine's vibration")
    wind_roll_sigma_deg: Number = key(0.0, "roll due to wind, standard deviation", "deg", row="wind_roll_sigma", ge=0, le=5)
    wind_pitch_sigma_deg: Number = key(0.0, "pitch due to wind, standard deviation", "deg", row="wind_pitch_sigma", ge=0, le=5)
    wind_correlation_s: Number = key(3.0, "correlation time of the wind", "s", row="wind_time_constant", ge=0.01, le=1e6)
    start_speed_mps: Number = key(0.0, "speed along the heading at time 0", "m/s", row=PARAMETERS["start_speed"])
    legs: tuple[CarLeg, ...] = key((), "the drive, leg by leg; a parked car only waits", max_length=MAX_LEGS)
    repeat_legs: bool = key(False, "repeat the legs", row="segments_repeat", strict=True)

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
        return car(max(1, len(self.engine)))

    def rows(self, start: StartSection) -> dict[str, Any]:
        """Parameter rows (SI).  Raises `InputError` for a leg that is not allowed."""
        segments = in_legs(lambda: car_route(self.legs, self.start_speed_mps))
        return {**engine_rows(self.engine), **rows_of(self), "segments": segments}
