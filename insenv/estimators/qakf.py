"""`qakf` and `qakf-improved`: alignment in place by a quaternion adaptive Kalman filter in the inertial frame.

State: Q (4), the constant quaternion from b at the start to n at the start, without process noise. Vectors: alpha, beta
of `insenv.estimators.parts.inertial_vectors`. The observation is zero, 0 = H Q + v, with

    qakf:           H = M / (2 g),   M = [beta +] - [alpha -]
    qakf-improved: H = K / (2 S),   K = integral of w M^T M,   S = integral of w (|alpha|^2 + |beta|^2)

Source: the quaternion adaptive-Kalman paper, sections 2.2 and 3.2. Its formulas are lost; they are rebuilt from its
text.

Normalisation: without errors M^T M has the eigenvalues 0, 0, 4 g^2, 4 g^2 and K has the trace 2 S. Divided as above,
the singular values of either H are at most 1, and all its elements are below 1, as the paper says of K's. H then has no
unit, so one start covariance and one noise estimate serve every sensor, rate and time; K undivided would grow with
time.

Renormalisation: the length of Q has no meaning, so its error is kept in the tangent space of the unit sphere, dQ = [0,
theta] Q, with theta (3) half the attitude error about n at the start and P (3x3) the covariance of theta. This is the
4x4 covariance projected off Q and rotated with it; Q is normalised after each update. Multiplied by Q^-1 from the
right, the observation keeps its noise and depends only on a = C(Q) alpha. With d = beta - a, s = beta + a:

    qakf:           H theta = (-d . theta, s x theta) / (2 g),  residual (0, d) / (2 g)
    qakf-improved: the columns of K formed from B C(Q)^T: the first is the residual, the other three are H

Noise: in `qakf` v is white, R = r I. In `qakf-improved` it enters integrated and multiplied by M^T: the integral of
M^T v has the covariance r K, so R = r K. (With R = r I the noise of the tilts, a thousand times that of heading, would
set the weight of heading.) Successive K_k contain nearly the same v, so information fades over the last sixth of the
time (`FADING`); otherwise the filter would keep what early, inaccurate K contributed. r is estimated from the
innovations by the practical (Sage-Husa) estimator with a memory of a tenth of the time so far, which keeps r positive:
r <- (1 - c) r + c max(|e|^2 - trace(H P H^T), |e|^2 / 4) / trace(R / r), c = 10 / (k + 10) at the k-th sample.

Window: before that, both vectors are faded in over `FADE_IN` smoothing times (a polynomial with three vanishing derivatives at
either end) and pass a Butterworth low-pass of sixth order. So every filtered vector is an average over a window that begins and
ends smoothly, and the velocity of the vehicle at the start leaves no permanent error.

Accuracy: `qakf-improved` reaches that of the q-method, a sixth of the time later, and is smoother. `qakf` reaches it
later, the more noise there is: the square of M's own noise enters the information as if it were information on heading,
so heading errors decay only as (t0 / t)^3, t0 being the time at which the Earth's rotation exceeds that noise.

Stated accuracy: the limit that the sensors set, and P. P treats successive residuals as independent, but the low-pass
makes them alike over `CORRELATION` smoothing times: as many samples count as one. It takes the square
of M's noise for information: `SURPLUS`. And it is linear: beyond `LINEAR` of heading it is raised.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, polynomial
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, frozen_frame, inertial_vectors, rows, settling
from insenv.estimators.parts.inertial_vectors import davenport

DAMPING = (0.9659258262890683, 0.7071067811865476, 0.25881904510252074)  # Butterworth, sixth order: cos 15, 45, 75 deg
SECTIONS = len(DAMPING)
FADE_IN = 7.5  # smoothing times
DELAY = 0.5 * FADE_IN + 2.0 * sum(DAMPING)  # smoothing times lost, both ends together: fade-in and filter delay
CORRELATION = 3.1  # smoothing times over which filtered white noise stays alike: 1 / (2 B), B its noise bandwidth
MEMORY = 10.0  # the noise estimate has a memory of 1 / MEMORY of the samples so far
FADING = 6.0  # the improved filter keeps its information over the last 1 / FADING of the samples
LEAST_SHARE = 0.25  # share of an innovation's square that always counts as noise
LEAST_NOISE = 1e-26
SURPLUS = 2.0  # noise in H counts as information, and P does not see it: see the docstring of the module
LINEAR = 0.12  # rad of heading sigma: from there on the covariance of a linear filter is too small
LARGEST_SIGMA = ca.DM([1.0, 1.0, inertial_vectors.LARGEST_HEADING_SIGMA])  # rad
START_INFORMATION = 1.0  # rad^-2, of theta: nothing known
START_TRIANGLE = symmetric.triangle_of_diagonal([START_INFORMATION] * 3)

PARAMETERS = inertial_vectors.PARAMETERS + Table((
    Row("start_quaternion", "Start value of Q, of any length except zero", "1", (4,), "n at the start", (1, 0, 0, 0)),
))  # fmt: skip

WINDOW = Table((
    Row("alpha", "Measured specific force, after each section of the low-pass", "m/s^2", (SECTIONS, 3), "i"),
    Row("alpha_rate", "Its rate", "m/s^3", (SECTIONS, 3), "i"),
    Row("beta", "Expected specific force, after each section", "m/s^2", (SECTIONS, 3), "n at the start"),
    Row("beta_rate", "Its rate", "m/s^3", (SECTIONS, 3), "n at the start"),
))  # fmt: skip

PROFILES = Table((
    Row("early_profile", "Integral of beta alpha^T with weights that fade out after the start", "m^2/s^3", (3, 3)),
    Row("late_profile", "The same with weights that fade out before now", "m^2/s^3", (3, 3)),
    Row("early_weight", "Weight of a vector now in the early profile", "1", start=1.0),
    Row("early_spread", "Integral of |alpha|^2 + |beta|^2 with the weights of the early profile", "m^2/s^3"),
    Row("late_spread", "The same with the weights of the late profile", "m^2/s^3"),
))  # fmt: skip

FILTER = Table((
    Row("q_start", "Q: takes components in b at the start to n at the start", "1", (4,), "n at the start", (1, 0, 0, 0)),
    Row("information", "Inverse covariance of theta, upper triangle", "1/rad^2", (symmetric.triangle_size(3),),
        start=START_TRIANGLE),
    Row("covariance", "Covariance of theta, upper triangle", "rad^2", (symmetric.triangle_size(3),),
        start=symmetric.triangle_of_diagonal([1.0 / START_INFORMATION] * 3)),
    Row("noise_variance", "Estimated variance of the observation's noise", "1"),
))  # fmt: skip

OUTPUTS = rows.ALIGNMENT + Table((
    Row("filter_sigma", "Standard deviation by the filter's covariance, about n at the start", "rad", (3,), "n at the start"),
    FILTER["noise_variance"],
    settling.RATIO,
))  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The rows that the place determines, and the given Q."""
    return {**inertial_vectors.start(p), "q_start": attitude.normalize(p.start_quaternion)}


