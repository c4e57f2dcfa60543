"""`q-method`: alignment in place, at any attitude and on any sway, as Wahba's problem in the inertial frame.

The constant quaternion Q minimises the integral of w |beta - C(Q) alpha|^2 over the vectors of
`insenv.estimators.parts.inertial_vectors`: it is the eigenvector of the largest eigenvalue of Davenport's 4x4 matrix of
the profile B, the integral of w beta alpha^T. There is no start attitude, no singular attitude and nothing random.
Source: the quaternion adaptive-Kalman paper, section 2.1; Davenport's matrix: Markley and Crassidis (2014), section
5.3.

B is linear in alpha, so the weights w alone suppress the accelerations of a swaying base, whatever their size. With h
the step response of a low-pass and l its response to exp(-t / memory_time), the weight of the vectors at time t in a
run of length T is

    w(t) = l(t) h(T - t) + 2 h(t) l(T - t)

symmetric at both ends except for the factor: each term rises as smoothly as the filter does, and fades over
`memory_time` (see `inertial_vectors` for the reason). It is computed as the sum, passed through the low-pass, of an
integral with weights l and a forgetting integral of vectors with weights h. The integrals grow with each sample; h, l
and the low-pass are slow and advance every `STRIDE` smoothing times.

The low-pass has zeros at the frequencies of waves (`FILTER`), so its delay is shorter than that of a Butterworth filter
that attenuates periods of 5 to 10 s as much. Its nine numbers minimise, at `smoothing_time` = 4 s and 30 deg of
latitude, the heading error that white noise leaves after 150 and 300 s (`memory_time` 34 s, and with all weights
equal). Penalties keep the heading error after 300 s of a horizontal sway of 0.5 m below 0.004 deg at periods up to 8 s,
0.008 deg at 10 s, 0.012 deg at 11 s, 0.04 deg at 12 s. No section is damped by less than 0.15: ringing filters have a
shorter delay still, but not in short runs. With `smoothing_time` 0 and a large `memory_time` all weights are equal,
which is the paper's integral.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.parts import applicability, frozen_frame, inertial_vectors, rows, settling
from insenv.estimators.parts.inertial_vectors import davenport, largest_eigenvector

FILTER = ((1.3291, 2.6805, 0.1230), (0.7494, 0.2960, 0.2768), (0.6543, 0.1962, 0.4056))
"""Sections (1 + (c s)^2) / (1 + b s + (a s)^2) of the low-pass: a, b, c in smoothing times."""
SECTIONS = len(FILTER)
DELAY = 2 * sum(b for _, b, _ in FILTER)  # smoothing times of delay, both ends together
STRIDE = 1.0 / 80.0  # smoothing times from one step of the low-pass to the next: 0.05 s of 4 s
LATE = 2.0  # weight of late vectors over early ones: late ones show the present vertical, both show heading

WEIGHTS, PROFILE = 2, 9  # channels of the low-pass: h and l; the elements of B, column by column

STATE = inertial_vectors.CARRIED + Table((
    Row("early_profile", "Integral of beta alpha^T with the weights l, which fade out after the start", "m^2/s^3", (3, 3)),
    Row("late_profile", "The same with weights that fade out before now", "m^2/s^3", (3, 3)),
    Row("decay", "exp(-time / memory_time)", "1", start=1.0),
    Row("weight", "h and l now", "1", (WEIGHTS,)),
    Row("weights", "h and l: step response of each section, its response to the decay", "1", (SECTIONS, WEIGHTS)),
    Row("weight_rates", "Their rates", "1/s", (SECTIONS, WEIGHTS)),
    Row("smoothed", "The profiles' sum inside each section", "m^2/s^3", (SECTIONS, PROFILE)),
    Row("smoothed_rates", "Their rates", "m^2/s^4", (SECTIONS, PROFILE)),
    Row("profile", "B: the sum after the low-pass", "m^2/s^3", (3, 3)),
    Row("smoothing_age", "Time since the last step of the low-pass", "s"),
    Row("smoothing_due", "1 when its next step is due", "1"),
)) + settling.STATE  # fmt: skip


def low_pass(values: Any, rates: Any, value: Any, time_constant: Any, dt: Any) -> tuple[Any, Any, Any]:
    """States and their rates (sections x channels) after a step of dt, and the output, for an input (1 x channels).

    Implicit midpoint rule, with input and output at mid-step: the bilinear transform, which keeps the zeros on the axis
    and is stable at any interval; with time constant 0 the output is the input and the states do not change.
    """
    after, slopes, half, step = [], [], dt / 2, (time_constant > 0) * dt
    for i, (a, b, c) in enumerate(FILTER):
        a, b, c = a * time_constant, b * time_constant, c * time_constant
        per = 1 / (a * a + half * (b + half))
        curvature = (value - values[i, :] - (half + b) * rates[i, :]) * per
        rate = rates[i, :] + half * curvature
        value = values[i, :] + half * rate + c * c * curvature
        after.append(values[i, :] + step * rate)
        slopes.append(rates[i, :] + step * curvature)
    return ca.vertcat(*after), ca.vertcat(*slopes), value


def start(p: Any) -> dict[str, Any]:
    """The rows that the place determines; without a low-pass all weights are 1."""
    plain = p.smoothing_time == 0
    return {**inertial_vectors.start(p), "weight": ca.vertcat(plain, plain)}


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    changed, alpha, beta = inertial_vectors.carried(p, x, u)
    keep = p.memory_time / (p.memory_time + u.dt)
    product = (beta @ alpha.T) * u.dt
    age = x.smoothing_age + u.dt
    return {
        **changed,
        "early_profile": x.early_profile + x.weight[1] * product,
        "late_profile": keep * x.late_profile + x.weight[0] * product,
        "decay": keep * x.decay,
        "smoothing_age": age,
        "smoothing_due": age + 0.5 * u.dt >= STRIDE * p.smoothing_time,
        "answer_due": settling.due(x, changed["time"]),
    }


def smooth(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One step of the low-pass: the weights until the next step, and B."""
    dt, time_constant = x.smoothing_age, p.smoothing_time
    weights, weight_rates, weight = low_pass(x.weights, x.weight_rates, ca.horzcat(1, x.decay), time_constant, dt)
    total = ca.reshape(x.early_profile + LATE * x.late_profile, 1, PROFILE)
    smoothed, smoothed_rates, profile = low_pass(x.smoothed, x.smoothed_rates, total, time_constant, dt)
    return {
        "weight": weight.T,
        "weights": weights,
        "weight_rates": weight_rates,
        "smoothed": smoothed,
        "smoothed_rates": smoothed_rates,
        "profile": ca.reshape(profile, 3, 3),
        "smoothing_age": 0.0,
        "smoothing_due": 0.0,
    }


