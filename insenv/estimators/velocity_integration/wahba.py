"""Alignment on the move from an unknown attitude, by measured velocities, as Wahba's problem.

The equation of velocity, written in the frozen body axes i (b at the start) and in the frozen Earth axes i0 (e at the
start) and integrated, is a rotation between two vectors that are measured (Wu and Pan 2013, velocity integration
formula; here with e in place of n, so that the transport rate is not needed):

    C(Q) alpha(t) = beta(t) + constant
    alpha(t) = integral of C_b^i f dt + C_b^i (omega_ib x l)
    beta(t)  = C_e^i0 v + integral of C_e^i0 (omega_ie x v - g) dt

v is the velocity over the Earth of the point with the lever arm l: beta is then its velocity in space, so alpha has the
inertial rate of the arm and no term is missing. A velocity that is measured in body axes stands on the other side: alpha
has the term -C_b^i v^b, and beta is without C_e^i0 v. Q is constant, from b at the start to e at the start, and

    C_b^n = C_e^n C_i0^e C(Q) C_b^i

The constant is the velocity at the start; the weighted means of alpha and beta eliminate it. Q is the eigenvector of the
largest eigenvalue of Davenport's matrix of B, the sum of w dbeta dalpha^T over the measurements (Markley and Crassidis
2014, section 5.3), d being the difference from the mean. The weights w are the inverse variances of the measurements and
fade over `memory_time`.

Stated accuracy. To first order the error of C(Q) is the rotation phi (i) with

    N phi = y,   y = sum of w [dalpha x]^T (d(delta alpha) - noise),   N = sum of w [dalpha x]^T [dalpha x]

The covariance of the drift of C_b^i, of delta alpha, of its weighted mean, of y and of the constant errors follows from
linear recursions with the noises of the data sheets; that of the attitude is that of phi plus the drift. N is formed
from the one of alpha and beta that has no measurement noise, so that noise does not count as information: along a straight
line at constant speed N by GNSS is zero about the vertical, and the heading is stated as unknown.

After a gap between measurements longer than `Source.longest_gap` the sums, which would miss the turns in it, begin anew; the
current answer stays. During a gap the position is extrapolated with the last velocity; the error of n that a turn can cause
is stated: the distance since then over the radius of the Earth.

Level and heading of the answer after a measurement replace those of the current answer if their stated accuracy is better,
each for itself. So the gyros carry the heading through phases that do not show it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core import symmetric
from insenv.core.elementary import exp, maximum, select, sin_cos
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.estimators.parts import frozen_frame, lever_arm, rows
from insenv.estimators.parts.error_model import bias_sigma, variances
from insenv.estimators.parts.inertial_vectors import LARGEST_HEADING_SIGMA, davenport, largest_eigenvector
from insenv.estimators.parts.kalman import propagate
from insenv.estimators.parts.strapdown import MEMORY
from insenv.estimators.velocity_integration.source import (
    ACCEL,
    ALPHA,
    ANSWER,
    DRIFT,
    EARTH_AXIS,
    GYRO,
    LARGEST_LINEAR,
    MEAN,
    SUM,
    N,
    Source,
)

COVARIANCE_S = 1.0  # s: longest step of the covariance
UNKNOWN = LARGEST_HEADING_SIGMA  # rad
SOON = 3.0
"""s: after a measurement, for which its velocity gives the place well enough; intervals and ages are shorter."""
MEASURED = "measured"
"""The step of a measurement."""
LEAST_INFORMATION = 1e-13  # information about the heading over that about the level, below which there is none

PARAMETERS = (
    Table((Row("memory_time", "Time over which the weight of a measurement fades", "s", start=60.0, lower=1.0, upper=1e9),))
    + rows.NOISES
    + rows.MOTION_ERRORS
    + Table((rows.START_BIASES["start_gyro_bias"], rows.START_BIASES["start_gyro_bias_error"]))
)

SINCE_PROPAGATION = Table((
    Row("since_propagation", "Time since the last step of the covariance", "s"),
    Row("since_propagation_alpha", "Change of alpha in it", "m/s", (3,), "i"),
    Row("since_propagation_C_ib", "Integral of the attitude since the start over it", "s", (3, 3), "i"),
    Row("since_propagation_angle", "Sum of the delta angles in it", "rad", (3,), "b"),
))  # fmt: skip

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
        Row("force", "Specific force as it was `rate_lag` ago: half the age of the last measurement", "m/s^2", (3,), "i"),
        Row("dt", "Interval of the last sample", "s", start=0.01),
        *SINCE_PROPAGATION,
        Row("covariance_due", "1 when the covariance is to be propagated", "1"),
        Row("covariance", "Of the errors: upper triangle", "SI", (symmetric.triangle_size(N),)),
        Row("epoch", "Time of the last measurement", "s"),
        Row("pull", "Integral of the Earth's part of beta", "m/s", (3,), "i0"),
        Row("pull_rate", "Its rate at the last measurement", "m/s^2", (3,), "i0"),
        Row("weight", "Sum of the weights", "s^2/m^2"),
        Row("count", "Sum of the weights, 1 for a measurement at present", "1"),
        Row("mean_alpha", "Weighted mean of alpha", "m/s", (3,), "i"),
        Row("mean_beta", "Weighted mean of beta", "m/s", (3,), "i0"),
        Row("moment", "Weighted sum of dalpha dalpha^T, or of dbeta dbeta^T", "1", (3, 3)),
        Row("profile", "B: weighted sum of dbeta dalpha^T", "1", (3, 3)),
        Row("q_i0i", "Q, the answer kept: takes b components at the start to e components at the start", "1", (4,),
            start=(1, 0, 0, 0)),
        Row("answer_due", "1 when the answer of a measurement is to be compared with it", "1"),
        Row("latitude", "Latitude at the last measurement", "rad"),
        Row("longitude", "Longitude at the last measurement", "rad"),
        Row("height", "Height at the last measurement", "m"),
        Row("velocity_n", "Velocity at the last measurement", "m/s", (3,), "n"),
    ))
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class VelocityIntegration:
    """The alignment by one source of velocities."""

    source: Source

    @property
    def parameters(self) -> Table:
        """Those of the unit, then those of the source."""
        return PARAMETERS + self.source.parameters

    @cached_property
    def model(self) -> Model:
        """The alignment as a model."""
        return Model(
            id="velocity-integration",
            title=f"alignment on the move {self.source.title}, from an unknown attitude (Wahba's problem)",
            parameters=self.parameters,
            state=STATE + self.source.state,
            inputs=rows.SAMPLE_INPUTS + self.source.inputs,
            outputs=rows.ALIGNMENT,
            steps={
                "sample": Step(self.sample),
                "covariance": Step(covariance, when="covariance_due"),
                MEASURED: Step(self.measured, when=self.source.arrives),
                "answer": Step(self.answer, when="answer_due"),
            },
            output=self.output,
            start=self.start,
        )

    def start(self, p: Any) -> dict[str, Any]:
        """The constant errors are as the data sheets state them; all else is without error at the start."""
        biases = ca.repmat(bias_sigma(p), 3, 1), ca.repmat(p.accel_bias_sigma, 3, 1)
        sigma = ca.vertcat(ca.SX.zeros(12), ca.repmat(UNKNOWN, 3, 1), *biases, self.source.sigma(p))
        return {**self.source.start(p), "covariance": symmetric.triangle(ca.diag(sigma * sigma))}

    def sample(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """One inertial sample, less the gyro bias known at the start."""
        u = Values(**{**vars(u), "delta_angle": u.delta_angle - p.start_gyro_bias * u.dt})
        changed, force = frozen_frame.advanced(x, u)
        since_propagation = x.since_propagation + u.dt
        due = ca.logic_or(getattr(u, self.source.arrives), since_propagation + u.dt / 2 > COVARIANCE_S)
        return {
            **changed,
            **lever_arm.followed(x, u.delta_angle * (1 / u.dt), u.dt, x.samples == 0),
            "time": x.time + u.dt,
            "alpha": x.alpha + force,
            "force": lever_arm.lagging(x, x.force, force * (1 / u.dt), u.dt, x.samples == 0),
            "dt": u.dt,
            "since_propagation": since_propagation,
            "since_propagation_alpha": x.since_propagation_alpha + force,
            "since_propagation_C_ib": x.since_propagation_C_ib + attitude.to_dcm(x.q_ib) * u.dt,
            "since_propagation_angle": x.since_propagation_angle + u.delta_angle,
            "covariance_due": select(due, 1.0, 0.0),
        }

    def measured(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """One measured velocity: the sums, and the covariance of their errors."""
        age = getattr(u, self.source.age)
        epoch = x.time - age
        since = select(x.count == 0, 0.0, epoch - x.epoch)
        at = self.source.measurement(p, x, u, self.current)
        pull = x.pull + (x.pull_rate + at.pull_rate) * (since / 2)

        keep = exp(-since / p.memory_time)
        if self.source.longest_gap is not None:
            keep = select(since > self.source.longest_gap, 0.0, keep)
        before = keep * x.weight
        weight = before + 1 / at.variance
        share = 1 / (at.variance * weight)
        dalpha, dbeta = at.alpha - x.mean_alpha, at.velocity + pull - x.mean_beta
        product = before * share
        exact = self.source.exact(p, dalpha, dbeta)
        return {
            "covariance": collected(x.covariance, dalpha, keep, share, product, at.error, at.variance),
            "epoch": epoch,
            "pull": pull,
            "pull_rate": at.pull_rate,
            "weight": weight,
            "count": keep * x.count + 1,
            "mean_alpha": x.mean_alpha + share * dalpha,
            "mean_beta": x.mean_beta + share * dbeta,
            "moment": keep * x.moment + product * exact @ exact.T,
            "profile": keep * x.profile + product * dbeta @ dalpha.T,
            "answer_due": 1.0,
            **at.place,
            **lever_arm.lagged(age),
        }

    def answer(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        """Level and heading of the answer of the measurement take the place of the current ones where they are better."""
        q_measured = largest_eigenvector(davenport(x.profile))
        latest, current = attitude.normalize(q_ni(x, q_measured)), q_ni(x, x.q_i0i)
        C_ni = attitude.to_dcm(latest)
        C_moment = self.source.exact(p, C_ni, C_ni @ attitude.to_dcm(q_measured).T)
        # with what is known of an unknown attitude, and more than rounding, so that there is an inverse
        known = 1 / UNKNOWN**2 + LEAST_INFORMATION * ca.trace(x.moment)
        information = (ca.trace(x.moment) + known) * ca.SX.eye(3) - x.moment
        inverse = ca.inv_minor(C_moment @ information @ C_moment.T)

        def replaced(part: Any) -> tuple[Any, Any]:
            """Covariance with this part (3, about n) of the current answer replaced, and the variances of the attitude."""
            Phi, new = ca.SX.eye(N), ca.diag(part) @ inverse
            Phi[ANSWER, ANSWER] = C_ni.T @ ca.diag(1 - part) @ C_ni
            Phi[ANSWER, SUM] = C_ni.T @ new @ C_ni
            P = Phi @ symmetric.full(x.covariance, N) @ Phi.T
            P[ANSWER, ANSWER] += C_ni.T @ new @ new.T @ C_ni * (known * UNKNOWN) ** 2
            return P, variance_n(P, C_ni)

        now, other = variance_n(symmetric.full(x.covariance, N), C_ni), replaced(ca.SX.ones(3))[1]
        level, heading = other[0] + other[1] < now[0] + now[1], other[2] < now[2]
        part = ca.vertcat(level, level, heading)
        apart = attitude.error_rotation_vector(latest, current)
        q = attitude.multiply(attitude.from_rotation_vector((part - 1) * apart), latest)
        back = attitude.conjugate(q_ni(x, ca.vertcat(1, 0, 0, 0)))
        return {
            "covariance": symmetric.triangle(replaced(part)[0]),
            "q_i0i": attitude.normalize(attitude.multiply(back, q)),
            "answer_due": 0.0,
        }

    def current(self, p: Any, x: Any) -> tuple[Any, Any]:
        """Takes i components to n components now by the current answer (4), and 1 where its heading is known."""
        q = attitude.normalize(q_ni(x, x.q_i0i))
        variance = variance_n(symmetric.full(x.covariance, N), attitude.to_dcm(q))[2]
        return q, select(variance < self.source.largest_heading(p) ** 2, 1.0, 0.0)

    def place_sigma(self, x: Any) -> Any:
        """Standard deviation (3, rad about n) of the attitude by a place that the velocity of the last measurement gives."""
        sine, cosine = sin_cos(x.latitude)
        unmeasured = select(x.count == 0, 0.0, maximum(x.time - x.epoch - SOON, 0.0))
        angle = ca.norm_2(x.velocity_n[:2]) * unmeasured / geodesy.A
        return angle * ca.vertcat(1.0, 1.0, sine / maximum(cosine, 1e-3))

    def output(self, p: Any, x: Any) -> dict[str, Any]:
        """Attitude now, and its stated accuracy."""
        q = attitude.normalize(q_ni(x, x.q_i0i))
        by_place = self.place_sigma(x) ** 2
        sigma = ca.sqrt(variance_n(symmetric.full(x.covariance, N), attitude.to_dcm(q)) + p.thrust_error**2 + by_place)
        largest = (LARGEST_LINEAR, LARGEST_LINEAR, self.source.largest_heading(p))
        return {
            "q_nb": attitude.normalize(attitude.multiply(q, x.q_ib)),
            "attitude_sigma": ca.vertcat(*[select(sigma[i] < largest[i], sigma[i], UNKNOWN) for i in range(3)]),
        }


# The attitude by an answer, and the covariance of its errors.


def q_ni(x: Any, q_i0i: Any) -> Any:
    """Takes b components at the start to n components now (4)."""
    since = select(x.count == 0, 0.0, x.time - x.epoch)
    latitude, longitude, _ = geodesy.geodetic_from_ned_offset(x.velocity_n * since, x.latitude, x.longitude, x.height)
    q_ne = attitude.conjugate(geodesy.q_ew_from_geodetic(latitude, longitude, 0.0))
    q_ei = attitude.multiply(attitude.conjugate(frozen_frame.q_n0n(x.half_turn, ca.SX(EARTH_AXIS))), q_i0i)
    return attitude.multiply(q_ne, q_ei)


def variance_n(P: Any, C_ni: Any) -> Any:
    """Variances of the attitude by the current answer, about n (3, rad^2)."""
    both = P[ANSWER, ANSWER] + P[DRIFT, DRIFT] + P[ANSWER, DRIFT] + P[DRIFT, ANSWER]
    return ca.diag(C_ni @ both @ C_ni.T)


def covariance(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Propagate the covariance: drift' = C b_g + noise, (delta alpha)' = -f x drift + C b_a + noise."""
    A = ca.SX(N, N)
    A[ALPHA, DRIFT] = -skew(x.since_propagation_alpha)
    A[DRIFT, GYRO] = A[ALPHA, ACCEL] = x.since_propagation_C_ib
    by_rotation, _ = variances(p, x.since_propagation_angle, ca.SX.zeros(3))
    noise = ca.vertcat(
        ca.repmat(p.angle_random_walk**2 * x.since_propagation + by_rotation, 3, 1),
        ca.repmat(p.velocity_random_walk**2 * x.since_propagation, 3, 1),
        ca.SX.zeros(N - 6),
    )
    return {"covariance": propagate(x.covariance, A, noise), **rows.at_start(SINCE_PROPAGATION)}


def collected(stored: Any, dalpha: Any, keep: Any, share: Any, product: Any, error: Any, variance: Any) -> Any:
    """Covariance triangle after a measurement. With e = error x - noise, the error of alpha less that of the measurement,

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
