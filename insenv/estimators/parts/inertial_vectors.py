"""Many vectors in the inertial frame, shared by `q-method`, `qakf` and `qakf-improved`.

The gyros give the attitude since the start, C_b(t)^b(0) (`insenv.estimators.parts.frozen_frame`). In the frozen body
axes, specific force is minus gravity, which the Earth's rotation moves along a known cone, plus the vehicle's own
accelerations:

    alpha(t) = C_b(t)^b(0) f^b(t),   beta(t) = -C_n(t)^n(0) g^n,   beta = C(Q) alpha

with Q the constant quaternion from b at the start to n at the start; the attitude now is C_n(0)^n(t) C(Q) C_b(t)^b(0).
Source: the quaternion adaptive-Kalman paper, section 2.1. Its K, the integral of M^T M with M = [beta +] - [alpha -],
is (integral of |alpha|^2 + |beta|^2) I - 2 Davenport(B), B the integral of beta alpha^T (Markley and Crassidis 2014,
section 5.3).

Two additions to the paper's plain vectors suppress the accelerations of a swaying base (`smoothing_time` 0 and a large
`memory_time` give the plain vectors). Both are linear and the same on alpha and beta, so they cause no error of their
own.

Windows: those of `qakf` are in its file; the weights of the q-method are windows themselves.

Weights: gyro white noise (N) makes the frozen axes drift as a Brownian path, so the information of two vectors on one
another decreases with the time between them. The best linear estimate of heading, which is a slope, weighs time by
sinh((t - T/2) / tau) with tau = V / (g N), V the accelerometers' white noise: the two ends of the run, each over tau
(this gives the Cramer-Rao bound of `insenv.evaluation.limits` to four digits). Here B is the sum of an integral that
fades out after the start and one that forgets, both with `memory_time` = tau; for tau well above T all weights are
equal.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import maximum, minimum, select
from insenv.core.tables import Row, Table
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import frozen_frame, rows
from insenv.estimators.parts.strapdown import MEMORY

SETTLING = 30.0
"""Smoothing times until sway no longer dominates the errors on a swaying base, and a slow surge is seen: 120 s of 4 s.

On ship-irregular-sea (seeds 100 to 131) the rms of heading is 2.0 times what biases and white noise leave after 81 s, and
1.15 times after 99 s, with the q-method; with `qakf-improved` 1.15 times after 75 s. A vehicle at rest needs half of it, but
nothing known at the start distinguishes rest from sway.
"""
LEAST_MEMORY = 30.0  # s: shorter windows would show waves
LEAST_SIGMA_TIME = 1e-3  # s
LARGEST_HEADING_SIGMA = math.pi / math.sqrt(3.0)  # rad: heading unknown

PARAMETERS = rows.chosen(rows.PLACE, "latitude", "height") + Table((
    Row("smoothing_time", "Inverse of the low-pass's cut-off (rad/s); 0: no low-pass", "s", start=4.0, lower=0.0, upper=1e4),
    Row("memory_time", "Time near the start and before now whose vectors count", "s", start=1e9, lower=1.0, upper=1e12),
)) + rows.NOISES  # fmt: skip

CARRIED = Table((
    frozen_frame.FRAME["q_ib"],
    frozen_frame.FRAME["axis_n"],
    Row("rest_force_n", "Specific force at rest", "m/s^2", (3,), "n"),
    frozen_frame.FRAME["half_turn"],
    Row("time", "Time since the start", "s"),
)) + MEMORY  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The rows that the place determines."""
    place = frozen_frame.start(p)
    return {"axis_n": place["axis_n"], "rest_force_n": -place["gravity_n"]}


def needs(parameters: Mapping[str, Any]) -> float:
    """Time (s) of data until sway no longer dominates the errors."""
    return SETTLING * float(parameters["smoothing_time"])


def carried(p: Any, x: Any, u: Any) -> tuple[dict[str, Any], Any, Any]:
    """Rows of `CARRIED` after one inertial sample; alpha and beta (3x1, m/s^2), means over it."""
    changed, force = frozen_frame.advanced(x, u)
    # expected specific force at mid-sample, in n at the start
    middle = frozen_frame.turned(x.half_turn, u.dt / 2)
    expected = attitude.rotate(frozen_frame.q_n0n(middle, x.axis_n), x.rest_force_n)
    changed |= {"half_turn": frozen_frame.turned(middle, u.dt / 2), "time": x.time + u.dt}
    return changed, force / u.dt, expected


