"""An independent nonlinear mechanization in the Earth-fixed frame, in plain NumPy, and a motion known in closed form.

It shares no line with insenv: no frame w or n, no Somigliana formula, no quaternion, no increments, no small angles.
Error states are vectors in e, estimate minus truth: position (m), velocity (m/s), phi (rad) with C_hat = (I - [phi x]) C,
and the biases left in rate (rad/s, b) and specific force (m/s^2, b).
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import pymap3d
from scipy.spatial.transform import Rotation

EARTH_RATE = np.array([0.0, 0.0, 7.292115e-5])  # rad/s
AXIS, FLATTENING, GM = 6378137.0, 1 / 298.257223563, 3.986004418e14
POSITION, VELOCITY, PHI, GYRO, ACCEL = (slice(i, i + 3) for i in range(0, 15, 3))
SCALE = np.repeat([10.0, 0.1, 1e-5, 1e-7, 1e-4], 3)
"""Sizes of the error states for differences."""


def skew(v):
    """Matrices (..., 3, 3) with skew(v) u = v x u."""
    x, y, z = np.moveaxis(np.asarray(v, float), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)


def gravity(r):
    """Gravity (..., 3, m/s^2, e) at r (..., 3, m), to the precision of r: the gradient of the ellipsoid's normal potential.

    Heiskanen and Moritz 1967, eqs. (2-62), (2-66), with the centrifugal part; neither Somigliana's formula nor its gammas.
    """
    a = np.asarray(r).dtype.type(AXIS)
    b = a - a * FLATTENING
    E2 = a * a - b * b
    E, rate = np.sqrt(E2), EARTH_RATE[2]
    x, y, z = np.moveaxis(np.asarray(r), -1, 0)
    across = x * x + y * y
    k = across + z * z - E2
    u2 = k / 2 * (1 + np.sqrt(1 + 4 * E2 * z * z / (k * k)))
    u, v2 = np.sqrt(u2), u2 + E2
    v = np.sqrt(v2)
    sine, cosine = z / u, np.sqrt(across) / v  # of the reduced latitude

    def q(t):  # ((1 + 3 t^2 / E^2) arctan(E / t) - 3 t / E) / 2, without its loss of digits
        return sum(-2 * (-1) ** n * n / ((2 * n + 1) * (2 * n + 3)) * (E / t) ** (2 * n + 1) for n in range(1, 15))

    q_prime = 3 * (1 + u2 / E2) * (1 - u / E * np.arctan(E / u)) - 1
    w = np.sqrt((u2 + E2 * sine**2) / v2)
    centre = rate**2 * a * a
    along_u = -(GM / v2 + centre * E / v2 * q_prime / q(b) * (sine**2 / 2 - 1 / 6) - rate**2 * u * cosine**2) / w
    along_beta = (centre / v * q(u) / q(b) - rate**2 * v) * sine / w  # over cosine
    outward = (along_u * u / v - along_beta * sine) / (w * v)  # over the distance from the axis
    axial = along_u * sine / w + along_beta * u * cosine**2 / (w * v)
    return np.stack([outward * x, outward * y, axial], axis=-1)


def geodetic(r):
    """Latitude, longitude (rad) and height (m) of r (..., 3)."""
    return pymap3d.ecef2geodetic(*np.moveaxis(np.asarray(r, float), -1, 0), deg=False)


def quaternion_of(C):
    return Rotation.from_matrix(C).as_quat(scalar_first=True)


def matrix_of(q):
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def tangent(q):
    """(0, u) (x) q as a matrix times u: of a quaternion error dQ, 2 tangent^T dQ is a rotation in w."""
    w, x, y, z = q
    return np.array([[-x, -y, -z], [w, z, -y], [-z, w, x], [y, -x, w]])


def stored(P):
    """The triangle of a covariance as a state has it."""
    return np.concatenate([P[: j + 1, j] for j in range(len(P))])


def frame_n(r):
    """C_en (..., 3, 3): north, east, down as columns."""
    latitude, longitude, _ = geodetic(r)
    s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    north = np.stack([-s * cl, -s * sl, c], -1)
    east = np.stack([-sl, cl, 0 * sl], -1)
    return np.stack([north, east, np.cross(north, east)], -1)


def frame_turn(r, C_ew):
    """3x3: rotation (rad, w) of a frame that is moved by dr (m, w) along with the vertical, without turning about it."""
    down = np.array([frame_n(r + sign * C_ew[:, i])[:, 2] for i in range(3) for sign in (1, -1)])
    change = C_ew.T @ (down[0::2] - down[1::2]).T / 2  # = turn x down
    return np.array([-change[1], change[0], 0 * change[0]])


@dataclass(frozen=True)
class Motion:
    """A flight at 250 m/s in wide curves, as functions of time (s, any shape); everything in closed form.

    The centre of motion follows a circle about the Earth's centre with slow swings along and across; the attitude swings by
    tens of degrees about two axes. latitude (rad) and height (m) are those of the circle's start.
    """

    latitude: float = 0.6
    longitude: float = 0.4
    height: float = 900.0
    speed: float = 250.0
    heading: float = 0.9
    swings: tuple[tuple[float, float, float, tuple[float, float, float]], ...] = (
        (300.0, 0.11, 0.4, (0.3, -0.8, 0.1)),
        (60.0, 0.23, 1.3, (0.1, 0.2, 1.0)),
    )
    """Amplitude m, angular frequency rad/s, phase rad, direction in n at the start."""
    turns: tuple[tuple[float, float, float, tuple[float, float, float]], ...] = (
        (0.7, 0.13, 0.2, (0.2, -0.3, 0.9)),
        (0.4, 0.31, 1.0, (0.9, 0.4, -0.1)),
    )
    """Amplitude rad, angular frequency rad/s, phase rad, axis: two rotations one after the other."""

    @cached_property
    def _begin(self):
        centre = np.array(pymap3d.geodetic2ecef(self.latitude, self.longitude, self.height, deg=False))
        C = frame_n(centre)
        ahead = C @ [np.cos(self.heading), np.sin(self.heading), 0.0]
        out = centre / np.linalg.norm(centre)
        ahead = ahead - out * (out @ ahead)
        return np.linalg.norm(centre), out, ahead / np.linalg.norm(ahead), C

    def _derivative(self, t, order):
        radius, out, ahead, C = self._begin
        t = np.asarray(t, float)[..., None]
        turn = self.speed / radius
        quarter = order * np.pi / 2
        r = radius * turn**order * (np.cos(turn * t + quarter) * out + np.sin(turn * t + quarter) * ahead)
        for size, rate, phase, direction in self.swings:
            r = r + size * rate**order * np.sin(rate * t + phase + quarter) * (C @ np.array(direction))
        return r

    def position(self, t):
        """r_e (..., 3), m."""
        return self._derivative(t, 0)

    def velocity(self, t):
        """v_e (..., 3), m/s."""
        return self._derivative(t, 1)

    def _turns(self, t):
        """Matrices (..., 3, 3) and rates (..., 3) of both rotations."""
        t = np.asarray(t, float)[..., None]
        for size, rate, phase, axis in self.turns:
            unit = np.array(axis) / np.linalg.norm(axis)
            angle = size * np.sin(rate * t + phase) * unit
            C = Rotation.from_rotvec(angle.reshape(-1, 3)).as_matrix().reshape(*angle.shape, 3)
            yield C, size * rate * np.cos(rate * t + phase) * unit

    def attitude(self, t):
        """C_eb (..., 3, 3)."""
        (first, _), (second, _) = self._turns(t)
        return first @ second

    def rate(self, t):
        """omega_ib^b (..., 3), rad/s."""
        (first, by_first), (_, by_second) = self._turns(t)
        over_e = by_first + np.einsum("...ij,...j->...i", first, by_second)
        return np.einsum("...ji,...j->...i", self.attitude(t), over_e + EARTH_RATE)

    def force(self, t):
        """Specific force (..., 3), m/s^2, b."""
        felt = self._derivative(t, 2) + 2 * np.cross(EARTH_RATE, self.velocity(t)) - gravity(self.position(t))
        return np.einsum("...ji,...j->...i", self.attitude(t), felt)

    def increments(self, dt, count):
        """Integrals of rate (count, 3, rad) and specific force (count, 3, m/s) over samples, by Gauss's formula."""
        nodes, weights = np.polynomial.legendre.leggauss(5)
        t = dt * (np.arange(count)[:, None] + (nodes + 1) / 2)
        return tuple(dt / 2 * np.einsum("k,nki->ni", weights, f(t)) for f in (self.rate, self.force))

    def start(self):
        """Start of a navigation at time 0: rows of `insenv.estimators.parts.rows.START` (w = n there)."""
        r = self.position(0.0)
        latitude, longitude, height = geodetic(r)
        C_nb = frame_n(r).T @ self.attitude(0.0)
        heading, pitch, roll = Rotation.from_matrix(C_nb).as_euler("ZYX")
        place = {"start_latitude": latitude, "start_longitude": longitude, "start_height": height}
        angles = {"start_roll": roll, "start_pitch": pitch, "start_heading": heading}
        return place | angles | {"start_velocity_n": frame_n(r).T @ self.velocity(0.0)}

    def frame_w(self, duration, count=4000):
        """C_ew (3, 3) at `duration` of the frame that is n at time 0 and never turns about the vertical."""
        down = frame_n(self.position(np.linspace(0.0, duration, count)))
        C, normals = down[0], down[:, :, 2]
        for before, after in pairwise(normals):
            C = Rotation.from_rotvec(np.cross(before, after)).as_matrix() @ C
        return C


