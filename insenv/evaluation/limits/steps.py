"""The true trajectory in steps of about 0.1 s: what the linearised error equations need of it, summed over each step."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.core.model import Model
from insenv.core.runner import make_runner
from insenv.core.tables import Vector
from insenv.evaluation.limits.fixes import Fixes

Array = NDArray[np.float64]

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
        own = ends[first:last]
        shown = model.outputs.unpack(runner.run(int(own[-1]) - begin))
        block, slow = _summed(shown, own, begin, interval, C_bs, slow)
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
