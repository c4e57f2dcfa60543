"""The score of estimates that clients send: each against the truth at its own time, and against the limit.

An estimate is judged at its time stamp, so that neither the link nor the client's computing time counts as error; how late it
arrived is counted apart.

Estimates are ODOMETRY, ATTITUDE, ATTITUDE_QUATERNION and VISION_POSITION_ESTIMATE.  Frames: attitude from body FRD to NED at
the vehicle; positions from home (HOME_POSITION) along the NED axes at home; the velocity of ODOMETRY in body FRD (child frame
12) or NED (child frame 1).  Times are those of the simulation clock, which the vehicle's messages carry (``time_usec``,
``time_boot_ms``), or the same in Unix time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite, sqrt
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.base.remarks import declared
from insenv.core.tables import Array, Vector
from insenv.evaluation.errors import (
    ATTITUDE,
    CHANNELS,
    POSITION,
    VELOCITY,
    Result,
    Track,
    checked_estimate,
    errors,
    track_of,
)
from insenv.evaluation.limits import Limit
from insenv.mavlink.messages import Message, View
from insenv.mavlink.messages.fields import DEG_E7
from insenv.mavlink.simulation import PLACE, POSE
from insenv.report import Report
from insenv.runs.follower import Called
from insenv.runs.simulated import result_of

LOCAL_NED, BODY_FRD = 1, 12
"""MAV_FRAME."""
UNIX_US = 10**15
"""Time stamps beyond this many microseconds are Unix time."""
MAX_DISTANCE_M = 1e5
"""Largest distance from home, m, within which the axes at home make sense."""
_POSE_SIGMA = {0: POSITION[0], 6: POSITION[1], 11: POSITION[2], 15: ATTITUDE[0], 18: ATTITUDE[1], 20: ATTITUDE[2]}
"""Channels on the diagonal of a pose covariance, whose upper triangle stands row by row."""
_LONGITUDE = 8  # its element in a row of `POSE`


@dataclass(frozen=True)
class Estimate:
    """One estimate: its time (s, simulation clock), rows as of `checked_estimate`, and stated sigma by channel.

    resolution: of the time stamp, s.
    """

    time: float
    rows: dict[str, Array]
    sigma: dict[str, float] = field(default_factory=dict)
    resolution: float = 1e-6


@dataclass(frozen=True)
class Origin:
    """Home: latitude, longitude (rad), height (m), as HOME_POSITION states it; start_unix: Unix time (s) at the start."""

    latitude: float
    longitude: float
    height: float
    start_unix: float


def estimate_of(message: Any, origin: Origin) -> Estimate:
    """The estimate in a message.  Raises `InputError`, one sentence, for nonsense: not finite, no rotation, another frame."""
    return READERS[message.get_type()](message, origin)


def _attitude(message: Any, origin: Origin) -> Estimate:
    return Estimate(message.time_boot_ms * 1e-3, checked_estimate(_by_euler(message)), resolution=1e-3)


def _attitude_quaternion(message: Any, origin: Origin) -> Estimate:
    offset = tuple(getattr(message, "repr_offset_q", (0.0,) * 4))
    if any(offset) and offset != (1.0, 0.0, 0.0, 0.0):
        raise InputError(f"repr_offset_q = {list(offset)}: allowed is none: the attitude is that of the body")
    q = [message.q1, message.q2, message.q3, message.q4]
    return Estimate(message.time_boot_ms * 1e-3, checked_estimate(q), resolution=1e-3)


def _vision_position_estimate(message: Any, origin: Origin) -> Estimate:
    rows = checked_estimate({"q_nb": _by_euler(message), **_place(message, origin)})
    return Estimate(_seconds(message.usec, origin), rows, _pose_sigma(message.covariance))


def _odometry(message: Any, origin: Origin) -> Estimate:
    if message.frame_id != LOCAL_NED:
        raise InputError(f"frame_id = {message.frame_id}: allowed is {LOCAL_NED} (MAV_FRAME_LOCAL_NED)")
    if message.child_frame_id not in (LOCAL_NED, BODY_FRD):
        raise InputError(
            f"child_frame_id = {message.child_frame_id}: allowed is {BODY_FRD} (MAV_FRAME_BODY_FRD) or {LOCAL_NED}"
            " (MAV_FRAME_LOCAL_NED)"
        )
    velocity = (message.vx, message.vy, message.vz)
    rows = checked_estimate({"q_nb": message.q, "velocity_n": velocity, **_place(message, origin)})
    sigma = _pose_sigma(message.pose_covariance)
    if message.child_frame_id == BODY_FRD:
        rows["velocity_n"] = np.asarray(attitude.numeric.rotate(rows["q_nb"], rows["velocity_n"]))
    covariance = np.array(message.velocity_covariance)[[0, 1, 2, 6, 7, 11]]
    if np.isfinite(covariance).all() and min(covariance[[0, 3, 5]]) > 0.0:
        P = np.zeros((3, 3))
        P[np.triu_indices(3)] = covariance
        P = P + np.triu(P, 1).T
        if message.child_frame_id == BODY_FRD:
            C_nb = attitude.numeric.to_dcm(rows["q_nb"])
            P = C_nb @ P @ C_nb.T
        sigma |= dict(zip(VELOCITY, np.sqrt(np.maximum(np.diag(P), 0.0)).tolist(), strict=True))
    return Estimate(_seconds(message.time_usec, origin), rows, sigma)


READERS: dict[str, Callable[[Any, Origin], Estimate]] = {
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "VISION_POSITION_ESTIMATE": _vision_position_estimate,
    "ODOMETRY": _odometry,
}
"""By name of the message."""


def _seconds(stamp_us: int, origin: Origin) -> float:
    return (stamp_us - round(origin.start_unix * 1e6) if stamp_us > UNIX_US else stamp_us) * 1e-6


def _by_euler(message: Any) -> Array:
    angles = [getattr(message, name) for name in ("roll", "pitch", "yaw")]
    for name, angle in zip(("roll", "pitch", "yaw"), angles, strict=True):
        if not isfinite(angle) or abs(angle) > 7.0:
            raise InputError(f"{name} = {angle:g} rad: allowed is a finite angle up to a full turn")
    return np.asarray(attitude.numeric.from_euler(*angles))


def _place(message: Any, origin: Origin) -> dict[str, float]:
    """Latitude, longitude, height of a position from home along the NED axes at home."""
    offset = (message.x, message.y, message.z)
    if not all(map(isfinite, offset)) or max(map(abs, offset)) > MAX_DISTANCE_M:
        raise InputError(
            f"x, y, z = {[round(v, 3) for v in offset]} m: allowed are finite distances from home up to {MAX_DISTANCE_M:g} m"
        )
    home = (origin.latitude, origin.longitude, origin.height)
    place = geodesy.numeric.geodetic_from_ned_offset(np.array(offset), *home)
    return dict(zip(PLACE, map(float, place), strict=True))


def _pose_sigma(triangle: Sequence[float]) -> dict[str, float]:
    """Standard deviations by channel (m, deg) of a pose covariance; none where it is unknown: NaN, or not positive."""
    return {
        channel: sqrt(triangle[place]) * (180.0 / np.pi if channel in ATTITUDE else 1.0)
        for place, channel in _POSE_SIGMA.items()
        if isfinite(triangle[place]) and triangle[place] > 0.0
    }


HISTORY_S = 600.0
"""Time for which the truth is kept: older estimates are refused."""
MAX_ESTIMATES = 200_000
"""Estimates kept of one source; beyond it every second one is dropped, and so on."""
ANSWER_S = 1.0
"""Simulated time between two answers to one source."""
NAMES = {channel: channel.rpartition("_")[0].upper() for channel in CHANNELS}
"""Names of NAMED_VALUE_FLOAT by channel, behind E_ (error, estimate minus truth) and L_ (limit, 1 sigma)."""


@dataclass
class Source:
    """The estimates of one client by one kind of message.

    name: "odometry-42-191", message, system and component.  recorded: (estimate, truth) of those that are kept, every
    `stride`-th; count: of all accepted; delays: simulated seconds from stamp to arrival; latest: its latest error by channel.
    time: of the latest estimate (s); answered: that of the latest with an answer.
    """

    name: str
    recorded: list[tuple[Estimate, dict[str, Vector]]] = field(default_factory=list)
    stride: int = 1
    count: int = 0
    delays: list[float] = field(default_factory=list)
    latest: dict[str, float] = field(default_factory=dict)
    time: float = float("-inf")
    answered: float = float("-inf")

    def take(self, estimate: Estimate, truth: dict[str, Vector], delay: float) -> None:
        """Record an estimate and the truth at its time."""
        if self.count % self.stride == 0:
            self.recorded.append((estimate, truth))
            self.delays.append(delay)
        self.count, self.time = self.count + 1, estimate.time
        if len(self.recorded) >= MAX_ESTIMATES:
            self.recorded, self.delays, self.stride = self.recorded[::2], self.delays[::2], 2 * self.stride
        times = np.array([estimate.time])
        error = errors(track_of(times, _stacked([estimate.rows])), track_of(times, _stacked([truth])))
        self.latest = {name: float(value[0]) for name, value in error.items()}

    def tracks(self) -> tuple[dict[str, Vector], Track]:
        """What it has sent, by row name, and the truth at the same times."""
        times = np.array([estimate.time for estimate, _ in self.recorded])
        truth = track_of(times, _stacked([truth for _, truth in self.recorded]))
        return _stacked([estimate.rows for estimate, _ in self.recorded]), truth

    def stated(self) -> dict[str, Vector]:
        """Standard deviations by channel that it has stated with every estimate."""
        sigmas = [estimate.sigma for estimate, _ in self.recorded]
        return {name: np.array([sigma[name] for sigma in sigmas]) for name in NAMES if all(name in sigma for sigma in sigmas)}


def _stacked(rows: list[dict[str, Any]]) -> dict[str, Vector]:
    """The rows of several times by name, with those that the first time has."""
    return {name: np.array([each[name] for each in rows]) for name in rows[0]}


class Score:
    """Errors of the estimates that clients send.

    view: the vehicle.  limit: the smallest standard deviation that any method can have, or None.  sources: by name.  refused:
    number of messages that were refused, by the sentence that says why (the first of its kind).  disturbed_at: time (s) at
    which what clients did to the vehicle made the limit another one; None before.
    """

    def __init__(self, view: View, limit: Limit | None = None) -> None:
        self.view, self.limit = view, limit
        self.sources: dict[str, Source] = {}
        self.refused: Counter[str] = Counter()
        self.disturbed_at: float | None = None
        self._sentences: dict[tuple[str, str], str] = {}
        latitude, longitude, height = view.home
        # as HOME_POSITION rounds it, by which clients count
        place = (round(latitude * DEG_E7) / DEG_E7, round(longitude * DEG_E7) / DEG_E7)
        self.origin = Origin(*place, round((height - view.undulation) * 1e3) * 1e-3 + view.undulation, view.start_unix)
        self._history = np.full((int(HISTORY_S / view.simulation.interval) + 1, 10), np.nan)
        self._first = 0

    def follow(self) -> None:
        """Keep the truth of the present sample, and notice what makes the limit another one."""
        simulation = self.view.simulation
        self._history[simulation.samples % len(self._history)] = np.hstack([self.view.truth[name] for name in POSE])
        self._first = self._first or simulation.samples
        if self.disturbed_at is None and (not simulation.gnss_on or simulation.interference is not None or simulation.changed):
            self.disturbed_at = simulation.time

    def take(self, message: Message) -> list[Message]:
        """Score the estimate in a message; return what is sent back: NAMED_VALUE_FLOAT once a second."""
        kind = message.get_type()
        name = f"{kind.lower().replace('_', '-')}-{message.get_srcSystem()}-{message.get_srcComponent()}"
        source = self.sources.get(name) or Source(name)
        try:
            estimate = estimate_of(message, self.origin)
            truth = self._truth_at(estimate, source)
        except InputError as error:
            self._refuse(kind, str(error))
            return []
        self.sources[name] = source
        source.take(estimate, truth, self.view.simulation.time - estimate.time)
        if estimate.time - source.answered < ANSWER_S - 1e-9:
            return []
        source.answered = estimate.time
        limit = self.limit_at(source.time)
        values = {f"E_{NAMES[name]}": error for name, error in source.latest.items()}
        values |= {f"L_{NAMES[name]}": limit[name] for name in source.latest if name in limit}
        return self.view.fields.named(round(source.time * 1e3), values)

    def limit_at(self, time: float) -> dict[str, float]:
        """The limit by channel at a time (s); empty where there is none: beyond its run, or after the scenario was changed."""
        changed = self.disturbed_at is not None and time > self.disturbed_at
        if self.limit is None or changed or time > float(self.limit.time[-1]):
            return {}
        return {name: float(value[0]) for name, value in self.limit.at(np.array([time])).items()}

    def _refuse(self, kind: str, sentence: str) -> None:
        """Count a refusal under the first sentence of its kind: numbers in it would make one of each message."""
        first = self._sentences.setdefault((kind, "".join(c for c in sentence if not c.isdigit())[:40]), f"{kind}: {sentence}")
        self.refused[first] += 1

    def _truth_at(self, estimate: Estimate, source: Source) -> dict[str, Vector]:
        """The truth at an estimate's time.  Raises `InputError` for a time without truth, or one that does not increase."""
        simulation, time = self.view.simulation, estimate.time
        dt, now = simulation.interval, simulation.time
        oldest = max(now - (len(self._history) - 1) * dt, self._first * dt)
        if not oldest - 0.5 * estimate.resolution <= time <= now + 0.5 * estimate.resolution:
            when = "later than the simulation clock" if time > now else "older than the truth that is kept"
            raise InputError(
                f"the stamp is {when} ({time:.3f} s, clock {now:.3f} s): allowed are times of the vehicle's messages"
            )
        if time <= source.time:
            raise InputError(f"the stamp {time:.6f} s does not follow {source.time:.6f} s: allowed are increasing times")
        nearest = round(time / dt)
        if abs(nearest * dt - time) <= 0.5 * estimate.resolution + 1e-9:  # the stamp of a sample, rounded
            row = self._history[nearest % len(self._history)].copy()
        else:
            low = int(time / dt)
            before, after = (self._history[place % len(self._history)] for place in (low, low + 1))
            row = _between(before, after, (time - low * dt) / dt)
        values = (row[:4], row[4:7], *(np.array(value) for value in row[7:]))
        return dict(zip(POSE, values, strict=True))


