"""Truth: from a vehicle's law of motion to the increments that a perfect IMU would give.

A vehicle says how it moves: attitude angles and the velocity of its centre of motion as functions of a state
whose flow over a sample is known in closed form. Everything else is derived here, once for all vehicles: body
rate and acceleration by differentiating those functions along the flow, the IMU's velocity by its lever arm,
specific force by the navigation equation, increments and position by Gauss-Legendre quadrature over the
sample. No splines, no end effects, no filter between pose and IMU.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv.core.compose import Part
from insenv.core.elementary import polynomial, sin_cos
from insenv.core.model import Step, Values
from insenv.core.tables import Row, Table
from insenv.geodesy import E2, OMEGA_IE, A, normal_gravity, radii
from insenv.vehicles.nodes import NODES, WEIGHTS

SineCosine = tuple[Any, Any]
Kinematics = Callable[[Values, Values, Sequence[SineCosine]], Sequence[Any]]


@dataclass(frozen=True)
class Vehicle:
    """The law of motion of one vehicle, as pure functions over CasADi symbols.

    id, title: short name, and one line for listings.
    parameters, state, inputs: its rows, named unlike those of `TRUTH_PARAMETERS` and `TRUTH_STATE`.
    along: ``(p, x) -> [rows that move within a sample]`` at the three Gauss-Legendre nodes and at the end of
    the sample that
        starts at x (fractions `nodes.PLACES` of p.sample_interval), exact.
    derivative: ``(p, x) -> {row: time derivative}`` of the same rows.
    angles: ``(p, x) -> [roll, pitch, heading, ...]`` rad, then any other angle whose sine and cosine
    `velocity_n` wants.
    velocity_n: ``(p, x, [(sine, cosine) of each angle]) -> 3x1`` velocity of the centre of motion in NED,
    m/s.
    start: ``(p) -> {row: value}``, or ``(p, r)`` if `start_uniforms` > 0.
    hold: ``(p, x, u) -> {row: value}`` chosen at the start of a sample and held over it, or ``(p, x, u, r)``
    if `hold_uniforms` > 0.
    steps: rare steps that stand before the sample (commands).

    The angles must turn by less than 0.25 rad in half a sample.
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
    Row("start_latitude", "Geodetic latitude of the IMU at time 0", "rad", lower=-1.5707963267948966, upper=1.5707963267948966),
    Row("start_longitude", "Longitude of the IMU at time 0", "rad", lower=-6.283185307179587, upper=6.283185307179587),
    Row("start_height", "Height of the IMU above the WGS-84 ellipsoid at time 0", "m", lower=-1e4, upper=1e5),
    Row("imu_lever_arm_b", "From the vehicle's centre of motion to the IMU", "m", (3,), "b"),
))  # fmt: skip

TRUTH_STATE = Table((
    Row("q_nb", "True attitude, unit quaternion, scalar first, from b to n", "1", (4,), "n", (1, 0, 0, 0)),
    Row("velocity_n", "True velocity of the IMU relative to the Earth", "m/s", (3,), "n"),
    Row("latitude", "True geodetic latitude of the IMU", "rad"),
    Row("longitude", "True longitude of the IMU, not wrapped", "rad"),
    Row("height", "True height of the IMU above the WGS-84 ellipsoid", "m"),
    Row("true_delta_angle", "Integral of omega_ib^b over the last sample", "rad", (3,), "b"),
    Row("true_delta_velocity", "Integral of the specific force f^b over the last sample", "m/s", (3,), "b"),
    Row("rate_eb_b", "True angular rate of the body relative to the Earth, omega_eb^b", "rad/s", (3,), "b"),
    Row("acceleration_n", "Time derivative of velocity_n's components at the end of the last sample", "m/s^2", (3,), "n"),
))  # fmt: skip