def vector_observation(q: Any, alpha: Any, beta: Any, gravity: Any) -> tuple[Any, Any]:
    """H (4x3) and residual (4) of `qakf`, multiplied by Q^-1 from the right."""
    turned = attitude.rotate(q, alpha)
    d, s = (beta - turned) / (2 * gravity), (beta + turned) / (2 * gravity)
    return ca.vertcat(-d.T, skew(s)), ca.vertcat(0, d)


def profile_observation(q: Any, profile: Any, spread: Any) -> tuple[Any, Any]:
    """H (4x3) and residual (4) of `qakf-improved`, multiplied by Q^-1 from the right."""
    K = ca.SX.eye(4) / 2 - davenport(profile @ attitude.to_dcm(q).T) / (spread + 1e-300)
    return K[:, 1:], K[:, 0]


def filtered(x: Any, gained: Any, gradient: Any, predicted: Any, square: Any, samples: Any, fading: float) -> dict[str, Any]:
    """Rows of `FILTER` after an update.

    gained: H^T W H (3x3) and gradient: H^T W e (3) for residual e and noise r W^-1. predicted, square: trace(H P H^T)
    and |e|^2, each over the trace of W^-1. samples: updates before this one. fading: information beyond that of the
    start is kept over the last 1 / fading of the samples; 0: all of it is kept.
    """
    share = MEMORY / (samples + MEMORY)
    noise = (1 - share) * x.noise_variance + share * maximum(square - predicted, LEAST_SHARE * square)
    noise = maximum(noise, LEAST_NOISE)
    forgotten = fading / (samples + 1 + fading)
    known = x.information + forgotten * (START_TRIANGLE - x.information) if fading else x.information
    information = known + symmetric.triangle(gained) / noise
    covariance = inverse(information)
    theta = -symmetric.full(covariance, 3) @ gradient / noise
    return {
        "q_start": attitude.normalize(attitude.multiply(ca.vertcat(1, theta), x.q_start)),
        "information": information,
        "covariance": covariance,
        "noise_variance": noise,
    }


