"""`qakf-printed` and `qakf-improved-printed`: the quaternion adaptive Kalman filters of the paper, in their textbook form.

`qakf` and `qakf-improved` are insenv's filters on the same observations; these two are for comparison with the paper. State: Q
(4), the constant quaternion from b at the start to n at the start, Q_k = Q_k-1 without process noise, with a 4x4 covariance
P. The observation is zero, with the vectors of `insenv.estimators.parts.inertial_vectors` without window or weights:

    qakf-printed:           0 = M_k Q + v,   M = [beta +] - [alpha -]
    qakf-improved-printed:  0 = K_k Q + v,   K = integral of M^T M

    innovation  e = -H Q,   d_k = (1 - b) / (1 - b^(k+1))
    noise       r <- (1 - d_k) r + d_k trace(e e^T - s H P H^T) / 4,   R = r I             (Sage and Husa)
    update      Q <- Q + P H^T (H P H^T + R)^-1 e,  Q <- Q / |Q|

Source: the quaternion adaptive-Kalman paper, sections 2.2 and 3.2. Its formulas are lost, and its text leaves open:

- the "practical adaptive Kalman filter": the estimator of Sage and Husa is the usual one. Its R is a multiple of the identity
  here: a full R becomes singular and a diagonal one stays at its start, because the scalar part of M Q is the error itself.
- s: 0 here (`subtracted`). With s = 1 the first r is negative, since P = I says that nothing is known, and the value that it is
  raised to decides everything: the filter takes the first residuals for exact and stays tens of degrees off.
- b: 1 here, all innovations alike (`forgetting`).
- the noise in K Q: R = r I here too, although v enters integrated.
- whether K is divided by the time (not here), and the start: Q = (1, 0, 0, 0), P = I. The unit of the vectors is immaterial
  with s = 0; here they are divided by the nominal gravity.

These choices are those with which the text of the paper is true: slow convergence of the first filter, the slower the more
noise, and of the second like the q-method's but smoother. `noise_sigma` gives the filter the standard deviation of the vectors'
noise instead. `insenv reproduce quaternion` has what the other readings give.

R = r I, so the four components of the observation are used one after another, in Joseph's form.

Stated accuracy: what the sensors set, P, and how far the answer has moved (`insenv.estimators.parts.settling`): P alone takes
the residual that a wrong heading leaves for noise.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import maximum, minimum, select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import qakf
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, frozen_frame, inertial_vectors, rows, settling
from insenv.estimators.parts.kalman import measure_joseph
from insenv.geodesy import NOMINAL_GRAVITY

SETTLING_S = 100.0
"""s: the printed filters converge more slowly than `qakf`, whose windows need this time."""

PARAMETERS = rows.chosen(rows.PLACE, "latitude", "height") + Table((
    Row("noise_sigma", "Known noise of the vectors, per sample and axis; 0: estimated on line", "m/s^2", lower=0.0, upper=1e3),
    Row("forgetting", "Forgetting factor b of the noise estimate; 1: none", "1", start=1.0, lower=0.5, upper=1.0),
    Row("subtracted", "Part s of the predicted variance of the innovation that is no noise", "1", lower=0.0, upper=1.0),
    Row("least_noise_sigma", "Smallest estimated noise of the vectors", "m/s^2", start=1e-7, lower=1e-12, upper=1.0),
    qakf.PARAMETERS["start_quaternion"],
)) + rows.NOISES  # fmt: skip

STATE = inertial_vectors.CARRIED + Table((
    qakf.FILTER["q_start"],
    Row("covariance", "Covariance of Q, upper triangle", "1", (symmetric.triangle_size(4),),
        start=symmetric.triangle_of_diagonal([1.0] * 4)),
    qakf.FILTER["noise_variance"],
    Row("kept_share", "b^k", "1", start=1.0),
)) + settling.STATE  # fmt: skip

INTEGRAL = Table((
    Row("integral", "K: integral of M^T M, upper triangle", "s", (symmetric.triangle_size(4),)),
))  # fmt: skip


def matrix(alpha: Any, beta: Any) -> Any:
    """M (4x4) = [beta +] - [alpha -]: M Q = beta (x) Q - Q (x) alpha."""
    d, s = beta - alpha, beta + alpha
    return ca.vertcat(ca.horzcat(0, -d.T), ca.horzcat(d, skew(s)))


def updated(p: Any, x: Any, H: Any) -> dict[str, Any]:
    """Rows of the filter after the observation 0 = H Q + v."""
    P, q = symmetric.full(x.covariance, 4), x.q_start
    innovation = -(H @ q)
    power = x.kept_share * p.forgetting
    newest = p.forgetting == 1.0
    share = select(newest, 1 / (x.samples + 1), (1 - p.forgetting) / select(newest, 1.0, 1 - power))
    excess = (ca.sumsqr(innovation) - p.subtracted * ca.trace(H @ P @ H.T)) / 4
    least, known = (p.least_noise_sigma / NOMINAL_GRAVITY) ** 2, (p.noise_sigma / NOMINAL_GRAVITY) ** 2
    estimated = maximum((1 - share) * x.noise_variance + share * excess, least)
    variance = select(p.noise_sigma > 0, known, estimated)
    correction = ca.SX.zeros(4)
    for i in range(4):
        P, correction, _ = measure_joseph(P, correction, H[i, :], innovation[i], variance, 1)
    return {
        "q_start": attitude.normalize(q + correction),
        "covariance": symmetric.triangle(P),
        "noise_variance": variance,
        "kept_share": power,
    }


def sample(p: Any, x: Any, u: Any, improved: bool) -> dict[str, Any]:
    """One inertial sample: H is M, or K in the improved filter."""
    changed, alpha, beta = inertial_vectors.carried(p, x, u)
    H = matrix(alpha / NOMINAL_GRAVITY, beta / NOMINAL_GRAVITY)
    if improved:
        changed["integral"] = x.integral + symmetric.triangle(H.T @ H) * u.dt
        H = symmetric.full(changed["integral"], 4)
    return {**changed, **updated(p, x, H), "answer_due": settling.due(x, changed["time"])}


def sensor_variance(p: Any, x: Any) -> Any:
    """Variance of attitude about n (3, rad^2) that errors of the sensors set after the time so far."""
    return inertial_vectors.stated_sigma(p, x, x.time, 0.0, x.time / 2, x.time / 2) ** 2


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now."""
    # the rotation about n at the start that a change of Q is: 2 (dQ conj(Q)), its vector part
    product = ca.horzcat(*[attitude.multiply(column, attitude.conjugate(x.q_start)) for column in ca.horzsplit(ca.SX.eye(4))])
    turn = 2 * product[1:, :]
    covariance = turn @ symmetric.full(x.covariance, 4) @ turn.T
    C_n0n = attitude.to_dcm(frozen_frame.q_n0n(x.half_turn, x.axis_n))
    by_filter = ca.diag(C_n0n.T @ covariance @ C_n0n)

    variance = sensor_variance(p, x)
    motion = settling.moved(x, x.q_start, 0.0, variance)
    stated = settling.stated(x, 0.0, variance, motion)
    return {
        "q_nb": frozen_frame.q_nb(x, x.q_start),
        "attitude_sigma": minimum(ca.sqrt(stated**2 + by_filter), qakf.LARGEST_SIGMA),
        "filter_sigma": minimum(ca.sqrt(ca.diag(covariance)), 10.0),
        "noise_variance": x.noise_variance,
        "motion_ratio": settling.motion_ratio(variance, motion),
    }


PRINTED = applicability.printed("with noise or motion it converges slowly, and its stated sigma can be too small", "q-method")


def _estimator(id: str, title: str, further: Table) -> Estimator:
    model = Model(
        id=id,
        title=f"alignment in place, the quaternion adaptive Kalman filter as its paper prints it, {title}",
        parameters=PARAMETERS,
        state=STATE + further,
        inputs=rows.SAMPLE_INPUTS,
        outputs=qakf.OUTPUTS,
        steps={
            "sample": Step(partial(sample, improved="integral" in further)),
            "keep": settling.keeping(lambda x: x.q_start, sensor_variance),
        },
        output=output,
        start=qakf.start,
    )
    return Estimator(
        model,
        kind="alignment",
        needs=lambda parameters: SETTLING_S,
        applicability=applicability.together(applicability.notes, PRINTED),
        findings=settling.findings_in_part,
    )


ESTIMATORS = [
    _estimator("qakf-printed", "on single vectors", Table()),
    _estimator("qakf-improved-printed", "on their integral", INTEGRAL),
]