def _between(before: Vector, after: Vector, share: float) -> Vector:
    """A row of the history between two samples: linear, with the longitude across the date line and a rotated attitude."""
    row = before + share * (after - before)
    turn = attitude.numeric.to_rotation_vector(attitude.numeric.multiply(attitude.numeric.conjugate(before[:4]), after[:4]))
    row[:4] = attitude.numeric.multiply(before[:4], attitude.numeric.from_rotation_vector(share * turn))
    east = (after[_LONGITUDE] - before[_LONGITUDE] + np.pi) % (2.0 * np.pi) - np.pi
    row[_LONGITUDE] = before[_LONGITUDE] + share * east
    return np.asarray(row)


_NO_ESTIMATE = declared("no-estimate", "no estimate was received")
_REFUSED = declared("estimates-refused", "refused {count} times: {sentence}")
_CHANGED = declared(
    "no-limit-changed", "no limit: a command changed the scenario at {time:g} s, and its limit does not hold after that"
)
_LONGER = declared("no-limit-longer", "no limit: the estimates last longer than the scenario, {time:g} s")
_RECEIVED = declared(
    "estimates-received",
    "{count} estimates by MAVLink; they arrived {median:.3g} ms after their time stamp in the median, at most {largest:.3g} ms",
)
_THINNED = declared("estimates-thinned", "one in {stride} of them is recorded")