def trace_of_product(stored: Any, matrix: Any) -> Any:
    """Trace of the product of two symmetric matrices (3x3), the first given as its triangle."""
    return sum((1 if i == j else 2) * stored[symmetric.place(i, j)] * matrix[i, j] for j in range(3) for i in range(j + 1))


def inverse(information: Any) -> Any:
    """Triangle of the inverse of a positive definite 3x3 matrix given as its triangle, by L D L^T."""
    a, b, c, d, e, f = ca.vertsplit(information)  # (0,0) (0,1) (1,1) (0,2) (1,2) (2,2)
    l10, l20 = b / a, d / a
    d1 = c - l10 * b
    m21 = e - l10 * d
    l21 = m21 / d1
    p0, p1, p2 = 1 / a, 1 / d1, 1 / (f - l20 * d - l21 * m21)
    n20 = l10 * l21 - l20  # of L^-1
    p11, p12, p02 = p1 + l21 * l21 * p2, -l21 * p2, n20 * p2
    return ca.vertcat(p0 + l10 * l10 * p1 + n20 * n20 * p2, -l10 * p1 - l21 * n20 * p2, p11, p02, p12, p2)


def vector_update(x: Any, H: Any, residual: Any) -> dict[str, Any]:
    """Rows of `FILTER` after the update of `qakf`: noise r I on three components."""
    gained = H.T @ H
    predicted = trace_of_product(x.covariance, gained) / 3
    return filtered(x, gained, H.T @ residual, predicted, ca.sumsqr(residual) / 3, x.samples, 0.0)


def profile_update(x: Any, H: Any, residual: Any) -> dict[str, Any]:
    """Rows of `FILTER` after the update of `qakf-improved`: tangent-space noise r K, so H^T (r K)^-1 H = K / r."""
    K, e = H[1:, :], residual[1:]
    scale = ca.trace(K)
    predicted = trace_of_product(x.covariance, K.T @ K) / scale
    return filtered(x, K, e, predicted, ca.sumsqr(e) / scale, x.samples, FADING)


def windowed(p: Any, x: Any, u: Any) -> tuple[dict[str, Any], Any, Any]:
    """Rows of `inertial_vectors.CARRIED` and `WINDOW` after a sample; alpha and beta (3x1, m/s^2) from the window."""
    changed, measured, expected = inertial_vectors.carried(p, x, u)
    fade = fade_in(x.time + u.dt / 2, FADE_IN * p.smoothing_time)
    alpha, alpha_rate = low_pass(x.alpha, x.alpha_rate, fade * measured, p.smoothing_time, u.dt)
    beta, beta_rate = low_pass(x.beta, x.beta_rate, fade * expected, p.smoothing_time, u.dt)
    changed |= {"alpha": alpha, "alpha_rate": alpha_rate, "beta": beta, "beta_rate": beta_rate}
    return changed, alpha[SECTIONS - 1, :].T, beta[SECTIONS - 1, :].T


def fade_in(time: Any, duration: Any) -> Any:
    """Weight rising from 0 at time 0 to 1 at `duration` (s), three derivatives zero at both ends; 1 for duration 0."""
    rise = minimum(time / (duration + 1e-9), 1.0)
    return rise**4 * polynomial(rise, (35.0, -84.0, 70.0, -20.0))


def low_pass(values: Any, rates: Any, value: Any, time_constant: Any, dt: Any) -> tuple[Any, Any]:
    """New outputs and rates (rows) of the sections in series for an input (3x1).

    Backward Euler: stable at any interval, and with time constant 0 the output is the input.
    """
    outputs, slopes, square = [], [], time_constant * time_constant
    value = value.T
    for i, damping in enumerate(DAMPING):
        per = 1 / (square + dt * (2 * damping * time_constant + dt))
        slope = (rates[i, :] * square + (value - values[i, :]) * dt) * per
        value = values[i, :] + dt * slope
        outputs.append(value)
        slopes.append(slope)
    return ca.vertcat(*outputs), ca.vertcat(*slopes)