def answer(x: Any) -> Any:
    """Q (4): takes components in b at the start to n at the start."""
    return largest_eigenvector(davenport(x.profile))


def sensor_variance(p: Any, x: Any) -> Any:
    """Variance of attitude about n (3, rad^2) that errors of the sensors set after the time so far."""
    # mean time of the early vectors after the start, and of the late ones before now
    ends = x.time / ca.sqrt(4 + (x.time / p.memory_time) ** 2)
    age = (x.time - ends + LATE * ends) / (1 + LATE)
    return inertial_vectors.stated_sigma(p, x, x.time, DELAY * p.smoothing_time, age, age) ** 2


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now."""
    q, lost, variance = answer(x), DELAY * p.smoothing_time, sensor_variance(p, x)
    motion = settling.moved(x, q, lost, variance)
    return {
        "q_nb": frozen_frame.q_nb(x, q),
        "attitude_sigma": settling.stated(x, lost, variance, motion),
        "motion_ratio": settling.motion_ratio(variance, motion),
    }


MODEL = Model(
    id="q-method",
    title="alignment in place by many vectors in the inertial frame (Wahba's problem)",
    parameters=inertial_vectors.PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=rows.ALIGNMENT + Table((settling.RATIO,)),
    steps={
        "sample": Step(sample),
        "smooth": Step(smooth, when="smoothing_due"),
        "keep": settling.keeping(answer, sensor_variance),
    },
    output=output,
    start=start,
)

ESTIMATOR = Estimator(
    MODEL,
    kind="alignment",
    prepare=inertial_vectors.prepare,
    needs=inertial_vectors.needs,
    applicability=applicability.notes,
    on_turntable=applicability.TURNED,
    findings=settling.findings,
)
