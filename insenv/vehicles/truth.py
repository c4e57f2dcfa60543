"""Truth: from a vehicle's law of motion to the increments of a perfect IMU.

A vehicle defines its attitude angles and the velocity of its centre of motion as functions of a state whose flow over a
sample has a closed form. Everything else is derived here, once for all vehicles: body rate and acceleration by
differentiating these functions along the flow, the velocity of the IMU with its lever arm, specific force by the
navigation equation, increments and position by Gauss-Lobatto quadrature over the sample, whose end is evaluated once
for this sample and the next. There are no splines, no end effects and no filter between pose and IMU.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from math import sqrt
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv.base.errors import InputError, naming
from insenv.core.compose import Part
from insenv.core.elementary import polynomial, sin_cos
from insenv.core.model import Step, Values
from insenv.core.tables import Row, Table, check_rows
from insenv.geodesy import E2, OMEGA_IE, A, bounded_place_rows, normal_gravity_about_axis, place_rows, radii

# The instants within a sample at which the truth is evaluated: the four Gauss-Lobatto nodes, the first being its
# start.
#
# They integrate polynomials of degree 5 exactly, as three Gauss-Legendre nodes do; but because the end of a sample is the
# start of the next, three evaluations per sample give both the integrals and the truth at the end.  For a motion of
# angular frequency w the relative error over a sample of length h is (w h)^6 / 1512000.  Abramowitz and Stegun 1964, eq.
# 25.4.32 and table 25.6.

EDGE = 0.5 - sqrt(0.2) / 2.0
"""The second node as a fraction of the sample; also the distance from the third node to the end."""
INNER = sqrt(0.2)
"""Distance from the second node to the third."""
PLACES = (EDGE, 1.0 - EDGE, 1.0)
"""The nodes after the start, as fractions of the sample."""
END_WEIGHT = 1.0 / 12.0
"""Weight of the start and of the end."""
WEIGHTS = (5.0 / 12.0, 5.0 / 12.0, END_WEIGHT)
"""Weights of `PLACES`."""


SineCosine = tuple[Any, Any]
Kinematics = Callable[[Values, Values, Sequence[SineCosine]], Sequence[Any]]


@dataclass(frozen=True, eq=False)
class Vehicle:
    """The law of motion of a vehicle, as pure functions of CasADi symbols.

    id, title: short name, and one line for listings.
    parameters, state, inputs: its rows, with names other than those of `TRUTH_PARAMETERS` and `TRUTH_STATE`.
    along: ``(p, x) -> [rows that change within a sample]`` at the nodes `nodes.PLACES` (fractions of p.sample_interval)
        of the sample that starts at x, the last of them its end; exact.
    derivative: ``(p, x) -> {row: time derivative}`` of the same rows.
    angles: ``(p, x) -> [roll, pitch, heading, ...]`` rad, followed by any other angle whose sine and cosine
        `velocity_n` needs.
    velocity_n: ``(p, x, [(sine, cosine) of each angle]) -> 3x1`` velocity of the centre of motion in n, m/s.
    start: ``(p) -> {row: value}``, or ``(p, r)`` if `start_uniforms` > 0.
    hold: ``(p, x, u) -> {row: value}``, rows set at the start of a sample and constant over it, or ``(p, x, u, r)`` if
        `hold_uniforms` > 0.
    steps: conditional steps that run before the step ``sample`` (commands).

    The angles must change by less than 0.25 rad per sample; their rates and `velocity_n` must be continuous from sample
    to sample.  The acceleration should be: a sample takes that at its start from the end of the one before, so that a jump
    there puts 1/12 of the jump times the sample interval into the increment.
    """

    id: str
    title: str
    parameters: Table
    state: Table
    along: Callable[[Values, Values], Sequence[Mapping[str, Any]]]
    derivative: Callable[[Values, Values], Mapping[str, Any]]
    angles: Callable[[Values, Values], Sequence[Any]]
    velocity_n: Callable[[Values, Values, Sequence[SineCosine]], Any]
    start: Callable[..., Mapping[str, Any]]
    start_uniforms: int = 0
    hold: Callable[..., Mapping[str, Any]] | None = None
    hold_uniforms: int = 0
    inputs: Table = field(default_factory=Table)
    steps: Mapping[str, Step] = field(default_factory=dict)


TRUTH_PARAMETERS = Table((
    *bounded_place_rows("start_", " of the IMU at time 0"),
    Row("imu_lever_arm_b", "From the vehicle's centre of motion to the IMU", "m", (3,), "b"),
    Row("gravity_disturbance_n", "True gravity minus normal gravity", "m/s^2", (3,), "n", lower=-1.0, upper=1.0),
))  # fmt: skip

TRUTH_STATE = Table((
    Row("q_nb", "True attitude, unit quaternion, scalar first, from b to n", "1", (4,), "n", (1, 0, 0, 0)),
    Row("velocity_n", "True velocity of the IMU relative to the Earth", "m/s", (3,), "n"),
    *place_rows("", ", true, of the IMU"),
    Row("true_delta_angle", "Integral of omega_ib^b over the last sample", "rad", (3,), "b"),
    Row("true_delta_velocity", "Integral of the specific force f^b over the last sample", "m/s", (3,), "b"),
    Row("rate_nb_b", "True angular rate of the body relative to n, omega_nb^b", "rad/s", (3,), "b"),
    Row("rate_ib_b", "True inertial angular rate of the body, omega_ib^b", "rad/s", (3,), "b"),
    Row("steady_force_b", "True specific force f^b without the term angular acceleration times lever arm", "m/s^2", (3,), "b"),
))  # fmt: skip


def truth_part(vehicle: Vehicle) -> Part:
    """The part of a plant that moves `vehicle` and computes the true increments.

    Steps: the conditional steps of the vehicle, then ``sample``, which advances by the parameter ``sample_interval``
    (declared elsewhere). Parameters and state: those of the vehicle, TRUTH_PARAMETERS and TRUTH_STATE.
    """
    kinematics = _kinematics(vehicle)

    def start(p: Values, *r: Any) -> dict[str, Any]:
        x = vehicle.state.symbols(ca.SX(ca.DM(vehicle.state.start_vector())))
        with naming("start of the vehicle"):
            x = _with(x, check_rows(vehicle.start(p, *r), vehicle.state))
        half = [sin_cos(0.5 * angle) for angle in vehicle.angles(p, x)]
        motion = _Motion([_doubled(pair) for pair in half], kinematics, p, x)
        earth = _Earth(*sin_cos(p.start_latitude), p.start_height)
        moving = {name: getattr(x, name) for name in vehicle.state.names}
        position = {"latitude": p.start_latitude, "longitude": p.start_longitude, "height": p.start_height}
        return {**moving, **position, "q_nb": _quaternion(half), **motion.rows(earth, p.start_height)}

    def sample(p: Values, x: Values, u: Values, *r: Any) -> dict[str, Any]:
        held = {} if vehicle.hold is None else vehicle.hold(p, x, u, *r)
        x = _with(x, held)
        with naming("along"):
            moving = [check_rows(rows, vehicle.state) for rows in vehicle.along(p, x)]
            if len(moving) != len(PLACES):
                raise InputError(f"{len(moving)} results: allowed are {len(PLACES)}, one for each node of PLACES")
        places = [_with(x, rows) for rows in moving]
        half, trigonometry = _trigonometry([vehicle.angles(p, place) for place in places])
        motions = [_Motion(pairs, kinematics, p, place) for pairs, place in zip(trigonometry, places, strict=True)]
        return {**held, **moving[-1], "q_nb": _quaternion(half), **_integrated(p, x, motions)}

    return Part(
        parameters=vehicle.parameters + TRUTH_PARAMETERS,
        state=vehicle.state + TRUTH_STATE,
        inputs=vehicle.inputs,
        steps={**vehicle.steps, "sample": Step(sample, uniforms=vehicle.hold_uniforms)},
        start=start,
        start_uniforms=vehicle.start_uniforms,
    )


def truth_instant(vehicle: Vehicle) -> Callable[[Values, Values], tuple[Any, Any, Any]]:
    """The function (p, x) -> omega_eb^b (3, rad/s), its time derivative (3, rad/s^2) and that of velocity_n (3, m/s^2) at
    the end of the last sample.

    For sensors that measure on few samples; the sample itself does not need these quantities. The derivative of the
    transport rate (acceleration over the Earth's radius) is left out of the second.
    """
    kinematics = _kinematics(vehicle)

    def instant(p: Values, x: Values) -> tuple[Any, Any, Any]:
        motion = _Motion([sin_cos(angle) for angle in vehicle.angles(p, x)], kinematics, p, x)
        earth = _Earth(*sin_cos(x.latitude), x.height)
        transport_b = motion.C_nb.T @ earth.transport_rate_n(motion.velocity_n)
        rate_change_b = motion.omega_dot - ca.cross(motion.omega_nb_b, transport_b)
        arm_acceleration_b = ca.cross(motion.omega_dot, p.imu_lever_arm_b) + motion.centripetal_b
        return motion.omega_nb_b + transport_b, rate_change_b, motion.centre_acceleration_n + motion.C_nb @ arm_acceleration_b

    return instant


def _with(x: Values, rows: Mapping[str, Any]) -> Values:
    """x with some rows replaced."""
    return SimpleNamespace(**{**vars(x), **rows})


def _kinematics(vehicle: Vehicle) -> Kinematics:
    """(p, x, sines, cosines of the angles) -> omega_nb^b, its derivative, velocity of the centre of motion in
    n, its derivative.

    All derivatives are taken along the vehicle's flow; sines and cosines are variables of their own, s' = c
    angle', c' = -s angle'.
    """
    p_flat, x_flat = ca.SX.sym("p", vehicle.parameters.size), ca.SX.sym("x", vehicle.state.size)
    p, x = vehicle.parameters.symbols(p_flat), vehicle.state.symbols(x_flat)
    still = {row.name: ca.SX(*(row.shape + (1, 1))[:2]) for row in vehicle.state}
    flow = vehicle.state.assemble({**still, **vehicle.derivative(p, x)})
    angles = ca.vertcat(*vehicle.angles(p, x))
    if angles.numel() < 3:
        raise InputError(f"angles: {angles.numel()} results: allowed are roll, pitch, heading, and further angles after them")
    s, c = ca.SX.sym("s", angles.numel()), ca.SX.sym("c", angles.numel())
    rates = ca.jtimes(angles, x_flat, flow)
    along = ca.vertcat(x_flat, s, c), ca.vertcat(flow, c * rates, -s * rates)
    velocity = vehicle.velocity_n(p, x, [(s[i], c[i]) for i in range(angles.numel())])
    if getattr(velocity, "shape", ()) != (3, 1):
        raise InputError(
            f"velocity_n: the result has the shape {getattr(velocity, 'shape', ())}: allowed is (3, 1), as of "
            "casadi.vertcat(north, east, down)"
        )
    # omega_nb^b: the heading rate about D, the pitch rate about E' and the roll rate about N'' = b's x axis
    roll_rate, pitch_rate, heading_rate = rates[0], rates[1], rates[2]
    omega = ca.vertcat(
        roll_rate - s[1] * heading_rate,
        c[0] * pitch_rate + s[0] * c[1] * heading_rate,
        c[0] * c[1] * heading_rate - s[0] * pitch_rate,
    )
    results = [omega, ca.jtimes(omega, *along), velocity, ca.jtimes(velocity, *along)]
    function = ca.Function("kinematics", [p_flat, x_flat, s, c], [ca.densify(result) for result in results], {"cse": True})

    def call(p: Values, x: Values, pairs: Sequence[SineCosine]) -> Sequence[Any]:
        flat = [
            table.assemble({name: getattr(values, name) for name in table.names})
            for table, values in ((vehicle.parameters, p), (vehicle.state, x))
        ]
        sines, cosines = zip(*pairs, strict=True)
        return function(*flat, ca.vertcat(*sines), ca.vertcat(*cosines))

    return call


class _Motion:
    """Attitude, body rate, and velocity and acceleration of the IMU at one instant."""

    def __init__(self, pairs: Sequence[SineCosine], kinematics: Kinematics, p: Values, x: Values) -> None:
        (sr, cr), (sp, cp), (sh, ch) = pairs[:3]
        self.C_nb = ca.vertcat(
            ca.horzcat(cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh),
            ca.horzcat(cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch),
            ca.horzcat(-sp, sr * cp, cr * cp),
        )
        self.omega_nb_b, self.omega_dot, velocity, self.centre_acceleration_n = kinematics(p, x, pairs)
        arm_velocity_b = ca.cross(self.omega_nb_b, p.imu_lever_arm_b)
        self.velocity_n = velocity + self.C_nb @ arm_velocity_b
        self.centripetal_b = ca.cross(self.omega_nb_b, arm_velocity_b)
        self.gravity_disturbance_n = p.gravity_disturbance_n

    def inertial(self, earth: _Earth, height: Any) -> tuple[Any, Any]:
        """omega_ib^b (rad/s), and the specific force (m/s^2) without omega_dot x lever arm."""
        omega_in_n = earth.rate_n + earth.transport_rate_n(self.velocity_n)
        coriolis = ca.cross(omega_in_n + earth.rate_n, self.velocity_n)
        gravity_n = normal_gravity_about_axis(earth.axis_n, height) + self.gravity_disturbance_n
        force_n = self.centre_acceleration_n + coriolis - gravity_n
        return self.omega_nb_b + self.C_nb.T @ omega_in_n, self.C_nb.T @ force_n + self.centripetal_b

    def rows(self, earth: _Earth, height: Any) -> dict[str, Any]:
        """The rows of TRUTH_STATE at this instant, except attitude and position."""
        rate, force = self.inertial(earth, height)
        return {"velocity_n": self.velocity_n, "rate_nb_b": self.omega_nb_b, "rate_ib_b": rate, "steady_force_b": force}


def _quaternion(half: Sequence[SineCosine]) -> Any:
    """q_nb (4) from the sines and cosines of half roll, pitch and heading."""
    (sr, cr), (sp, cp), (sh, ch) = half[:3]
    return ca.vertcat(
        cr * cp * ch + sr * sp * sh,
        sr * cp * ch - cr * sp * sh,
        cr * sp * ch + sr * cp * sh,
        cr * cp * sh - sr * sp * ch,
    )


class _Earth:
    """Curvature and rotation of the Earth at one place."""

    def __init__(self, sin_latitude: Any, cos_latitude: Any, height: Any) -> None:
        R_M, R_N = radii(sin_latitude)
        self.per_metre_north = 1.0 / (R_M + height)
        self.per_metre_east = 1.0 / (R_N + height)
        self._turn_to(sin_latitude, cos_latitude)

    def _turn_to(self, sin_latitude: Any, cos_latitude: Any) -> None:
        self.sin_latitude, self.cos_latitude = sin_latitude, cos_latitude
        self.longitude_per_metre = self.per_metre_east / cos_latitude
        self.down_per_metre_east = self.longitude_per_metre * sin_latitude
        self.axis_n = ca.vertcat(cos_latitude, 0.0, -sin_latitude)
        self.rate_n = OMEGA_IE * self.axis_n

    def moved(self, north: Any, down: Any) -> _Earth:
        """A nearby place, `north` (rad) further north and `down` (m) lower; radii to first order."""
        earth, turned = copy(self), 1.0 - 0.5 * north * north
        sine, cosine = self.sin_latitude, self.cos_latitude
        flatter = E2 * sine * cosine * north
        earth.per_metre_north = self.per_metre_north * (1.0 - 3.0 * flatter + down * self.per_metre_north)
        earth.per_metre_east = self.per_metre_east * (1.0 - flatter + down * self.per_metre_east)
        earth._turn_to(sine * turned + cosine * north, cosine * turned - sine * north)
        return earth

    def transport_rate_n(self, velocity_n: Any) -> Any:
        """omega_en^n (rad/s) at a velocity (m/s)."""
        north, east = velocity_n[0], velocity_n[1]
        return ca.vertcat(self.per_metre_east * east, -self.per_metre_north * north, -self.down_per_metre_east * east)


def _integrated(p: Values, x: Values, motions: Sequence[_Motion]) -> dict[str, Any]:
    """Rows of TRUTH_STATE, except the attitude, at the end of the sample that starts at x.

    The term omega_dot x l that a lever arm l adds to the specific force has a closed integral, the change of omega x l.
    At the inner nodes, curvature and rotation of the Earth and the latitude of gravity are those of the middle of the
    sample: over a sample they change linearly by a relative 1e-7, and the error of this approximation is of third
    order. The end, which is the start of the next sample, uses its own values. The largest effect, the change of
    gravity with height, is evaluated at each node.
    """
    h = p.sample_interval
    end = motions[-1]
    way = END_WEIGHT * x.velocity_n
    for weight, motion in zip(WEIGHTS, motions, strict=True):
        way += weight * motion.velocity_n
    sine, cosine = sin_cos(x.latitude)
    height = x.height - h * way[2]
    rough = A * (1.0 - E2) * (1.0 + (1.5 * E2) * sine * sine) + x.height
    north = 0.5 * h * way[0] / rough  # change of latitude up to the middle
    turned = 1.0 - 0.5 * north * north
    middle = _Earth(sine * turned + cosine * north, cosine * turned - sine * north, 0.5 * (x.height + height))
    rows = end.rows(middle.moved(north, 0.5 * h * way[2]), height)

    delta_angle = END_WEIGHT * (x.rate_ib_b + rows["rate_ib_b"])
    delta_velocity = END_WEIGHT * (x.steady_force_b + rows["steady_force_b"])
    for motion, weight, place in zip(motions[:-1], WEIGHTS, PLACES, strict=False):
        sunk = 0.5 * h * place * (x.velocity_n[2] + motion.velocity_n[2])
        rate, force = motion.inertial(middle, x.height - sunk)
        delta_angle += weight * rate
        delta_velocity += weight * force
    return rows | {
        "latitude": x.latitude + h * way[0] * middle.per_metre_north,
        "longitude": x.longitude + h * way[1] * middle.longitude_per_metre,
        "height": height,
        "true_delta_angle": h * delta_angle,
        "true_delta_velocity": h * delta_velocity + ca.cross(end.omega_nb_b - x.rate_nb_b, p.imu_lever_arm_b),
    }


_SHORT_SINE = (1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0)
_SHORT_COSINE = (1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0)


def _turned(pair: SineCosine, angle: Any) -> SineCosine:
    """Sine and cosine of an angle increased by `angle`; error 1e-14 for |angle| < 0.25 rad, 1e-18 for 0.1 rad."""
    square = angle * angle
    s, c = angle * polynomial(square, _SHORT_SINE), polynomial(square, _SHORT_COSINE)
    return pair[0] * c + pair[1] * s, pair[1] * c - pair[0] * s


def _doubled(pair: SineCosine) -> SineCosine:
    """Sine and cosine of twice the angle."""
    s, c = pair
    return 2.0 * s * c, 1.0 - 2.0 * s * s


def _trigonometry(angles: Sequence[Sequence[Any]]) -> tuple[list[SineCosine], list[list[SineCosine]]]:
    """Sines and cosines of half the angles at the end, and of the angles at `nodes.PLACES`, with one full evaluation.

    angles: values at `nodes.PLACES`.
    """
    half = [sin_cos(0.5 * angle) for angle in angles[-1]]
    at_end = [_doubled(pair) for pair in half]

    def near(place: Sequence[Any]) -> list[SineCosine]:
        return [_turned(pair, a - b) for pair, a, b in zip(at_end, place, angles[-1], strict=True)]

    return half, [*map(near, angles[:-1]), at_end]
