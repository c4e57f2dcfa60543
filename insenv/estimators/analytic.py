"""`analytic`: the textbook coarse alignment of a vehicle at rest, from two mean vectors (TRIAD).

The mean specific force is minus gravity and the mean rate is the Earth's; down and east follow:

    down^b = -f^b / |f^b|,   east^b = down^b x omega^b / |down^b x omega^b|,   north^b = east^b x down^b
    C_nb = [north^b east^b down^b]^T

Source: Titterton and Weston (2004), section 10.3; TRIAD: Black, AIAA Journal 2 (1964), with gravity as the trusted
vector. Any attitude, both hemispheres, not at the poles. The attitude is assumed constant: sway, people and engines
enter the means directly, and the noise of heading falls only as the square root of time.

Stated accuracy: biases, white noise and the motion itself. The integrals of rate and specific force of a vehicle at
rest are straight lines, so their scatter about a straight line (`spread`) is motion and noise: the attitude of now
differs from the mean by that of the angle, and either mean is wrong by the scatter at both ends over the time. Where the
path ends further from that line than its scatter (`departure`: somebody has just stepped in), this distance counts. The
latitude is used by the stated accuracy only.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import cos, maximum, minimum, select, sin
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, rows

LARGEST_SIGMA = math.pi  # rad: heading unknown
TURN = 2.0  # square of the attitude of now less the mean over the variance of the angle: a margin for short runs
ENDS = 4.0  # square of the difference of two ends of a path over its variance: those of a sine, and a margin

PARAMETERS = rows.chosen(rows.PLACE, "latitude") + rows.NOISES

STATE = Table((
    Row("angle", "Sum of the delta angles", "rad", (3,), "b"),
    Row("velocity", "Sum of the delta velocities", "m/s", (3,), "b"),
    Row("time", "Time since the start", "s"),
    Row("first", "Angular rate and specific force of the first sample", "rad/s, m/s^2", (6,), "b"),
    Row("path", "Integral of the angle, and of the velocity, less those of constant first values", "rad s, m", (6,), "b"),
    Row("path_moment", "Its integral weighted with time", "rad s^2, m s", (6,), "b"),
    Row("path_square", "Integral of the square", "rad^2 s, m^2/s", (6,), "b"),
))  # fmt: skip


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    increments = ca.vertcat(u.delta_angle, u.delta_velocity)
    first = select(x.time == 0, increments / u.dt, x.first)
    middle = x.time + u.dt / 2
    gained = ca.vertcat(x.angle, x.velocity) + increments / 2 - first * middle  # small, so that squares lose no digits
    return {
        "angle": x.angle + u.delta_angle,
        "velocity": x.velocity + u.delta_velocity,
        "time": x.time + u.dt,
        "first": first,
        "path": x.path + gained * u.dt,
        "path_moment": x.path_moment + gained * (middle * u.dt),
        "path_square": x.path_square + gained**2 * u.dt,
    }


def spread(x: Any) -> Any:
    """Variance of the angle (3, rad^2, b) and of the velocity (3, m^2/s^2, b) about straight lines over the run."""
    time, mean, slope = _line(x)
    return maximum(x.path_square / time - mean**2 - slope**2 * time**2 / 12, 0.0)


def departure(x: Any) -> Any:
    """The angle (3, rad, b) and the velocity (3, m/s, b) now less those straight lines."""
    time, mean, slope = _line(x)
    return ca.vertcat(x.angle, x.velocity) - x.first * time - mean - slope * time / 2


def _line(x: Any) -> tuple[Any, Any, Any]:
    time = maximum(x.time, 1e-6)
    return time, x.path / time, (x.path_moment - x.path * time / 2) * (12 / time**3)


def triad(force_b: Any, rate_b: Any) -> Any:
    """C_nb (3x3) from specific force and angular rate at rest (3 each, b, any unit)."""
    down = -_unit(force_b)
    east = _unit(ca.cross(down, rate_b))
    return ca.horzcat(ca.cross(east, down), east, down).T


def _unit(v: Any) -> Any:
    length = ca.sqrt(ca.sumsqr(v))
    return v / (length + (length == 0))


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude from the means so far."""
    time, g, scatter, end = maximum(x.time, 1e-6), geodesy.NOMINAL_GRAVITY, spread(x), departure(x)
    C_nb = triad(x.velocity, x.angle)
    turned = maximum((C_nb * C_nb) @ scatter[:3], (C_nb @ end[:3]) ** 2 / TURN)  # n
    pushed = maximum((C_nb * C_nb) @ scatter[3:], (C_nb @ end[3:]) ** 2 / TURN)
    ends = ENDS / time**2
    tilt = (p.accel_bias_sigma**2 + p.velocity_random_walk**2 / time + ends * (pushed[0] + pushed[1]) / 2) / g**2
    rate = p.gyro_bias_sigma**2 + p.angle_random_walk**2 / time + ends * turned[1]
    earth_rate = geodesy.OMEGA_IE * maximum(ca.fabs(cos(p.latitude)), 1e-9)
    heading = (rate + tilt * (geodesy.OMEGA_IE * sin(p.latitude)) ** 2) / earth_rate**2
    variance = ca.vertcat(tilt, tilt, heading) + TURN * turned
    return {
        "q_nb": attitude.from_dcm(C_nb),
        "attitude_sigma": minimum(ca.sqrt(variance), LARGEST_SIGMA),
    }


MODEL = Model(
    id="analytic",
    title="textbook static coarse alignment from mean specific force and rate",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=rows.ALIGNMENT,
    steps={"sample": Step(sample)},
    output=output,
)


ESTIMATOR = Estimator(MODEL, kind="alignment", applicability=applicability.notes)
