"""What the writers of results take from a report: truth and estimates as tracks, and all series as columns."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY, Result, Track, stated_sigma, track_of
from insenv.export.log_tables import tables
from insenv.logs import RecordedLog
from insenv.report.notebook import data_frame
from insenv.report.run_data import RunData

if TYPE_CHECKING:
    from pandas import DataFrame


Array = NDArray[np.float64]

EPOCH = datetime(2026, 1, 1, tzinfo=timezone.utc)
"""Date of time 0, for formats that hold dates: a run and a log count seconds from a start without one."""
TRUTH = "truth"


@dataclass(frozen=True)
class NamedTrack:
    """A track, its name, and its standard deviations (n,) by channel, empty if none are stated."""

    name: str
    track: Track
    sigma: dict[str, Array] = field(default_factory=dict)

    @property
    def placed(self) -> bool:
        """Whether it has positions."""
        return self.track.latitude is not None


def tracks_of(report: RunData) -> list[NamedTrack]:
    """The truth, or the reference, where it is known, then each estimate."""
    found = [NamedTrack(TRUTH if report.seed is not None else "reference", _known(report.truth))]
    for result in report.results:
        found.append(NamedTrack(result.estimator, track_of(result.time, result.outputs), stated_sigma(result.outputs)))
    return [each for each in found if len(each.track.time) and (each.track.q_nb is not None or each.placed)]


def _known(track: Track) -> Track:
    series = {name: value for name in _SERIES if (value := getattr(track, name)) is not None}
    if not series:
        return Track(track.time[:0])
    known = np.all([np.isfinite(value.reshape(len(value), -1)).all(axis=1) for value in series.values()], axis=0)
    return Track(track.time[known], **{name: value[known] for name, value in series.items()})


_SERIES = ("q_nb", "velocity_n", "latitude", "longitude", "height")


def date_of(time: float) -> datetime:
    """The date of a time (s) of the run, to the microsecond."""
    return EPOCH + timedelta(seconds=time)


def columns_of(report: RunData, result: Result) -> dict[str, Array]:
    """All series of one estimator as columns (n,) by name: time_s, truth, estimate, errors, standard deviations, limit.

    Angles in degrees, positions in degrees and metres, velocities in m/s.
    """
    times = result.time
    columns: dict[str, Array] = {"time_s": times}
    truth = Track(times, **report.truth.at(times))
    for prefix, track in (("truth", truth), ("estimate", track_of(times, result.outputs))):
        if track.q_nb is not None:
            columns |= {f"{prefix}_{name}": values for name, values in zip(ATTITUDE, track.euler_deg().T, strict=True)}
        if track.latitude is not None and track.longitude is not None and track.height is not None:
            columns[f"{prefix}_latitude_deg"] = np.degrees(track.latitude)
            columns[f"{prefix}_longitude_deg"] = np.degrees(track.longitude)
            columns[f"{prefix}_height_m"] = track.height
        if track.velocity_n is not None:
            columns |= {f"{prefix}_{name}": values for name, values in zip(VELOCITY, track.velocity_n.T, strict=True)}
    for prefix, series in (("error", result.errors), ("sigma", result.sigma), ("limit", result.limit_sigma)):
        columns |= {f"{prefix}_{name}": values for name, values in series.items()}
    return columns


def horizontal_sigma(named: NamedTrack) -> Array | None:
    """Standard deviation of the horizontal position, root mean square of north and east (n,) m; None if it is not stated."""
    if not all(name in named.sigma for name in POSITION[:2]):
        return None
    return np.asarray(np.hypot(*(named.sigma[name] for name in POSITION[:2])) / np.sqrt(2.0))


# Degrees from which a reader gets an angle back.


def degrees_of(angle: float) -> float:
    """The degrees (float) whose conversion to radians is `angle` (rad), to the bit where such degrees exist.

    Degrees are coarser than radians for about half of the angles: one in ten of these has no such degrees, and the result is
    then the nearest, one unit in the last place away.
    """
    found = math.degrees(angle)
    candidates = [found]
    for towards in (-math.inf, math.inf):
        near = found
        for _ in range(3):
            near = math.nextafter(near, towards)
            candidates.append(near)
    return min(candidates, key=lambda degrees: (abs(math.radians(degrees) - angle), abs(degrees - found)))


# The tables of a recorded log as pandas DataFrames.


def to_dataframes(log: RecordedLog) -> dict[str, DataFrame]:
    """The tables of a log by section (imu, gnss, the instruments, reference), indexed by time (s).

    The columns are those of the CSV files that `insenv.write` makes of a log.  Raises `InsenvError` if pandas is missing.
    """
    found = {}
    for name, columns in tables(log).items():
        time = columns.pop("time_s")
        found[name] = data_frame(time, columns)
    return found