def truth_part(vehicle: Vehicle) -> Part:
    """The part of a plant that moves `vehicle` and makes true increments.

    Steps: the vehicle's own rare ones, then ``sample``, which advances by the parameter ``sample_interval``
    (declared elsewhere).
    Parameters and state: the vehicle's and TRUTH_PARAMETERS, TRUTH_STATE.
    """
    kinematics = _kinematics(vehicle)

    def start(p: Values, *r: Any) -> dict[str, Any]:
        x = _with(vehicle.state.symbols(ca.SX(ca.DM(vehicle.state.start_vector()))), vehicle.start(p, *r))
        half = [sin_cos(0.5 * angle) for angle in vehicle.angles(p, x)]
        end = _End(half, kinematics, p, x)
        sin_latitude, cos_latitude = sin_cos(p.start_latitude)
        earth = _Earth(sin_latitude, cos_latitude, p.start_height)
        moving = {name: getattr(x, name) for name in vehicle.state.names}
        position = {"latitude": p.start_latitude, "longitude": p.start_longitude, "height": p.start_height}
        return {**moving, **position, **end.rows(earth)}

    def sample(p: Values, x: Values, u: Values, *r: Any) -> dict[str, Any]:
        held = {} if vehicle.hold is None else vehicle.hold(p, x, u, *r)
        x = _with(x, held)
        moving = vehicle.along(p, x)
        places = [_with(x, rows) for rows in moving]
        half, trigonometry = _trigonometry([vehicle.angles(p, place) for place in places])
        nodes = [_Motion(pairs, kinematics, p, place) for pairs, place in zip(trigonometry, places[:3], strict=True)]
        end = _End(half, kinematics, p, places[3])
        return {**held, **moving[3], **_integrated(p, x, nodes, end)}

    return Part(
        parameters=vehicle.parameters + TRUTH_PARAMETERS,
        state=vehicle.state + TRUTH_STATE,
        inputs=vehicle.inputs,
        steps={**vehicle.steps, "sample": Step(sample, uniforms=vehicle.hold_uniforms)},
        start=start,
        start_uniforms=vehicle.start_uniforms,
    )


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
    s, c = ca.SX.sym("s", angles.numel()), ca.SX.sym("c", angles.numel())
    rates = ca.jtimes(angles, x_flat, flow)
    along = ca.vertcat(x_flat, s, c), ca.vertcat(flow, c * rates, -s * rates)
    velocity = vehicle.velocity_n(p, x, [(s[i], c[i]) for i in range(angles.numel())])
    # omega_nb^b from Euler rates, as attitude.euler_rates_to_body_rate
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
    """Attitude, body rate and the IMU's velocity and acceleration at one instant."""

    def __init__(self, pairs: Sequence[SineCosine], kinematics: Kinematics, p: Values, x: Values) -> None:
        (sr, cr), (sp, cp), (sh, ch) = pairs[:3]
        self.C_nb = ca.vertcat(
            ca.horzcat(cp * ch, sr * sp * ch - cr * sh, cr * sp * ch + sr * sh),
            ca.horzcat(cp * sh, sr * sp * sh + cr * ch, cr * sp * sh - sr * ch),
            ca.horzcat(-sp, sr * cp, cr * cp),
        )
        self.omega_nb_b, omega_dot, velocity, acceleration = kinematics(p, x, pairs)
        arm_velocity_b = ca.cross(self.omega_nb_b, p.imu_lever_arm_b)
        self.velocity_n = velocity + self.C_nb @ arm_velocity_b
        self.centre_acceleration_n = acceleration
        self.arm_acceleration_b = ca.cross(omega_dot, p.imu_lever_arm_b) + ca.cross(self.omega_nb_b, arm_velocity_b)


class _End(_Motion):
    """The motion at the end of a sample: what the state keeps of it."""

    def __init__(self, half: Sequence[SineCosine], kinematics: Kinematics, p: Values, x: Values) -> None:
        super().__init__([_doubled(pair) for pair in half], kinematics, p, x)
        (sr, cr), (sp, cp), (sh, ch) = half[:3]
        self.q_nb = ca.vertcat(
            cr * cp * ch + sr * sp * sh,
            sr * cp * ch - cr * sp * sh,
            cr * sp * ch + sr * cp * sh,
            cr * cp * sh - sr * sp * ch,
        )

    def rows(self, earth: _Earth) -> dict[str, Any]:
        """Rows of TRUTH_STATE that an instant has."""
        return {
            "q_nb": self.q_nb,
            "velocity_n": self.velocity_n,
            "rate_eb_b": self.omega_nb_b + self.C_nb.T @ earth.transport_rate_n(self.velocity_n),
            "acceleration_n": self.centre_acceleration_n + self.C_nb @ self.arm_acceleration_b,
        }