def report_of(score: Score) -> Report:
    """The report of all sources that have sent estimates, as of a run; its truth is that at the times of their estimates."""
    simulation, sources = score.view.simulation, score.sources.values()
    scenario, limit = simulation.plant.scenario, score.limit
    notes = list(scenario.notes)
    if not sources:
        notes.append(_NO_ESTIMATE)
    notes += [_REFUSED.filled(count=count, sentence=sentence) for sentence, count in score.refused.items()]
    if score.disturbed_at is not None:
        notes.append(_CHANGED.filled(time=score.disturbed_at))
    if limit is not None and simulation.time > limit.time[-1] + simulation.interval:
        notes.append(_LONGER.filled(time=limit.time[-1]))
    return Report(
        scenario=scenario.name,
        title=scenario.title,
        seed=simulation.plant.seed,
        duration_s=simulation.time,
        imu_samples=simulation.samples,
        truth=_joined([source.tracks()[1] for source in sources]),
        results=tuple(_result(source, score) for source in sources),
        notes=tuple(notes),
    )


def _result(source: Source, score: Score) -> Result:
    rows, truth = source.tracks()
    limit = score.limit
    if limit is not None and (truth.time[-1] > limit.time[-1] or score.disturbed_at is not None):
        limit = None
    delays = np.array(source.delays)
    came = _RECEIVED.filled(count=source.count, median=np.median(delays) * 1e3, largest=np.max(delays) * 1e3)
    notes = (came, _THINNED.filled(stride=source.stride)) if source.stride > 1 else (came,)
    called = Called(source.name, "latitude" in rows)
    return result_of(called, rows, truth, limit, us_per_sample=float("nan"), notes=notes, sigma=source.stated())


def _joined(parts: list[Track]) -> Track:
    """All rows of several tracks in order of time, each time once."""
    if not parts:
        return Track(np.zeros(0))
    times, rows = np.unique(np.concatenate([part.time for part in parts]), return_index=True)
    return Track(times, **{name: np.concatenate([getattr(part, name) for part in parts])[rows] for name in POSE})