def moved(motion, errors, duration, step=0.05, known_place=False, by_rate=0.0, by_force=0.0, rate_by_force=0.0):
    """r, v (k, 3) and C (k, 3, 3) after `duration` (s) of k estimates that start with `errors` (k, 15) against the motion.

    known_place: gravity is that of the true place, as where fixes tell it.  by_rate, by_force, rate_by_force (k, 3, 3): errors
    of the measured rate and specific force proportional to the true ones, and of the rate proportional to the force.
    """
    by_rate, by_force, rate_by_force = (np.broadcast_to(m, (len(errors), 3, 3)) for m in (by_rate, by_force, rate_by_force))
    errors = np.asarray(errors, float)
    r = motion.position(0.0) + errors[:, POSITION]
    v = motion.velocity(0.0) + errors[:, VELOCITY]
    C = Rotation.from_rotvec(-errors[:, PHI]).as_matrix() @ motion.attitude(0.0)
    count = round(duration / step)
    grid = step / 2 * np.arange(2 * count + 1)
    rates, forces, earth = motion.rate(grid), motion.force(grid), skew(EARTH_RATE)
    told = gravity(motion.position(grid)) if known_place else None

    def slope(r, v, C, k):
        felt = np.einsum("kij,kj->ki", C, forces[k] + errors[:, ACCEL] + by_force @ forces[k])
        down = gravity(r) if told is None else told[k]
        turning = rates[k] + errors[:, GYRO] + by_rate @ rates[k] + rate_by_force @ forces[k]
        return v, felt + down - 2 * v @ earth.T, C @ skew(turning) - earth @ C

    for n in range(count):
        now = (r, v, C)
        one = slope(*now, 2 * n)
        two = slope(*(s + step / 2 * d for s, d in zip(now, one, strict=True)), 2 * n + 1)
        three = slope(*(s + step / 2 * d for s, d in zip(now, two, strict=True)), 2 * n + 1)
        four = slope(*(s + step * d for s, d in zip(now, three, strict=True)), 2 * n + 2)
        r, v, C = (s + step / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in zip(now, one, two, three, four, strict=True))
    return r, v, C