class _Earth:
    """Curvature and rotation of the Earth at one place."""

    def __init__(self, sin_latitude: Any, cos_latitude: Any, height: Any) -> None:
        R_M, R_N = radii(sin_latitude)
        self.sin_latitude = sin_latitude
        self.per_metre_north = 1.0 / (R_M + height)
        self.per_metre_east = 1.0 / (R_N + height)
        self.longitude_per_metre = self.per_metre_east / cos_latitude
        self.down_per_metre_east = self.longitude_per_metre * sin_latitude
        self.rate_n = ca.vertcat(OMEGA_IE * cos_latitude, 0.0, -OMEGA_IE * sin_latitude)

    def transport_rate_n(self, velocity_n: Any) -> Any:
        """omega_en^n (rad/s) at a velocity (m/s)."""
        north, east = velocity_n[0], velocity_n[1]
        return ca.vertcat(self.per_metre_east * east, -self.per_metre_north * north, -self.down_per_metre_east * east)


def _integrated(p: Values, x: Values, nodes: Sequence[_Motion], end: _End) -> dict[str, Any]:
    """Rows of TRUTH_STATE at the end of the sample that starts at x.

    The Earth's curvature and rotation and the gravity's latitude are those of the sample's middle, reached
    through the velocity's parabola: over a sample they change by 1e-7 of themselves, linearly, and what a
    linear change leaves is third order. Gravity's change with height, the largest, is followed at each node.
    """
    h = p.sample_interval
    sine, cosine = sin_cos(x.latitude)
    rough = A * (1.0 - E2) * (1.0 + (1.5 * E2) * sine * sine) + x.height
    north = 0.25 * h * (x.velocity_n[0] + nodes[1].velocity_n[0]) / rough  # latitude's change up to the middle
    down = [0.5 * h * place * (x.velocity_n[2] + node.velocity_n[2]) for place, node in zip(NODES, nodes, strict=True)]
    turned = 1.0 - 0.5 * north * north
    earth = _Earth(sine * turned + cosine * north, cosine * turned - sine * north, x.height - down[1])

    delta_angle, delta_velocity, way = ca.SX(3, 1), ca.SX(3, 1), ca.SX(3, 1)
    for node, weight, sunk in zip(nodes, WEIGHTS, down, strict=True):
        gravity = normal_gravity(earth.sin_latitude, x.height - sunk)
        omega_in_n = earth.rate_n + earth.transport_rate_n(node.velocity_n)
        coriolis = ca.cross(omega_in_n + earth.rate_n, node.velocity_n)
        force_n = node.centre_acceleration_n + coriolis - ca.vertcat(0.0, 0.0, gravity)
        delta_angle += weight * (node.omega_nb_b + node.C_nb.T @ omega_in_n)
        delta_velocity += weight * (node.C_nb.T @ force_n + node.arm_acceleration_b)
        way += weight * node.velocity_n
    return end.rows(earth) | {
        "latitude": x.latitude + h * way[0] * earth.per_metre_north,
        "longitude": x.longitude + h * way[1] * earth.longitude_per_metre,
        "height": x.height - h * way[2],
        "true_delta_angle": h * delta_angle,
        "true_delta_velocity": h * delta_velocity,
    }


_SHORT_SINE = (1.0, -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362880.0)
_SHORT_COSINE = (1.0, -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40320.0, -1.0 / 3628800.0)


def _turned(pair: SineCosine, angle: Any) -> SineCosine:
    """Sine and cosine of an angle that is `angle` further on; |angle| < 0.25 rad leaves 1e-14, 0.1 rad 1e-18."""
    square = angle * angle
    s, c = angle * polynomial(square, _SHORT_SINE), polynomial(square, _SHORT_COSINE)
    return pair[0] * c + pair[1] * s, pair[1] * c - pair[0] * s


def _doubled(pair: SineCosine) -> SineCosine:
    """Sine and cosine of twice the angle."""
    s, c = pair
    return 2.0 * s * c, 1.0 - 2.0 * s * s


def _trigonometry(angles: Sequence[Sequence[Any]]) -> tuple[list[SineCosine], list[list[SineCosine]]]:
    """Half the angles' sines and cosines at the end, and the angles' own at the nodes: one full evaluation,
    at the middle node.

    angles: at the three nodes and the end.
    """
    first, middle, last, end = angles
    half = [sin_cos(0.5 * angle) for angle in middle]
    at_middle = [_doubled(pair) for pair in half]

    def near(place: Sequence[Any]) -> list[SineCosine]:
        return [_turned(pair, a - b) for pair, a, b in zip(at_middle, place, middle, strict=True)]

    half_end = [_turned(pair, 0.5 * (a - b)) for pair, a, b in zip(half, end, middle, strict=True)]
    return half_end, [near(first), at_middle, near(last)]
