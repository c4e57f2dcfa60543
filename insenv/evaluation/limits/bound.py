"""`Limit`: the posterior Cramer-Rao bound along a trajectory, and its statistics."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.model import Model
from insenv.core.tables import Array
from insenv.evaluation.chi_square import quantile
from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION, STEEP, VELOCITY
from insenv.evaluation.limits.recursion import Layout, Prior, recursion
from insenv.evaluation.limits.states import aids_of, mooring_of, receiver_of, unit_of
from insenv.evaluation.limits.steps import Steps, fixes_of, step_ends, steps_along

FLOOR = {
    **dict.fromkeys(ATTITUDE[:2], 1e-6),
    ATTITUDE[2]: 1e-4,
    **dict.fromkeys(VELOCITY, 1e-4),
    **dict.fromkeys(POSITION, 1e-3),
}
"""By channel: below it, the limit is that of the numbers that keep the recursion regular (a unit without noise, a velocity
of 0 at rest), and a ratio to it has no meaning."""
_ORDER = (*ATTITUDE, *VELOCITY, *POSITION)


@dataclass(frozen=True, repr=False)
class Limit:
    """The smallest standard deviation that any method can have, over the ensemble of units, noises and start errors.

    time (n,) s, rising from 0.  rotation (n, 3): of the attitude as a rotation about north, east and down, rad.  sigma: by
    channel (`insenv.evaluation.errors.CHANNELS`), (n,) deg, m/s or m.  All at these times, after everything delivered by then.
    """

    time: Array
    rotation: Array
    sigma: dict[str, Array]

    def at(self, times: Array) -> dict[str, Array]:
        """By channel, at other times (m,) s from 0 to the end: variances are interpolated.  Raises `InputError` for others."""
        asked = self._checked(times)
        return {name: np.sqrt(np.interp(asked, self.time, values**2)) for name, values in self.sigma.items()}

    def rms(self, times: Array, from_s: float = 0.0) -> dict[str, float]:
        """By channel, over the times (m,) s from `from_s` on: the root mean square, as the statistic of the errors there.

        Raises `InputError` for times outside the limit's, or if none is left.
        """
        asked = self._checked(times)
        late = asked[asked >= from_s - 1e-9]
        if not late.size:
            what = f"{asked.size} times, from_s = {from_s:g} s"
            raise InputError(f"limit: {what}: none of the times is at or after from_s; allowed is at least one")
        return {name: float(np.sqrt(np.mean(values**2))) for name, values in self.at(late).items()}

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Channels that show no error of the attitude: roll and heading of a run whose pitch comes near 90 deg.

        An error of the heading is at most that about down and tan(pitch) times that about a level axis.
        """
        north, east, down = np.degrees(self.rotation).T
        most = down + np.tan(np.radians(STEEP)) * np.hypot(north, east)
        return ("roll_deg", "heading_deg") if np.any(self.sigma["heading_deg"] > 1.001 * most) else ()

    def _checked(self, times: Array) -> Array:
        """Times as an array (m,) of floats within those of the limit."""
        try:
            asked = np.atleast_1d(np.asarray(times, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputError(f"limit: times = {times!r}: allowed are numbers (s)") from None
        end = float(self.time[-1])
        wrong = asked[~((asked >= -1e-9) & (asked <= end + 1e-9))]
        if wrong.size:
            raise InputError(f"limit: time {wrong[0]:g} s: allowed is 0 to {end:g} s, the duration of its run")
        return asked

    def __repr__(self) -> str:
        last = ", ".join(f"{name} {self.sigma[name][-1]:.3g}" for name in CHANNELS)
        return f"Limit at {self.time[-1]:g} s: {last}"


def ratio(rms: float, limit: float | None, channel: str) -> float | None:
    """rms / limit, or None where there is no limit or it is at its numerical floor."""
    return None if not limit or limit < FLOOR[channel] else rms / limit


def ratio_bounds(runs: int) -> tuple[float, float]:
    """95 % bounds of rms/limit of an optimal estimator over so many runs: sqrt(chi2_n / n).

    The errors of a run are taken as one draw, because the biases of its unit are.
    """
    low, high = quantile(((1 - 0.95) / 2, (1 + 0.95) / 2), runs)
    return float(np.sqrt(low / runs)), float(np.sqrt(high / runs))


def bound(
    model: Model,
    rows: Mapping[str, Any],
    prior: Prior,
    samples: int,
    *,
    in_place: bool,
    progress: Callable[[int, int], None] | None = None,
) -> Limit:
    """The limit along the trajectory of a plant.

    model, rows: the plant and its parameters (SI, by row name), with the seed of the trajectory.  prior: the initial
    uncertainty.  samples: inertial samples.  in_place: whether the vehicle stays where it is.  progress: called with the
    numbers of samples done and in all.
    """
    interval = float(rows["sample_interval"])
    layout = layout_of(rows, interval, in_place)
    steps = blocks_of(model, rows, interval, samples, layout)
    times, sigmas = [], []
    for time, sigma in recursion(steps, layout, prior):
        times.append(time)
        sigmas.append(sigma)
        if progress is not None:
            progress(round(float(time[-1]) / interval), samples)
    return limit_of(np.concatenate(times), np.concatenate(sigmas))


def layout_of(rows: Mapping[str, Any], interval: float, in_place: bool) -> Layout:
    """The states of the optimal filter of a plant and what it measures; the arguments are those of `bound`."""
    fixes = fixes_of(rows, interval)
    mooring = mooring_of(rows) if in_place else None
    return Layout(unit_of(rows), () if fixes is None else receiver_of(rows), fixes, mooring, aids_of(rows, interval))


def blocks_of(model: Model, rows: Mapping[str, Any], interval: float, samples: int, layout: Layout) -> Iterable[Steps]:
    """The trajectory in blocks of steps."""
    ends = step_ends(samples, interval, layout.fixes)
    return steps_along(model, model.parameters.pack(rows), interval, ends, layout.unit.C_bs)


def limit_of(time: Array, sigma: Array) -> Limit:
    """`Limit` from the standard deviations (n, 12) of a `recursion`."""
    scaled = sigma[:, :9] * np.repeat([180.0 / np.pi, 1.0, 1.0], 3)
    columns = dict(zip(_ORDER, scaled.T, strict=True))
    return Limit(time, sigma[:, 9:], {name: np.ascontiguousarray(columns[name]) for name in CHANNELS})
