"""`ecef-kf-printed`: the ECEF fine alignment of the paper as printed, a filter of 12 states at the rate of the inertial unit.

`ecef-kf` is insenv's filter of the same states; this one is for comparison with the paper. At every sample:

    attitude     q_t from q_t-2 by (28)-(34): each sample from the one two before, as the indices of (30) say
    velocity     v += (C_t-1 + C_t) dv / 2 + (g - 2 omega_ie x v) dt
    time update  P = Phi P Phi^T + Q, Phi = I + F dt of (25) with the measured specific force
    observation  z = v, H = [I 0 0 0], (26)
    feedback     velocity, attitude and biases are corrected, and the state is zero again

Correction to the paper: z = -v_ins with H = [I 0 0 0] contradicts the sign of its (8) and (12); with dv = estimate minus
truth z is +v_ins. The text leaves open the start covariance (here that of the stated attitude and of the data sheet), the noise
of the observation (`zero_velocity_sigma`), and the size of the gravity disturbance dg, which (25) counts as process noise
(`gravity_noise`, 0 here). Its start is the stated attitude, and the base must be at rest: a sway is taken for tilt.

Stated accuracy: P, larger where the innovations are larger than it says (their mean square over 10 s): a start that is too far
for a linear filter, or a sway, shows there.

Source: the ECEF fine-alignment paper (numbers of its equations), in the notation of `insenv.estimators.ecef_kf`.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.elementary import maximum, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators import ecef_kf
from insenv.estimators.contract import Estimator
from insenv.estimators.ecef_kf import AXIS_E, N, transition
from insenv.estimators.parts import applicability, rows
from insenv.estimators.parts.kalman import innovation_variance, measure, propagate
from insenv.estimators.parts.strapdown import turned

MISFIT_TIME = 10.0
"""s: time over which the squared innovations over their variances are averaged."""

PARAMETERS = rows.chosen(
    ecef_kf.PARAMETERS, *rows.PLACE.names, *rows.START_ATTITUDE.names, "tilt_sigma", "heading_sigma"
) + Table((
    Row("zero_velocity_sigma", "Noise of the velocity of zero at each sample", "m/s", start=1e-3, lower=1e-9, upper=1e3),
    ecef_kf.PARAMETERS["velocity_sigma_start"],
    Row("gravity_noise", "White noise density of the gravity disturbance", "m/s^1.5", lower=0.0, upper=1.0),
)) + rows.chosen(rows.NOISES, angle_random_walk=1e-6, velocity_random_walk=1e-4)  # fmt: skip

STATE = Table((
    Row("q_eb", "Attitude: takes b components to e components", "1", (4,), "e", (1, 0, 0, 0)),
    Row("q_eb_before", "The same one sample before", "1", (4,), "e", (1, 0, 0, 0)),
    Row("previous_delta_angle", "Delta angle of the last sample", "rad", (3,), "b"),
    Row("velocity_e", "Velocity over the Earth", "m/s", (3,), "e"),
    *rows.chosen(ecef_kf.STATE, "accel_bias", "gyro_bias", "covariance"),
    Row("gravity_e", "Gravity", "m/s^2", (3,), "e"),
    Row("misalignment_e", "Rotation that feedback has removed since the start", "rad", (3,), "e"),
    ecef_kf.STATE["innovation"],
    Row("misfit", "Mean squared innovation over its variance", "1", start=1.0),
    Row("samples", "Number of samples so far", "1"),
))  # fmt: skip


def start(p: Any) -> dict[str, Any]:
    """The stated attitude, its covariance, and gravity."""
    q_en = geodesy.q_ew_from_geodetic(p.latitude, p.longitude, 0)
    filter_rows = ecef_kf.start_attitude(p, q_en)
    return {
        **filter_rows,
        "q_eb_before": filter_rows["q_eb"],
        "gravity_e": geodesy.normal_gravity_e(attitude.to_dcm(q_en), p.height),
    }


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample: attitude, velocity, covariance, observation and feedback."""
    C_eb = attitude.to_dcm(x.q_eb)
    drift = (C_eb.T @ AXIS_E + x.gyro_bias) * u.dt  # (28), (29): the attitude at t-1 for both samples
    newest, before = u.delta_angle - drift, x.previous_delta_angle - drift
    first = x.samples == 0  # it has no sample before: a single step
    single = attitude.multiply(x.q_eb, attitude.from_small_rotation_vector(newest))
    double = turned(x.q_eb_before, before, newest)
    q_eb = attitude.normalize(ca.vertcat(*[select(first, single[i], double[i]) for i in range(4)]))
    delta_velocity = u.delta_velocity - x.accel_bias * u.dt
    felt = (C_eb + attitude.to_dcm(q_eb)) @ delta_velocity / 2
    velocity = x.velocity_e + felt + (x.gravity_e - 2 * ca.cross(AXIS_E, x.velocity_e)) * u.dt

    noise = ca.vertcat(
        ca.repmat((p.velocity_random_walk**2 + p.gravity_noise**2) * u.dt, 3, 1),
        ca.repmat(p.angle_random_walk**2 * u.dt, 3, 1),
        ca.SX.zeros(6),
    )
    stored = propagate(x.covariance, transition(u.dt, felt, C_eb * u.dt), noise)
    correction, square = ca.SX.zeros(N), 0
    for i in range(3):
        H = ca.SX(1, N)
        H[0, i] = 1
        square += velocity[i] ** 2 / innovation_variance(stored, H, p.zero_velocity_sigma**2) / 3
        stored, correction, _ = measure(stored, correction, H, velocity[i], p.zero_velocity_sigma**2, 1)
    moved = Values(**{**vars(x), "q_eb": q_eb, "velocity_e": velocity})
    return {
        **ecef_kf.corrected(moved, correction),
        "q_eb_before": ecef_kf.corrected(x, correction)["q_eb"],
        "previous_delta_angle": u.delta_angle,
        "covariance": stored,
        "innovation": velocity,
        "misfit": x.misfit + (square - x.misfit) * u.dt / (MISFIT_TIME + u.dt),
        "samples": x.samples + 1,
    }


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now and its covariance."""
    q_en = geodesy.q_ew_from_geodetic(p.latitude, p.longitude, 0)
    covariance = ecef_kf.covariance_n(x, q_en)
    return {
        "q_nb": attitude.normalize(attitude.multiply(attitude.conjugate(q_en), x.q_eb)),
        "attitude_sigma": ca.sqrt(ca.diag(covariance) * maximum(x.misfit, 1.0)),
        "attitude_covariance": covariance,
        **rows.values_of(x, ecef_kf.ESTIMATES),
    }


MODEL = Model(
    id="ecef-kf-printed",
    title="fine alignment in the Earth frame as its paper prints it, 12 states at the rate of the samples",
    parameters=PARAMETERS,
    state=STATE,
    inputs=rows.SAMPLE_INPUTS,
    outputs=ecef_kf.outputs(STATE),
    steps={"sample": Step(sample)},
    output=output,
    start=start,
)


PRINTED = applicability.printed("a sway of the base is taken for tilt, and no stated sigma covers that", "ecef-kf or q-method")
NOTES = applicability.together(applicability.notes, applicability.linear_start, PRINTED)
ESTIMATOR = Estimator(MODEL, kind="alignment", applicability=NOTES)
