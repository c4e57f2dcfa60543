"""What a reader finds in a flight log, each series with its name in that log: inertial units, receivers, solutions.

Times are in seconds on one clock of the log.  Everything else is in SI, radians, body FRD, NED.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from insenv.logs.units import Array

INFORMS_NOT = 100.0
"""Standard deviation (m/s) of a velocity component that a log does not hold."""


@dataclass(frozen=True)
class ImuSeries:
    """Samples of one unit: time (n,) s, rate_ib_b (n, 3) rad/s, specific_force_b (n, 3) m/s^2.

    stamp: whether the time is the end of the interval over which the sample is the mean, or the instant of the sample.
    """

    name: str
    time: Array
    rate_ib_b: Array
    specific_force_b: Array
    stamp: Literal["interval_end", "instant"]

    @property
    def rate_hz(self) -> float:
        """Median rate (Hz); 0 for fewer than two samples."""
        steps = np.diff(self.time)
        steps = steps[steps > 0.0]
        return float(1.0 / np.median(steps)) if steps.size else 0.0


@dataclass(frozen=True)
class FixSeries:
    """Fixes of one receiver: time (m,) s of validity as far as the log tells, latitude, longitude (m,) rad, height (m,) m.

    height_sea: over mean sea level, and undulation (m): of the geoid over the ellipsoid there, None where not told.
    position_sigma (m, 3) m, velocity_n (m, 3) m/s, velocity_sigma (m, 3) m/s: None where the log has none; a component that
    it has not has a standard deviation of `INFORMS_NOT`.
    """

    name: str
    time: Array
    latitude: Array
    longitude: Array
    height: Array
    height_sea: bool = False
    undulation: float | None = None
    position_sigma: Array | None = None
    velocity_n: Array | None = None
    velocity_sigma: Array | None = None


@dataclass(frozen=True)
class SolutionSeries:
    """A solution to compare with: fields of `insenv.logs.Reference`.  true: a simulator's truth, not an estimate."""

    name: str
    time: Array
    latitude: Array
    longitude: Array
    height: Array
    velocity_n: Array | None
    roll: Array
    pitch: Array
    heading: Array
    true: bool = False
    height_sea: bool = False


@dataclass(frozen=True)
class Flight:
    """A log: kind, what was read (in the order of preference), what a user should know, rows (messages) and their digest."""

    kind: str
    imus: tuple[ImuSeries, ...]
    fixes: tuple[FixSeries, ...]
    solutions: tuple[SolutionSeries, ...]
    notes: tuple[str, ...] = ()
    rows: int = 0
    sha256: str = ""
    others: tuple[str, ...] = field(default=())
    """Series that are in the log and cannot be used, each with the reason."""
