"""`velocity-integration`: alignment on the move from an unknown attitude, by the velocity of GNSS, as Wahba's problem.

The equation of velocity, written in the frozen body axes i (b at the start) and in the frozen Earth axes i0 (e at the
start) and integrated, is a rotation between two vectors that are measured (Wu and Pan 2013, velocity integration
formula; here with e in place of n, so that the transport rate is not needed):

    C(Q) alpha(t) = beta(t) + constant
    alpha(t) = integral of C_b^i f dt + C_b^i (omega_ib x l)
    beta(t)  = C_e^i0 v + integral of C_e^i0 (omega_ie x v - g) dt

v is the velocity of the antenna over the Earth and l its lever arm: beta is then its velocity in space, so alpha has the
inertial rate of the arm and no term is missing. Q is constant, from b at the start to e at the start, and

    C_b^n = C_e^n C_i0^e C(Q) C_b^i

The constant is the velocity at the start, of which no fix is better than another: alpha and beta count less their
weighted means. Q is the eigenvector of the largest eigenvalue of Davenport's matrix of B, the sum of w dbeta dalpha^T
over the fixes (Markley and Crassidis 2014, section 5.3). The weights w are the inverse variances of the fixes and fade
over `memory_time`: the gyros' drift bends alpha, by g drift t^2 / 2.

Stated accuracy. To first order the error of C(Q) is the rotation phi (i) with

    N phi = y,   y = sum of w [dalpha x]^T (d(delta alpha) - noise of the fix),   N = sum of w [dalpha x]^T [dalpha x]

The covariance of the drift of C_b^i, of delta alpha, of its weighted mean, of y and of the constant errors follows from
linear recursions with the noises of the data sheets; that of the attitude is that of phi plus the drift. N comes from
alpha alone, which has no noise of fixes: along a straight line at constant speed N is zero about the vertical, and the
heading is stated as unknown.

Heading and level of the answer of a fix replace those that are kept where they are stated to be better, each for
itself. So the gyros carry the heading over a stretch without turns, which the weights would forget.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import exp, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator, Knowledge
from insenv.estimators.parts import frozen_frame, lever_arm, motion_errors, rest_bias, rows
from insenv.estimators.parts.eigen import largest_eigenvector
from insenv.estimators.parts.finding import Finding
from insenv.estimators.parts.increments import MEMORY
from insenv.estimators.parts.inertial_vectors import LARGEST_HEADING_SIGMA, davenport
from insenv.estimators.parts.kalman import propagate
from insenv.instruments import GNSS_TOLD

DRIFT, ALPHA, MEAN, SUM, KEPT, GYRO, ACCEL, ARM = (slice(i, i + 3) for i in range(0, 24, 3))
DELAY, N = 24, 25
"""Errors: drift of C_b^i (rad), of alpha and of its mean (m/s), y, phi of the answer kept (rad), biases (rad/s, m/s^2), lever
arm (m), delay of fixes (s).
"""
COVARIANCE_S = 1.0  # s: longest step of the covariance
UNKNOWN = LARGEST_HEADING_SIGMA  # rad
LARGEST_LINEAR = 0.35  # rad: a larger standard deviation is that of no linear problem
SHORT = 300.0  # s: gyros that lose a heading in less need turns all the time
LEAST = 1e-13  # information about the heading over that about the level, below which there is none

FIX_NOISE = 0.05  # m/s, once a second: typical of receivers that measure velocity by Doppler shift
SHORTEST, LONGEST = 5.0, 3600.0  # s of memory

EARTH_AXIS = (0.0, 0.0, 1.0)  # in e

PARAMETERS = (
    Table((Row("memory_time", "Time over which the weight of a fix fades", "s", start=60.0, lower=1.0, upper=1e9),))
    + rows.NOISES
    + rows.MOTION_ERRORS
    + Table((rows.START_BIASES["start_gyro_bias"], rows.START_BIASES["start_gyro_bias_error"]))
    + rows.LEVER_ARM
    + GNSS_TOLD
)

STATE = (
    Table((
        frozen_frame.FRAME["q_ib"],
        frozen_frame.FRAME["half_turn"],
        Row("time", "Time since the start", "s"),
        Row("alpha", "Integral of the measured specific force", "m/s", (3,), "i"),
    ))
    + MEMORY
    + lever_arm.MEMORY
    + Table((
        Row("force", "Specific force as it was `rate_lag` ago: half the age of the last fix", "m/s^2", (3,), "i"),
        Row("dt", "Interval of the last sample", "s", start=0.01),
        Row("stretch", "Time since the last step of the covariance", "s"),
        Row("stretch_alpha", "Change of alpha in it", "m/s", (3,), "i"),
        Row("stretch_C_ib", "Integral of the attitude since the start over it", "s", (3, 3), "i"),
        Row("stretch_angle", "Sum of the delta angles in it", "rad", (3,), "b"),
        Row("covariance_due", "1 when the covariance is to be propagated", "1"),
        Row("covariance", "Of the errors: upper triangle", "", (symmetric.triangle_size(N),)),
        Row("epoch", "Time of the last fix with a velocity", "s"),
        Row("pull", "Integral of the Earth's part of beta", "m/s", (3,), "i0"),
        Row("pull_rate", "Its rate at the last fix", "m/s^2", (3,), "i0"),
        Row("weight", "Sum of the weights", "s^2/m^2"),
        Row("count", "Sum of the weights, 1 for a fix at present", "1"),
        Row("mean_alpha", "Weighted mean of alpha", "m/s", (3,), "i"),
        Row("mean_beta", "Weighted mean of beta", "m/s", (3,), "i0"),
        Row("moment", "Weighted sum of dalpha dalpha^T", "1", (3, 3), "i"),
        Row("profile", "B: weighted sum of dbeta dalpha^T", "1", (3, 3)),
        Row("q_i0i", "Q, the answer kept: takes b components at the start to e components at the start", "1", (4,),
            start=(1, 0, 0, 0)),
        Row("answer_due", "1 when the answer of a fix is to be compared with it", "1"),
        Row("fix_latitude", "Latitude at the last fix", "rad"),
        Row("fix_longitude", "Longitude at the last fix", "rad"),
        Row("fix_height", "Height at the last fix", "m"),
        Row("fix_velocity_n", "Velocity at the last fix", "m/s", (3,), "n"),
    ))
)  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The constant errors are as the data sheets state them; all else is without error at the start."""
    biases = ca.repmat(rest_bias.bias_sigma(p), 3, 1), ca.repmat(p.accel_bias_sigma, 3, 1)
    sigma = ca.vertcat(ca.SX.zeros(12), ca.repmat(UNKNOWN, 3, 1), *biases, p.antenna_lever_arm_sigma, p.gnss_delay_sigma)
    return {"covariance": symmetric.triangle(ca.diag(sigma * sigma))}


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample, less the gyro bias that was told."""
    u = Values(**{**vars(u), "delta_angle": u.delta_angle - p.start_gyro_bias * u.dt})
    changed, force = frozen_frame.advanced(x, u)
    stretch = x.stretch + u.dt
    due = ca.logic_or(u.gnss_velocity_valid, stretch + u.dt / 2 > COVARIANCE_S)
    return {
        **changed,
        **lever_arm.followed(x, u.delta_angle * (1 / u.dt), u.dt, x.samples == 0),
        "time": x.time + u.dt,
        "alpha": x.alpha + force,
        "force": lever_arm.lagging(x, x.force, force * (1 / u.dt), u.dt, x.samples == 0),
        "dt": u.dt,
        "stretch": stretch,
        "stretch_alpha": x.stretch_alpha + force,
        "stretch_C_ib": x.stretch_C_ib + attitude.to_dcm(x.q_ib) * u.dt,
        "stretch_angle": x.stretch_angle + u.delta_angle,
        "covariance_due": select(due, 1.0, 0.0),
    }


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the covariance: drift' = C b_g + noise, (delta alpha)' = -f x drift + C b_a + noise."""
    A = ca.SX(N, N)
    A[ALPHA, DRIFT] = -skew(x.stretch_alpha)
    A[DRIFT, GYRO] = A[ALPHA, ACCEL] = x.stretch_C_ib
    by_rotation, _ = motion_errors.variances(p, x.stretch_angle, ca.SX.zeros(3))
    noise = ca.vertcat(
        ca.repmat(p.angle_random_walk**2 * x.stretch + by_rotation, 3, 1),
        ca.repmat(p.velocity_random_walk**2 * x.stretch, 3, 1),
        ca.SX.zeros(N - 6),
    )
    return {
        "covariance": propagate(x.covariance, A, noise),
        "stretch": 0,
        "stretch_alpha": ca.SX.zeros(3),
        "stretch_C_ib": ca.SX.zeros(3, 3),
        "stretch_angle": ca.SX.zeros(3),
    }