def transition(motion, duration, step=0.05, known_place=False):
    """Phi (15, 15) of the error states over `duration`, by central differences; and r, v, C of the motion at its end."""
    starts = np.concatenate([np.zeros((1, 15)), np.diag(SCALE), -np.diag(SCALE)])
    r, v, C = moved(motion, starts, duration, step, known_place)
    turn = Rotation.from_matrix(C @ C[0].T).as_rotvec()  # C_hat = exp(-phi) C
    found = np.concatenate([r - r[0], v - v[0], -turn, starts[:, 9:]], axis=1)
    Phi = (found[1:16] - found[16:]).T / (2 * SCALE)
    return Phi, r[0], v[0], C[0]


def with_fixes(motion, arm, seconds, dt, ages):
    """Exact samples, and exact fixes of the antenna `age` before the ends of samples {number: age}."""
    count = round(seconds / dt)
    delta_angle, delta_velocity = motion.increments(dt, count)
    columns = {"delta_angle": delta_angle, "delta_velocity": delta_velocity, "dt": np.full(count, dt)}
    names = ("gnss_valid", "gnss_age", "gnss_latitude", "gnss_longitude", "gnss_height", "gnss_velocity_valid")
    columns |= {name: np.zeros(count) for name in names} | {"gnss_velocity_n": np.zeros((count, 3))}
    columns |= {f"gnss_{name}_sigma": np.full((count, 3), 1e-4) for name in ("position", "velocity")}
    for number, age in ages.items():
        t = dt * number - age
        C = motion.attitude(t)
        place = motion.position(t) + C @ arm
        speed = motion.velocity(t) + C @ np.cross(motion.rate(t) - C.T @ EARTH_RATE, arm)
        latitude, longitude, height = geodetic(place)
        told = (1.0, age, latitude, longitude, height, 1.0)
        for name, value in zip(names, told, strict=True):
            columns[name][number - 1] = value
        columns["gnss_velocity_n"][number - 1] = frame_n(place).T @ speed
    return columns, count