def vector_sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample of `qakf`."""
    changed, alpha, beta = windowed(p, x, u)
    return changed | vector_update(x, *vector_observation(x.q_start, alpha, beta, x.rest_force_n[2]))


def profile_sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample of `qakf-improved`."""
    changed, alpha, beta = windowed(p, x, u)
    keep = p.memory_time / (p.memory_time + u.dt)
    product, square = (beta @ alpha.T) * u.dt, (ca.sumsqr(alpha) + ca.sumsqr(beta)) * u.dt
    sums = {
        "early_profile": x.early_profile + x.early_weight * product,
        "late_profile": keep * x.late_profile + product,
        "early_weight": keep * x.early_weight,
        "early_spread": x.early_spread + x.early_weight * square,
        "late_spread": keep * x.late_spread + square,
    }
    profile, spread = (sums[f"early_{name}"] + sums[f"late_{name}"] for name in ("profile", "spread"))
    return changed | sums | profile_update(x, *profile_observation(x.q_start, profile, spread))


def steady_variance(p: Any, x: Any, lags: tuple[float, float]) -> Any:
    """Variance of attitude about n (3, rad^2) if the base only sways: the limit that the sensors set, and P.

    lags: age of the estimated vertical as a share of the time, at worst (large gyro biases delay the filter) and on
    average.
    """
    lost = DELAY * p.smoothing_time
    limit = inertial_vectors.stated_sigma(p, x, x.time, lost, *(lag * x.time for lag in lags))
    # successive residuals are equal over the correlation time of the low-pass, so as many samples count as one
    alike = 1 + CORRELATION * p.smoothing_time * x.samples / maximum(x.time, 1e-9)
    C_n0n = attitude.to_dcm(frozen_frame.q_n0n(x.half_turn, x.axis_n))
    by_filter = 4 * ca.diag(C_n0n.T @ symmetric.full(x.covariance, 3) @ C_n0n) * alike * SURPLUS**2
    return limit**2 + by_filter * (1 + by_filter[2] / LINEAR**2) ** 2


def output(p: Any, x: Any, lags: tuple[float, float]) -> dict[str, Any]:
    """Attitude now; lags: as of `steady_variance`."""
    steady = steady_variance(p, x, lags)
    motion = settling.moved(x, x.q_start, DELAY * p.smoothing_time, steady)
    return {
        "q_nb": frozen_frame.q_nb(x, x.q_start),
        "attitude_sigma": minimum(ca.sqrt(steady + motion), LARGEST_SIGMA),
        "filter_sigma": 2 * ca.sqrt(x.covariance[symmetric.diagonal_places(3)]),
        "noise_variance": x.noise_variance,
        "motion_ratio": settling.motion_ratio(steady, motion),
    }


def _estimator(
    id: str, title: str, step: Callable[[Any, Any, Any], dict[str, Any]], further: Table, lags: tuple[float, float]
) -> Estimator:
    def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
        changed = step(p, x, u)
        return {**changed, "answer_due": settling.due(x, changed["time"])}

    model = Model(
        id=id,
        title=title,
        parameters=PARAMETERS,
        state=inertial_vectors.CARRIED + WINDOW + further + FILTER + settling.STATE,
        inputs=rows.SAMPLE_INPUTS,
        outputs=OUTPUTS,
        steps={
            "sample": Step(sample),
            "keep": settling.keeping(lambda x: x.q_start, lambda p, x: minimum(steady_variance(p, x, lags), LARGEST_SIGMA**2)),
        },
        output=lambda p, x: output(p, x, lags),
        start=start,
    )
    return Estimator(
        model,
        kind="alignment",
        prepare=inertial_vectors.prepare,
        needs=inertial_vectors.needs,
        applicability=applicability.notes,
        on_turntable=applicability.TURNED,
        findings=settling.findings_in_part,
    )


PLAIN = _estimator(
    "qakf", "alignment in place, quaternion adaptive Kalman filter on single vectors", vector_sample, Table(), (1.0, 0.45)
)
IMPROVED = _estimator(
    "qakf-improved",
    "alignment in place, quaternion adaptive Kalman filter on the integral of many vectors",
    profile_sample,
    PROFILES,
    (0.6, 0.6),
)
ESTIMATORS = [PLAIN, IMPROVED]