def davenport(profile: Any) -> Any:
    """Davenport's symmetric 4x4 matrix (scalar first) of B = sum of beta alpha^T (3x3).

    The eigenvector of its largest eigenvalue is the quaternion that takes the alphas to the betas.
    """
    B = profile
    vector = ca.vertcat(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1])
    block = B + B.T - ca.trace(B) * ca.SX.eye(3)
    return ca.vertcat(ca.horzcat(ca.trace(B), vector.T), ca.horzcat(vector, block))


def stated_sigma(p: Any, x: Any, time: Any, lost: Any, age: Any, mean_age: Any) -> Any:
    """Stated accuracy (3, rad) after `time` seconds: the limit that biases and white noise set.

    lost: time that the windows leave out of the run, s. Tilt also has the rotation error of the gyros since the time of
    the estimated vertical: of their bias over `age` (s), of their noise over `mean_age` (s); the mean of a Brownian
    path over a time of 2 mean_age has a third of the variance at its end. The middle term of the heading noise joins
    the limits of gyro noise (N) and accelerometer noise (V) to within 5 %.
    """
    g, cosine = -x.rest_force_n[2], x.axis_n[0]
    time = maximum(time - lost, LEAST_SIGMA_TIME)
    N, V = p.angle_random_walk, p.velocity_random_walk / g
    tilt = p.accel_bias_sigma / g
    drifted = (p.gyro_bias_sigma * age) ** 2 + N**2 * mean_age * (2.0 / 3.0)
    level = ca.sqrt(tilt**2 + 4 * V**2 / time + drifted)
    slope = (N**2 + (1.2 * N * V + 12 * V**2 / time) / time) / time
    drift = p.gyro_bias_sigma**2 + slope + (geodesy.OMEGA_IE * x.axis_n[2] * tilt) ** 2
    heading = ca.sqrt(drift) / (geodesy.OMEGA_IE * cosine)
    return ca.vertcat(minimum(level, 1.0), minimum(level, 1.0), minimum(heading, LARGEST_HEADING_SIGMA))


def prepare(known: Knowledge) -> dict[str, Any]:
    """Rows of `PARAMETERS` from what is known."""
    memory, noise = 1e9, known.sensors
    if noise.angle_random_walk > 0.0:
        memory = noise.velocity_random_walk / (geodesy.NOMINAL_GRAVITY * noise.angle_random_walk)
    return {**known.rows_of(PARAMETERS), "memory_time": min(max(memory, LEAST_MEMORY), 1e9)}


# Eigenvectors of small symmetric matrices over CasADi symbols, by cyclic Jacobi rotations.
#
# A fixed number of sweeps: no branches, no start vector that could be orthogonal to the result, always the same
# operations. Convergence is quadratic; five sweeps of a 4x4 matrix reach rounding. Source: Golub and Van Loan (2013),
# section 8.5.

SWEEPS = 5


def largest_eigenvector(matrix: Any) -> Any:
    """Unit eigenvector (n x 1) of the largest eigenvalue of a symmetric n x n matrix (any, if all are equal)."""
    n = matrix.shape[0]
    A = [[matrix[min(i, j), max(i, j)] for j in range(n)] for i in range(n)]
    V = [[ca.SX(float(i == j)) for j in range(n)] for i in range(n)]
    for _ in range(SWEEPS):
        for i in range(n - 1):
            for j in range(i + 1, n):
                _rotate(A, V, i, j)
    best, vector = A[0][0], [V[k][0] for k in range(n)]
    for i in range(1, n):
        better = A[i][i] > best
        best = select(better, A[i][i], best)
        vector = [select(better, V[k][i], vector[k]) for k in range(n)]
    return ca.vertcat(*vector)


def _rotate(A: list[list[Any]], V: list[list[Any]], i: int, j: int) -> None:
    """The Jacobi rotation that makes A[i][j] zero, in place."""
    n, gap, twice = len(A), A[j][j] - A[i][i], 2 * A[i][j]
    # tangent of the smaller rotation; without division by the off-diagonal element, which may be zero
    length = ca.fabs(gap) + ca.sqrt(gap * gap + twice * twice)
    t = select(gap < 0, -twice, twice) / (length + (length == 0))
    c = 1 / ca.sqrt(1 + t * t)
    s = t * c
    A[i][i], A[j][j] = A[i][i] - t * A[i][j], A[j][j] + t * A[i][j]
    A[i][j] = A[j][i] = ca.SX(0)
    for k in range(n):
        if k not in (i, j):
            A[i][k], A[j][k] = c * A[i][k] - s * A[j][k], s * A[i][k] + c * A[j][k]
            A[k][i], A[k][j] = A[i][k], A[j][k]
        V[k][i], V[k][j] = c * V[k][i] - s * V[k][j], s * V[k][i] + c * V[k][j]
