"""The true trajectory in steps of about 0.1 s: what the linearised error equations need of it, summed over each step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.model import Model
from insenv.core.runner import make_runner
from insenv.core.tables import Array, Vector

# The fixes of a GNSS receiver as measurements of the error states.

LEAST_NOISE = 1e-4
"""Smallest standard deviation of a fix, m and m/s: that of a receiver without errors."""


@dataclass(frozen=True)
class Fixes:
    """A receiver: when it measures, when it delivers, and how well.

    interval, latency: inertial samples.  offset: time from an epoch to its sample, s.  lever_arm (3): b, m.
    sigma (6): standard deviations of the white noise of position (m), with the share of outliers as lost fixes, and velocity
    (m/s) in n; infinite where there is no measurement.  outages (k, 2): begin and end, s.  sample_interval: s.
    """

    interval: int
    latency: int
    offset: float
    lever_arm: Array
    sigma: Array
    outages: Array
    sample_interval: float

    def samples(self, count: int) -> NDArray[np.int64]:
        """0, the samples of all epochs and deliveries up to `count`, and `count`, rising."""
        epochs = np.arange(self.interval, count + 1, self.interval)
        samples = np.unique(np.concatenate([[0, count], epochs, epochs + self.latency]))
        return samples[samples <= count].astype(np.int64)

    def measured(self, sample: int) -> bool:
        """Whether the sample is that of an epoch which gives a fix."""
        if sample % self.interval:
            return False
        time = sample * self.sample_interval - self.offset + 1e-6
        return not bool(np.any((time >= self.outages[:, 0]) & (time < self.outages[:, 1])))


def fixes_of(rows: Mapping[str, Any], sample_interval: float) -> Fixes | None:
    """The receiver of a plant's parameters by row name (SI); None if there is none."""
    if "gnss_interval" not in rows:
        return None
    good = 1.0 - float(rows["gnss_outlier_probability"])  # a detected outlier is a fix that is missing
    share = np.inf if good <= 0.0 else 1.0 / np.sqrt(good)
    position, velocity = (
        np.maximum(np.broadcast_to(np.asarray(rows[name], dtype=float), 3), LEAST_NOISE)
        for name in ("gnss_position_noise", "gnss_velocity_noise")
    )
    has_velocity = float(rows["gnss_has_velocity"]) != 0.0
    return Fixes(
        interval=round(float(rows["gnss_interval"]) / sample_interval),
        latency=round(float(rows["gnss_latency"]) / sample_interval),
        offset=float(rows["gnss_epoch_offset"]),
        lever_arm=np.asarray(rows["antenna_lever_arm_b"], dtype=float),
        sigma=np.concatenate([position * share, velocity if has_velocity else np.full(3, np.inf)]),
        outages=outages_of("gnss", rows),
        sample_interval=sample_interval,
    )


def outages_of(id: str, rows: Mapping[str, Any]) -> Array:
    """Begin and end (k, 2) of the outage windows of an instrument, s."""
    return np.stack([np.ravel(rows[f"{id}_outage_{end}"]) for end in ("start", "end")], axis=1).astype(float)


STEP_S = 0.1
"""Largest length of a step, s.  At 0.2 s the bounds differ by less than 1 %."""
AT_ONCE = 20_000
"""Inertial samples that are simulated and summed at once: about 20 MB."""
REST_MPS, REST_S = 0.05, 1.0
"""A vehicle rests when it has been slower than this for this time."""


@dataclass(frozen=True)
class Steps:
    """m steps of a trajectory.  n: north, east, down; s: sensor axes.

    end (m,): number of the inertial sample that ends a step.  time, length (m,): at its end, of it, s.
    C_ns (m, 3, 3): integral of C_ns dt, s.  angle, force (m, 3, 3, 3): sums over the samples of C_ns[:, k] times component
    j of the increment of angle (rad) and velocity (m/s), [:, n, k, j].  thrust (m, 3): integral of the specific force in n,
    m/s.
    At the end of a step: q_nb (m, 4), rate_n (m, 3): omega_eb in n, rad/s; velocity_n (m, 3); latitude, longitude, height
    (m,); rest (m,): whether the vehicle rests.
    """

    end: NDArray[np.int64]
    time: Array
    length: Array
    C_ns: Array
    angle: Array
    force: Array
    thrust: Array
    q_nb: Array
    rate_n: Array
    velocity_n: Array
    latitude: Array
    longitude: Array
    height: Array
    rest: NDArray[np.bool_]


