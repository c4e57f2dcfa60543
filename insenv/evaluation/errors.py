"""Errors of estimates against the truth (or a reference), and their statistics.

`CHANNELS` are the names of the errors.  Angles are in degrees, wrapped to -180 to 180; positions in metres north,
east and down of the truth; velocities in m/s.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude, geodesy
from insenv.evaluation import sentences
from insenv.evaluation.health import Health
from insenv.evaluation.unit_errors import UnitError

Array = NDArray[np.float64]

ATTITUDE = ("roll_deg", "pitch_deg", "heading_deg")
POSITION = ("north_m", "east_m", "down_m")
VELOCITY = ("vn_mps", "ve_mps", "vd_mps")
CHANNELS = ATTITUDE + POSITION + VELOCITY
STEEP = 80.0
"""Pitch (deg) from which roll and heading do not show an error of the attitude."""
TOO_SURE = 3.0
"""Ratio of an rms error to its stated standard deviation beyond which a run says so."""


def statistics_from(navigates: bool, end_s: float) -> float:
    """Start of the statistics of a run that ends at `end_s`, s: of a navigation 0, of an alignment its last quarter."""
    return 0.0 if navigates else 0.75 * end_s


@dataclass(frozen=True)
class Track:
    """A motion at sampled times.

    time (n,) s; q_nb (n, 4); velocity_n (n, 3) m/s; latitude, longitude (n,) rad, height (n,) m: None where not known.
    """

    time: Array
    q_nb: Array | None = None
    velocity_n: Array | None = None
    latitude: Array | None = None
    longitude: Array | None = None
    height: Array | None = None

    def since(self, first: int) -> Track:
        """The track from row `first` on."""
        series = {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(self, **{name: values[first:] for name, values in series.items() if values is not None})

    def at(self, times: Array) -> dict[str, Array]:
        """The rows that are known at times (m,) s of the track, by name."""
        rows = np.searchsorted(self.time, times - 1e-9).clip(0, max(len(self.time) - 1, 0))
        series = {each.name: getattr(self, each.name) for each in fields(self) if each.name != "time"}
        return {name: values[rows] for name, values in series.items() if values is not None}

    def euler_deg(self) -> Array:
        """Roll, pitch, heading (n, 3), degrees."""
        if self.q_nb is None:
            raise ValueError("this track has no attitude")
        return np.degrees(np.stack(attitude.numeric.to_euler(self.q_nb), axis=-1))


@dataclass(frozen=True, repr=False)
class Result:
    """The result of one estimator in one run.

    time (n,) s: of the records.  outputs: the estimator's outputs at these times, by row name.
    errors: (n,) by channel.  sigma: standard deviations that the estimator states, (n,) by channel; empty if it
        states none.
    limit: by channel, the smallest standard deviation that any method can have (`insenv.evaluation.limits`), as root mean
        square over the records from `from_s` on; empty if there is none.
    from_s: start of the statistics.
    us_per_sample: processor time of the estimator per inertial sample, microseconds.
    settled: False for a run shorter than the estimator needs: its errors are then not compared with a limit.
    health: how well a filter fits its fixes; None if it does not report it, or if no fix came.
    limit_sigma: the limit at the recorded times, (n,) by channel; empty if there is none.
    unit: on a turntable, the errors of the inertial unit that the estimator found.
    """

    estimator: str
    time: Array
    outputs: dict[str, Array]
    errors: dict[str, Array]
    sigma: dict[str, Array]
    limit: dict[str, float]
    from_s: float
    us_per_sample: float
    notes: tuple[str, ...] = ()
    health: Health | None = None
    settled: bool = True
    limit_sigma: dict[str, Array] = field(default_factory=dict)
    unit: tuple[UnitError, ...] = ()

    def statistics(self) -> dict[str, dict[str, float]]:
        """Final error, rms and max (largest magnitude) by channel; rms and max over the times from `from_s` on."""
        late = self._late
        return {
            "final": {name: float(e[-1]) for name, e in self.errors.items()},
            "rms": rms(self.errors, late),
            "max": {name: float(np.max(np.abs(e[late]))) for name, e in self.errors.items()},
        }

    def stated(self) -> dict[str, float]:
        """Root mean square of the standard deviations that the estimator states, by channel, over the same times as `rms`."""
        return rms({name: self.sigma[name] for name in self.errors if name in self.sigma}, self._late)

    def judged(self) -> Result:
        """The result with the notes that follow from its errors, and without a limit of `unjudged` ones."""
        limit = {name: value for name, value in self.limit.items() if name not in self.unjudged}
        return replace(self, limit=limit, notes=(*self.notes, *self.steep(), *self.too_sure()))

    @property
    def unjudged(self) -> tuple[str, ...]:
        """Errors that are none of the attitude: roll and heading, where the pitch comes near 90 deg."""
        return ("roll_deg", "heading_deg") if self.steep() else ()

    def steep(self) -> tuple[str, ...]:
        """A sentence if the pitch comes near 90 deg, where a small turn changes roll and heading by any angle."""
        if "pitch_deg" not in self.errors or "q_nb" not in self.outputs:
            return ()
        true_deg = np.degrees(attitude.numeric.to_euler(self.outputs["q_nb"])[1]) - self.errors["pitch_deg"]
        pitch = np.abs(true_deg[self._late])
        if not np.any(pitch > STEEP):
            return ()
        return (sentences.STEEP.format(pitch=f"{pitch.max():.3g}"),)

    def too_sure(self) -> tuple[str, ...]:
        """A sentence if an rms error is more than `TOO_SURE` times its stated sigma; none for a run that is too short."""
        if not self.settled:
            return ()
        found, stated = self.statistics()["rms"], self.stated()
        judged = {name: own for name, own in stated.items() if name not in self.unjudged}
        worst = {name: found[name] / own for name, own in judged.items() if 0.0 < own * TOO_SURE < found[name]}
        if not worst:
            return ()
        listed = ", ".join(f"{name.rpartition('_')[0]} {ratio:.3g}" for name, ratio in worst.items())
        return (sentences.TOO_SURE.format(ratios=listed),)

    @property
    def _late(self) -> Any:
        return self.time >= self.from_s - 1e-9

    def __repr__(self) -> str:
        final = []
        if "heading_deg" in self.errors:
            final.append(f"heading {self.errors['heading_deg'][-1]:.3g} deg")
        if position := [self.errors[name][-1] for name in POSITION if name in self.errors]:
            final.append(f"position {np.linalg.norm(position):.3g} m")
        return f"{self.estimator}: final error {', '.join(final)}" if final else f"{self.estimator}: no reference"


def rms(channels: Mapping[str, Array], where: Any = ...) -> dict[str, float]:
    """Root mean square of each channel over the times `where` (an index)."""
    return {name: float(np.sqrt(np.mean(values[where] ** 2))) for name, values in channels.items()}


def track_of(times: Array, rows: dict[str, Array]) -> Track:
    """The track of outputs by row name; rows that are missing are None."""
    return Track(times, **{name: rows.get(name) for name in ("q_nb", "velocity_n", "latitude", "longitude", "height")})


def errors(estimate: Track, truth: Track) -> dict[str, Array]:
    """Errors (estimate minus truth) by channel, for the quantities of both tracks, which have the same times."""
    found: dict[str, Array] = {}
    if estimate.q_nb is not None and truth.q_nb is not None:
        found.update(zip(ATTITUDE, wrapped_deg(estimate.euler_deg() - truth.euler_deg()).T, strict=True))
    if estimate.latitude is not None and truth.latitude is not None:
        places = [(t.latitude, t.longitude, t.height) for t in (estimate, truth)]
        found.update(zip(POSITION, geodesy.numeric.position_error(*places[0], *places[1]).T, strict=True))
    if estimate.velocity_n is not None and truth.velocity_n is not None:
        found.update(zip(VELOCITY, (estimate.velocity_n - truth.velocity_n).T, strict=True))
    return found


def stated_sigma(outputs: dict[str, Array]) -> dict[str, Array]:
    """Standard deviations by channel, from an estimator's outputs `attitude_sigma` (rad about n), `position_sigma` and
    `velocity_sigma`.

    The heading converts misalignments about north and east to roll and pitch; this does not hold near 90 deg of
    pitch.
    """
    found: dict[str, Array] = {}
    if "attitude_sigma" in outputs:
        heading = attitude.numeric.to_euler(outputs["q_nb"])[2]
        north, east, down = np.degrees(outputs["attitude_sigma"]).T
        c, s = np.cos(heading) ** 2, np.sin(heading) ** 2
        found.update(
            zip(ATTITUDE, (np.sqrt(north**2 * c + east**2 * s), np.sqrt(north**2 * s + east**2 * c), down), strict=True)
        )
    for names, row in ((POSITION, "position_sigma"), (VELOCITY, "velocity_sigma")):
        if row in outputs:
            found.update(zip(names, outputs[row].T, strict=True))
    return found


def wrapped_deg(angle_deg: Array) -> Array:
    """Angles in degrees wrapped to -180 (included) to 180."""
    return (angle_deg + 180.0) % 360.0 - 180.0
