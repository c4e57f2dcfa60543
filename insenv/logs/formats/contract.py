"""`Format`: how files of one format are recognised, read and written; `FileColumns`: what the sections of a description read;
`NamedTrack` and `Drive`: what is written.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError
from insenv.base.remarks import Remark
from insenv.core.tables import Array
from insenv.logs.formats.series import Flight
from insenv.logs.recorded import RecordedLog

Columns = dict[str, Array]
"""Columns (n,) by name."""
Files = Mapping[str, "str | bytes"]
"""Contents by name; a name may have one folder in it."""

EPOCH = datetime(2026, 1, 1, tzinfo=timezone.utc)
"""Date of time 0, for formats that hold dates: a run and a log count seconds from a start without one."""


def date_of(time: float) -> datetime:
    """The date of a time (s) of the run, to the microsecond."""
    return EPOCH + timedelta(seconds=time)


@dataclass(frozen=True)
class NamedTrack:
    """A track of a file: its name, time (n,) s, and what is known; the rest is None.

    q_nb (n, 4); velocity_n (n, 3) m/s; latitude, longitude (n,) rad; height (n,) m above the ellipsoid, NaN where a file has
    none.  Standard deviations (n, 3): attitude_sigma_deg of roll, pitch, heading; position_sigma (m) and velocity_sigma (m/s),
    north, east, down.
    """

    name: str
    time: Array
    q_nb: Array | None = None
    velocity_n: Array | None = None
    latitude: Array | None = None
    longitude: Array | None = None
    height: Array | None = None
    attitude_sigma_deg: Array | None = None
    position_sigma: Array | None = None
    velocity_sigma: Array | None = None

    @property
    def place(self) -> tuple[Array, Array, Array] | None:
        """Latitude, longitude (rad) and height (m); None for a track without positions."""
        if self.latitude is None or self.longitude is None or self.height is None or not len(self.time):
            return None
        return self.latitude, self.longitude, self.height


def track_of_points(name: str, points: Iterable[tuple[float, float, float, float]]) -> NamedTrack:
    """A track of points: time s, latitude deg, longitude deg, height m or NaN."""
    time, latitude, longitude, height = np.array(list(points), dtype=np.float64).reshape(-1, 4).T
    return NamedTrack(name, time, latitude=np.radians(latitude), longitude=np.radians(longitude), height=height)


@dataclass(frozen=True)
class Drive:
    """What is written of a drive.

    name: first part of the file names; title, description: of the run; tracks: the truth or the reference, then each estimate;
    results: all series of each estimator as columns, by its id; log: of the sensors.
    """

    name: str
    log: RecordedLog | None = None
    title: str = ""
    description: str = ""
    tracks: tuple[NamedTrack, ...] = ()
    results: Mapping[str, Columns] = field(default_factory=dict)

    def sensors(self) -> RecordedLog:
        """The log, for a format that needs one."""
        assert self.log is not None
        return self.log

    def placed(self, format: str) -> list[tuple[NamedTrack, tuple[Array, Array, Array]]]:
        """The tracks with positions, and these.  Raises `InputError` if there are none."""
        placed = [(track, track.place) for track in self.tracks]
        rows = [(track, place) for track, place in placed if place is not None]
        if not rows:
            raise InputError(f"format {format!r}: neither truth nor estimate has positions")
        return rows

    def tracks_or_reference(self) -> tuple[NamedTrack, ...]:
        """The tracks; if there are none, the reference of the log."""
        if self.tracks or self.log is None or self.log.reference is None:
            return self.tracks
        reference = self.log.reference
        angles = (reference.roll, reference.pitch, reference.heading)
        q_nb = None if any(angle is None for angle in angles) else attitude.numeric.from_euler(*angles)
        place = (reference.latitude, reference.longitude, reference.height)
        return (NamedTrack("truth", reference.time, q_nb, reference.velocity_n, *place),)


@dataclass(frozen=True)
class FileColumns:
    """The columns of a file, by name or number: (n,) each, of one length if they belong together; NaN where a value is missing.

    lines: numbers of the lines of a text file that the rows stand on, for messages; None: the rows are numbered from 1.
    notes: remarks for the user.
    """

    columns: Mapping[Any, Array]
    lines: np.ndarray | None = None
    notes: tuple[Remark, ...] = ()


SectionKeys = Mapping[str, Any]
"""Values by key of a section of a description, as in its TOML file."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of files.  Its functions raise `InputError`.

    name: in `insenv.write`, of the option that writes it, and the value of the key `format` of a description; suffixes: ends of
    the names of files that are read, * for any text.
    read_columns: what a section of a description may name as columns, from the file's name for messages, its bytes, and the
    name of the section; None: those of a text table.  keys: that the format fixes, by section; empty: any section reads it, and
    names its columns itself.  further_keys: groups of keys, by section, each fixed if the file has their columns.
    read_flight: the series of a flight log, from its name for messages and its bytes; kind: what messages call such a log;
    hint: how to get inertial samples at a usable rate.  read_tracks: the tracks with points, likewise; several: whether a file
    may have more than one.
    write: the files of a drive; needs_report, needs_log: what it must have; module, package, extra: what is imported to write
    it, its package, if that has another name, and the extra of insenv that installs it; empty: none.
    """

    name: str
    suffixes: tuple[str, ...] = ()
    read_columns: Callable[[str, bytes, str], FileColumns] | None = None
    keys: Mapping[str, SectionKeys] = field(default_factory=dict)
    further_keys: Mapping[str, tuple[SectionKeys, ...]] = field(default_factory=dict)
    read_flight: Callable[[str, bytes], Flight] | None = None
    kind: str = ""
    hint: str = ""
    read_tracks: Callable[[str, bytes], list[NamedTrack]] | None = None
    several: bool = False
    write: Callable[[Drive], Files] | None = None
    needs_report: bool = False
    needs_log: bool = False
    module: str = ""
    package: str = ""
    extra: str = ""

    @property
    def reads_sections(self) -> bool:
        """Whether the files of a description may be of this format."""
        return self.read_columns is not None or bool(self.keys)

    def named_like(self, name: str) -> bool:
        """Whether a file's name ends like those of this format; .gz and .zip do not count."""
        name = name.lower()
        name = name.rpartition(".")[0] if name.endswith((".gz", ".zip")) else name
        return any(fnmatchcase(name, f"*{suffix.lower()}") for suffix in self.suffixes)
