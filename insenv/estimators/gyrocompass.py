"""`gyrocompass`: the classical alignment of a vehicle in place: levelling by velocity feedback, then the heading loop.

It starts from a stated heading; the larger the error of that, the longer it takes. With phi the attitude error about n,
v the error of the integrated velocity (the true one is zero) and R the horizontal Earth rate:

    v_N' = -g phi_E - K1 v_N,   phi_E' = R phi_D + K2 v_N / g,   phi_D' = K3 v_N / (g R)
    v_E' =  g phi_N - K1 v_E,   phi_N' = -K2 v_E / g

Levelling (the first `levelling_time`) has K1 = 2/tau, K2 = 1/tau^2, K3 = 0: a double pole at -1/tau, with tau =
`levelling_constant`. The heading loop has K1 = 3/tau, K2 = 3/tau^2, K3 = 1/tau^3: a triple pole at -1/tau, with tau =
`heading_constant`. A sway of displacement d leaves a heading error d / (tau^3 g R), so the sway determines the time
constant; it leaves a tilt K2 d / g. Its displacement is measured by integrating the velocity with a leak.

Source: Titterton and Weston (2004), section 10.5; Britting (1971), chapter 9; the baseline of the swaying-base paper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi as ca

from insenv.core.elementary import PI, atan2, clamp, cos, minimum, select, sin
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.contract import Estimator
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts import applicability, frozen_frame, rows

LEAK, LEARNING = 10.0, 60.0  # s: of the integral of velocity, and of the mean square of the displacement
UNLEVEL = 0.05  # rad: level by the first sample of a base that sways
LARGEST_HALF = 1.5  # rad: half of a start heading error whose decay can be stated
SWAY = 2.0  # the leak and the phase take a part of the displacement

PARAMETERS = frozen_frame.PARAMETERS + Table((
    rows.START["start_heading"],
    Row("start_heading_sigma", "Its standard deviation", "rad", start=0.1, lower=0.0, upper=math.pi),
    Row("levelling_time", "Duration of levelling", "s", start=60.0, lower=0.0, upper=1e5),
    Row("levelling_constant", "Time constant of levelling", "s", start=10.0, lower=0.5, upper=1e4),
    Row("heading_constant", "Time constant of the heading loop", "s", start=60.0, lower=5.0, upper=1e4),
))  # fmt: skip

STATE = frozen_frame.STATE + Table((
    frozen_frame.VELOCITY,
    Row("displacement", "Its integral, with a leak", "m", (2,), "n"),
    Row("displacement_square", "Mean square of the displacement, per axis", "m^2"),
))  # fmt: skip


def loop(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Velocity feedback, once per block."""
    T, g = x.block_time, x.gravity
    levelling = x.time <= p.levelling_time
    rate = 1 / select(levelling, p.levelling_constant, p.heading_constant)
    K1, K2 = select(levelling, 2.0, 3.0) * rate, select(levelling, 1.0, 3.0) * rate**2
    K3 = select(levelling, 0.0, rate**3)
    velocity = x.velocity_n + frozen_frame.block_velocity_n(x)
    north, east = velocity[0], velocity[1]
    # at most 0.01 rad per block: at a pole the loop has no meaning and must not diverge
    heading_turn = clamp(K3 * north / frozen_frame.horizontal_earth_rate(x) / g * T, -0.01, 0.01)
    turn = ca.vertcat(-K2 * east / g * T, K2 * north / g * T, heading_turn)
    moved = (x.displacement + velocity[:2] * T) * (LEAK / (LEAK + T))
    fresh = T / minimum(x.time, LEARNING)
    return {
        "q_n0i": frozen_frame.corrected(x, turn),
        "displacement": moved,
        "displacement_square": x.displacement_square + fresh * (ca.sumsqr(moved) / 2 - x.displacement_square),
        "velocity_n": ca.vertcat((1 - K1 * T) * velocity[:2], 0),
        **rows.at_start(frozen_frame.BLOCK),
    }


def decayed(s: Any) -> Any:
    """exp(-s) as (1 + s/64)^-64."""
    decay = 1 / (1 + s / 64)
    for _ in range(6):
        decay = decay * decay
    return decay


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now, and the limit of biases and white noise with the remainder of the start heading error."""
    g, earth_rate = x.gravity, frozen_frame.horizontal_earth_rate(x)
    tau = p.heading_constant
    tilt = p.accel_bias_sigma / g
    # impulse response of the loop tau^-3 t^2/2 exp(-t/tau): integrals of its square and of its slope's square
    noise = p.angle_random_walk**2 * (0.1875 / tau) + (p.velocity_random_walk / g) ** 2 / (16 * tau**3)
    # the start heading error decays as (1 + s + s^2/2) exp(-s), s in time constants
    levelling = x.time <= p.levelling_time
    s = select(levelling, 0.0, (x.time - p.levelling_time) / tau)
    left = (1 + s + s * s / 2) * decayed(s)
    # the loop turns by the sine of the error, so the tangent of its half decays: a large error takes longer
    half = minimum(p.start_heading_sigma / 2, LARGEST_HALF)
    rest = 2 * atan2(sin(half) * left, cos(half))
    heading = minimum(ca.sqrt(frozen_frame.heading_variance(p, x, noise) + rest * rest), PI)
    # of the first sample's level, by a double pole, then of the sway at the end of levelling, by the triple pole
    fine = p.levelling_constant
    s = minimum(x.time, p.levelling_time) / fine
    first = UNLEVEL * (1 + s) * decayed(s) * left
    sway = x.displacement_square * ((left / fine**2) ** 2 + select(levelling, 0.0, 3 / tau**2) ** 2) / g**2
    # K1 / K2 times the rates that the loop balances: the gyros' bias and that of the heading error
    ratio = select(levelling, 2 * fine, tau)
    level = ca.sqrt(tilt**2 + ratio**2 * (p.gyro_bias_sigma**2 + (earth_rate * rest) ** 2) + first**2 + SWAY * sway)
    return {"q_nb": frozen_frame.q_nb(x, x.q_n0i), "attitude_sigma": ca.vertcat(level, level, heading)}


MODEL = Model(
    id="gyrocompass",
    title="classical alignment in place: levelling by velocity feedback, then the gyrocompass heading loop",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=rows.ALIGNMENT,
    steps={
        "begin": frozen_frame.levelling(lambda p: p.start_heading),
        "sample": Step(frozen_frame.sample),
        "loop": Step(loop, when="block_due"),
    },
    output=output,
    start=frozen_frame.start,
)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known."""
    sigma = min(known.heading_sigma, math.pi)
    return {**frozen_frame.prepare(known), "start_heading": known.heading, "start_heading_sigma": sigma}


SETTLING = 8.4
"""Heading constants after which 1 % of the start heading error is left: (1 + s + s^2 / 2) exp(-s)."""


def needs(parameters: Mapping[str, Any]) -> float:
    """Time (s) of data: levelling, and the decay of the start heading error to a hundredth."""
    return float(parameters["levelling_time"]) + SETTLING * float(parameters["heading_constant"])


ESTIMATOR = Estimator(
    MODEL,
    kind="alignment",
    prepare=prepare,
    needs=needs,
    applicability=applicability.together(applicability.notes, applicability.far_heading),
    on_turntable=applicability.TURNED,
)