def measured(p: Any, x: Any, u: Any) -> tuple[Any, Any, Any]:
    """alpha (3, m/s, i) at the time of the fix, its rate (3, m/s^2), its derivative by the lever arm (3x3, 1/s)."""
    rate = x.previous_delta_angle / x.dt  # that of the middle of the sample
    change = lever_arm.angular_acceleration(x, rate, x.dt)
    now = rate + change * (x.dt / 2)
    bend = skew(change) + skew(now) @ skew(now)
    C_ib, arm = attitude.to_dcm(x.q_ib), p.antenna_lever_arm
    by_arm = C_ib @ (skew(now) - u.gnss_age * bend)  # as `lever_arm.then`
    return x.alpha - x.force * u.gnss_age + by_arm @ arm, x.force + C_ib @ bend @ arm, by_arm


def expected(x: Any, u: Any) -> tuple[Any, Any]:
    """C_e^i0 v (3, m/s, i0) of the fix, and the rate of the Earth's part of beta (3, m/s^2, i0)."""
    C_en = geodesy.C_en(u.gnss_latitude, u.gnss_longitude)
    velocity = C_en @ u.gnss_velocity_n
    gravity = C_en @ geodesy.normal_gravity_about_axis(C_en[2, :].T, u.gnss_height)
    coriolis = ca.cross(geodesy.OMEGA_IE * ca.SX(EARTH_AXIS), velocity)
    q_i0e = frozen_frame.q_n0n(frozen_frame.turned(x.half_turn, -u.gnss_age), ca.SX(EARTH_AXIS))
    return attitude.rotate(q_i0e, velocity), attitude.rotate(q_i0e, coriolis - gravity)


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix with a velocity: the sums, and the covariance of their errors."""
    epoch = x.time - u.gnss_age
    first = x.count == 0
    since = select(first, 0.0, epoch - x.epoch)
    velocity, pull_rate = expected(x, u)
    pull = x.pull + (x.pull_rate + pull_rate) * (since / 2)
    alpha, alpha_rate, by_arm = measured(p, x, u)
    beta = velocity + pull

    keep = exp(-since / p.memory_time)
    variance = (u.gnss_velocity_sigma[0] ** 2 + u.gnss_velocity_sigma[1] ** 2) / 2
    before = keep * x.weight
    weight = before + 1 / variance
    share = 1 / (variance * weight)
    dalpha, dbeta = alpha - x.mean_alpha, beta - x.mean_beta
    product = before * share
    profile = keep * x.profile + product * dbeta @ dalpha.T
    error = ca.SX(3, N)
    # of the velocity that a delay misses, gravity's part is a constant and counts as little as that of alpha and beta
    error[:, ALPHA], error[:, ARM], error[:, DELAY] = ca.SX.eye(3), by_arm, alpha_rate
    return {
        "covariance": collected(x.covariance, dalpha, keep, share, product, error, variance),
        "epoch": epoch,
        "pull": pull,
        "pull_rate": pull_rate,
        "weight": weight,
        "count": keep * x.count + 1,
        "mean_alpha": x.mean_alpha + share * dalpha,
        "mean_beta": x.mean_beta + share * dbeta,
        "moment": keep * x.moment + product * dalpha @ dalpha.T,
        "profile": profile,
        "answer_due": 1.0,
        "fix_latitude": u.gnss_latitude,
        "fix_longitude": u.gnss_longitude,
        "fix_height": u.gnss_height,
        "fix_velocity_n": u.gnss_velocity_n,
        **lever_arm.lagged(u.gnss_age),
    }


def collected(stored: Any, dalpha: Any, keep: Any, share: Any, product: Any, error: Any, variance: Any) -> Any:
    """Covariance triangle after a fix. With e = error x - noise, the error of alpha at the fix less that of the fix,

    mean' = mean + share (e - mean),   y' = keep y + product [dalpha x]^T (e - mean)

    error: 3xN. variance: of each component of the noise, m^2/s^2.
    """
    across = product * skew(dalpha).T
    Phi, by_noise = ca.SX.eye(N), ca.SX(N, 3)
    Phi[MEAN, :], by_noise[MEAN, :] = share * error, share * ca.SX.eye(3)
    Phi[MEAN, MEAN] = (1 - share) * ca.SX.eye(3)
    Phi[SUM, :], by_noise[SUM, :] = across @ error, across
    Phi[SUM, MEAN], Phi[SUM, SUM] = -across, keep * ca.SX.eye(3)
    return symmetric.triangle(Phi @ symmetric.full(stored, N) @ Phi.T + variance * by_noise @ by_noise.T)


def answer(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Level and heading of the answer of the fix take the place of those that are kept where they are better."""
    found, kept = attitude.normalize(q_ni(x, largest_eigenvector(davenport(x.profile)))), q_ni(x, x.q_i0i)
    C_ni = attitude.to_dcm(found)
    # with what is known of an unknown attitude, and more than rounding, so that there is an inverse
    known = 1 / UNKNOWN**2 + LEAST * ca.trace(x.moment)
    information = (ca.trace(x.moment) + known) * ca.SX.eye(3) - x.moment
    inverse = ca.inv_minor(C_ni @ information @ C_ni.T)

    def replaced(part: Any) -> tuple[Any, Any]:
        """Covariance with this part (3, about n) of the answer kept replaced, and the variances of the attitude."""
        Phi, new = ca.SX.eye(N), ca.diag(part) @ inverse
        Phi[KEPT, KEPT] = C_ni.T @ ca.diag(1 - part) @ C_ni
        Phi[KEPT, SUM] = C_ni.T @ new @ C_ni
        P = Phi @ symmetric.full(x.covariance, N) @ Phi.T
        P[KEPT, KEPT] += C_ni.T @ new @ new.T @ C_ni * (known * UNKNOWN) ** 2
        return P, variance_n(P, C_ni)

    now, other = variance_n(symmetric.full(x.covariance, N), C_ni), replaced(ca.SX.ones(3))[1]
    level, heading = other[0] + other[1] < now[0] + now[1], other[2] < now[2]
    part = ca.vertcat(level, level, heading)
    apart = attitude.error_rotation_vector(found, kept)
    q = attitude.multiply(attitude.from_rotation_vector((part - 1) * apart), found)
    back = attitude.conjugate(q_ni(x, ca.vertcat(1, 0, 0, 0)))
    return {
        "covariance": symmetric.triangle(replaced(part)[0]),
        "q_i0i": attitude.normalize(attitude.multiply(back, q)),
        "answer_due": 0.0,
    }