def step_ends(samples: int, interval: float, fixes: Fixes | None) -> NDArray[np.int64]:
    """Numbers of the samples that end a step: at most `STEP_S` apart, every epoch and every delivery of a fix among them."""
    largest = max(1, int(STEP_S / interval + 1e-9))
    marks = np.array([0, samples], dtype=np.int64) if fixes is None else fixes.samples(samples)
    parts = np.maximum(1, -(-np.diff(marks) // largest))
    ends = [np.round(np.linspace(a, b, n + 1)[1:]) for a, b, n in zip(marks[:-1], marks[1:], parts, strict=True)]
    if fixes is None:  # whole steps, so that the records of a run coincide with ends
        ends = [np.append(np.arange(largest, samples, largest), samples)]
    return np.concatenate(ends).astype(np.int64)


def steps_along(model: Model, parameters: Vector, interval: float, ends: NDArray[np.int64], C_bs: Array) -> Iterator[Steps]:
    """The steps of the trajectory of a plant, some thousand samples at a time.

    model, parameters: the plant's.  interval: of its samples, s.  ends: from `step_ends`.  C_bs (3, 3): from sensor to body
    axes.
    """
    runner = make_runner(model, parameters)
    slow, first = REST_S, 0  # s: a vehicle that is slow at time 0 has rested before
    while first < len(ends):
        begin = int(ends[first - 1]) if first else 0
        last = max(first + 1, int(np.searchsorted(ends, begin + AT_ONCE, side="right")))
        block_ends = ends[first:last]
        shown = model.outputs.unpack(runner.run(int(block_ends[-1]) - begin))
        block, slow = _summed(shown, block_ends, begin, interval, C_bs, slow)
        yield block
        first = last


def _summed(
    shown: dict[str, Array], ends: NDArray[np.int64], begin: int, interval: float, C_bs: Array, slow: float
) -> tuple[Steps, float]:
    """The steps that end at `ends`, from the outputs of the samples after `begin`; `slow`: for how long it has been, s."""
    starts = np.concatenate([[begin], ends[:-1]]) - begin
    last = ends - begin - 1
    angle, velocity = shown["true_delta_angle"], shown["true_delta_velocity"]
    # attitude at the middle of each sample
    C_ns = attitude.numeric.to_dcm(shown["q_nb"]) @ (np.eye(3) - attitude.numeric.skew(angle / 2)) @ C_bs

    def total(values: Array) -> Array:
        return np.asarray(np.add.reduceat(values, starts, axis=0))

    def crossed(increments: Array) -> Array:
        return total(C_ns[..., None] * increments[:, None, None, :])

    length = (ends - np.concatenate([[begin], ends[:-1]])) * interval
    at_end = {name: shown[name][last] for name in ("q_nb", "velocity_n", "latitude", "longitude", "height")}
    angle_s, velocity_s = angle @ C_bs, velocity @ C_bs
    force = crossed(velocity_s)
    rate_ib_n = (C_ns[last] @ angle_s[last, :, None])[..., 0] / interval
    rest, slow = _rest(np.linalg.norm(at_end["velocity_n"], axis=1), length, slow)
    return Steps(
        end=ends,
        time=np.asarray(ends * interval, dtype=float),
        length=length,
        C_ns=total(C_ns) * interval,
        angle=crossed(angle_s),
        force=force,
        thrust=np.einsum("mnkk->mn", force),
        rate_n=rate_ib_n - geodesy.numeric.earth_rate_n(at_end["latitude"]),
        rest=rest,
        **at_end,
    ), slow


def _rest(speed: Array, length: Array, slow: float) -> tuple[NDArray[np.bool_], float]:
    """Whether the vehicle rests at the end of each step, and for how long it has been slow at the last one, s."""
    rest = np.zeros(len(speed), dtype=bool)
    for place, still in enumerate(speed < REST_MPS):
        slow = slow + length[place] if still else 0.0
        rest[place] = slow >= REST_S - 1e-9
    return rest, slow


# The linearised error equations of a strapdown mechanization in Earth axes, over steps of a trajectory.
#
# Errors are estimate minus truth, C_est = (I + [psi x]) C_eb, all in Earth axes e:
#
#     psi' = -Omega x psi + C eps_g
#     dv'  = -f x psi - 2 Omega x dv + Gamma dr + C eps_a
#     dr'  = dv
#
# Gamma is the gradient of gravity (with the centrifugal part, as in normal gravity).  Over a step A is the integral of the
# matrix of these equations, and the transition is I + A + A^2 / 2.  This is the mechanization of the truth, linearised on the
# truth; no estimator's equations are used.  Source: Groves 2013, section 14.2.3 (with the opposite sign of attitude), with the
# gradient of the whole gravity vector.

PSI, DV, DR = slice(0, 3), slice(3, 6), slice(6, 9)
NAVIGATION = 9
"""Number of navigation errors, which come first in the state."""
OMEGA_IE_E = np.array([0.0, 0.0, geodesy.OMEGA_IE])
_HEIGHT, _LATITUDE = 10.0, 1e-4
"""Differences for the gradient of gravity, m and rad: gravity is smooth over thousands of kilometres."""


def earth_axes(latitude: Array, longitude: Array) -> Array:
    """C_en (m, 3, 3)."""
    return np.asarray(geodesy.numeric.C_en(latitude, longitude))


def gravity_gradient_n(latitude: Array, height: Array) -> Array:
    """Change of the gravity vector per displacement, in axes that keep their direction, (m, 3, 3), 1/s^2.

    Gravity points down along the ellipsoid's normal, which turns by a displacement over the radius of curvature.
    """

    def gravity(latitude: Array, height: Array) -> Array:
        return np.asarray(geodesy.numeric.normal_gravity(np.sin(latitude), height))

    R_M, R_N = geodesy.numeric.radii(np.sin(latitude))
    g = gravity(latitude, height)
    gradient = np.zeros((len(latitude), 3, 3))
    gradient[:, 0, 0] = -g / (R_M + height)
    gradient[:, 1, 1] = -g / (R_N + height)
    gradient[:, 2, 2] = -(gravity(latitude, height + _HEIGHT) - gravity(latitude, height - _HEIGHT)) / (2 * _HEIGHT)
    by_latitude = (gravity(latitude + _LATITUDE, height) - gravity(latitude - _LATITUDE, height)) / (2 * _LATITUDE)
    gradient[:, 2, 0] = by_latitude / (R_M + height)
    return gradient


def integrals(steps: Steps, C_en: Array, thrust_n: Array) -> Array:
    """A (m, 9, 9): integral of the matrix of the error equations over each step.

    thrust_n (m, 3): integral of the specific force in n, m/s.
    """
    count, length = len(steps.time), steps.length[:, None, None]
    turning = attitude.numeric.skew(OMEGA_IE_E) * length
    C_ne = C_en.swapaxes(1, 2)
    A = np.zeros((count, 9, 9))
    A[:, PSI, PSI] = -turning
    A[:, DV, PSI] = -attitude.numeric.skew((C_en @ thrust_n[..., None])[..., 0])
    A[:, DV, DV] = -2 * turning
    A[:, DV, DR] = C_en @ gravity_gradient_n(steps.latitude, steps.height) @ C_ne * length
    A[:, DR, DV] = np.eye(3) * length
    return A


def local(steps: Steps, C_en: Array) -> Array:
    """W (m, 9, 9): from (psi, dv, dr) in e to the misalignment (rad), velocity (m/s) and position errors (m) in n.

    An error of position turns the axes n of the estimate: phi = C_ne psi - dtheta, dv_n = C_ne dv - dtheta x v_n, with
    dtheta = (dE / (R_N + h), -dN / (R_M + h), -dE tan L / (R_N + h)).
    """
    R_M, R_N = geodesy.numeric.radii(np.sin(steps.latitude))
    turn = np.zeros((len(steps.time), 3, 3))
    turn[:, 0, 1] = 1 / (R_N + steps.height)
    turn[:, 1, 0] = -1 / (R_M + steps.height)
    turn[:, 2, 1] = -np.tan(steps.latitude) / (R_N + steps.height)
    C_ne = C_en.swapaxes(1, 2)
    W = np.zeros((len(steps.time), 9, 9))
    for block in (PSI, DV, DR):
        W[:, block, block] = C_ne
    W[:, PSI, DR] = -turn @ C_ne
    W[:, DV, DR] = attitude.numeric.skew(steps.velocity_n) @ turn @ C_ne
    return W


def euler_jacobian(q_nb: Array) -> Array:
    """d(roll, pitch, heading)/d(misalignment about n) (m, 3, 3)."""
    _, pitch, heading = attitude.numeric.to_euler(q_nb)
    cosine = np.where(np.abs(np.cos(pitch)) < 1e-6, 1e-6, np.cos(pitch))
    c, s = np.cos(heading), np.sin(heading)
    J = np.zeros((len(q_nb), 3, 3))
    J[:, 0, 0], J[:, 0, 1] = c / cosine, s / cosine
    J[:, 1, 0], J[:, 1, 1] = -s, c
    J[:, 2, 0], J[:, 2, 1], J[:, 2, 2] = c * np.sin(pitch) / cosine, s * np.sin(pitch) / cosine, 1.0
    return J