def q_ni(x: Any, q_i0i: Any) -> Any:
    """Takes b components at the start to n components now (4)."""
    since = select(x.count == 0, 0.0, x.time - x.epoch)
    latitude, longitude, _ = geodesy.geodetic_from_ned_offset(
        x.fix_velocity_n * since, x.fix_latitude, x.fix_longitude, x.fix_height
    )
    q_ne = attitude.conjugate(geodesy.q_ew_from_geodetic(latitude, longitude, 0.0))
    q_ei = attitude.multiply(attitude.conjugate(frozen_frame.q_n0n(x.half_turn, ca.SX(EARTH_AXIS))), q_i0i)
    return attitude.multiply(q_ne, q_ei)


def variance_n(P: Any, C_ni: Any) -> Any:
    """Variances of the attitude by the answer kept, about n (3, rad^2)."""
    both = P[KEPT, KEPT] + P[DRIFT, DRIFT] + P[KEPT, DRIFT] + P[DRIFT, KEPT]
    return ca.diag(C_ni @ both @ C_ni.T)


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now, and its stated accuracy."""
    q = attitude.normalize(q_ni(x, x.q_i0i))
    sigma = ca.sqrt(variance_n(symmetric.full(x.covariance, N), attitude.to_dcm(q)) + p.thrust_error**2)
    return {
        "q_nb": attitude.normalize(attitude.multiply(q, x.q_ib)),
        "attitude_sigma": ca.vertcat(*[select(sigma[i] < LARGEST_LINEAR, sigma[i], UNKNOWN) for i in range(3)]),
    }


MODEL = Model(
    id="velocity-integration",
    title="alignment on the move by the velocity of GNSS, from an unknown attitude (Wahba's problem)",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS + rows.FIX_INPUTS,
    outputs=rows.ALIGNMENT,
    steps={
        "sample": Step(sample),
        "covariance": Step(covariance, when="covariance_due"),
        "fix": Step(fix, when="gnss_velocity_valid"),
        "answer": Step(answer, when="answer_due"),
    },
    output=output,
    start=start,
)


def memory_time(gyro_bias: float, angle_random_walk: float) -> float:
    """Memory (s) that balances the noise of fixes and the drift of the gyros (rad/s, rad/s^0.5), `SHORTEST` to `LONGEST`.

    Over a time T a drift b bends alpha by g b t^2 / 2, of which a straight line leaves g b T^2 / (12 sqrt 5) rms. Noise of
    density S in the fixes leaves S / sqrt(T) of a mean. A random walk bends alpha 1.29 times as much as a drift of its
    mean rate. Exponential weights of memory m spread as equal ones over sqrt(12) m.
    """
    bend = geodesy.NOMINAL_GRAVITY / (12 * math.sqrt(5))
    by_bias = (FIX_NOISE / max(bend * gyro_bias, 1e-30)) ** 0.4
    by_walk = (FIX_NOISE / max(1.29 * bend * angle_random_walk, 1e-30)) ** 0.5
    return min(max(min(by_bias, by_walk) / math.sqrt(12), SHORTEST), LONGEST)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known."""
    sheet = known.sensors
    bias = known.gyro_bias_error or sheet.gyro_bias_sigma
    return {**known.rows_of(PARAMETERS), "memory_time": memory_time(bias, sheet.angle_random_walk)}


def findings(parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """A sentence where a run has not found the attitude, or its heading, at its end."""
    row = "start_gyro_bias_error" if parameters["start_gyro_bias_error"] > 0 else "gyro_bias_sigma"
    bias = float(parameters[row])
    kept = LARGEST_LINEAR / max(bias, 1e-30)
    lost = (
        f". Gyros with a bias of {math.degrees(bias) * 3600:.0f} deg/h ({row}) lose it again in {kept:.2g} s: if the "
        "unit is better, state its grade"
    )
    return (
        Finding(
            "attitude_sigma",
            "no attitude was found: this alignment needs fixes with a velocity, at least three of them",
            scale=(LARGEST_LINEAR, np.inf, np.inf),
        ),
        Finding(
            "attitude_sigma",
            "the heading is unknown at the end: turns or changes of speed show it, a straight line at constant speed does not"
            + (lost if kept < SHORT else ""),
            scale=(np.inf, np.inf, LARGEST_LINEAR),
        ),
    )


ESTIMATOR = Estimator(
    MODEL, kind="alignment", sensors=("gnss",), motion="moving", fix_velocity=True, prepare=prepare, findings=findings
)
