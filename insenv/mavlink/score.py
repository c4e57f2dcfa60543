"""The score of estimates that clients send: each against the truth at its own time, and against the limit.

An estimate is judged at its time stamp, so that neither the link nor the client's computing time counts as error; how late it
arrived is counted apart.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import isfinite, nan, sqrt
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.errors import InputError
from insenv.core.tables import Vector
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY, Array, Result, Track, checked_estimate, errors, track_of
from insenv.evaluation.limits import Limit
from insenv.mavlink.messages.fields import DEG_E7, Message
from insenv.mavlink.messages.view import View
from insenv.report import Report
from insenv.runs.function import Called
from insenv.runs.simulated import result_of

# Estimates that clients send: ODOMETRY, ATTITUDE, ATTITUDE_QUATERNION, VISION_POSITION_ESTIMATE.
#
# Frames: attitude from body FRD to NED at the vehicle; positions from home (HOME_POSITION) along the NED axes at home; the
# velocity of ODOMETRY in body FRD (child frame 12) or NED (child frame 1).  Times are those of the simulation clock, which the
# vehicle's messages carry (``time_usec``, ``time_boot_ms``), or the same in Unix time.

LOCAL_NED, BODY_FRD = 1, 12
"""MAV_FRAME."""
UNIX_US = 10**15
"""Time stamps beyond this many microseconds are Unix time."""
FARTHEST = 1e5
"""Largest distance from home, m, within which the axes at home make sense."""
_POSE_SIGMA = {0: POSITION[0], 6: POSITION[1], 11: POSITION[2], 15: ATTITUDE[0], 18: ATTITUDE[1], 20: ATTITUDE[2]}
"""Channels on the diagonal of a pose covariance, whose upper triangle stands row by row."""


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
    q = _by_euler(message.roll, message.pitch, message.yaw)
    return Estimate(message.time_boot_ms * 1e-3, checked_estimate(q), resolution=1e-3)


def _attitude_quaternion(message: Any, origin: Origin) -> Estimate:
    offset = tuple(getattr(message, "repr_offset_q", (0.0,) * 4))
    if any(offset) and offset != (1.0, 0.0, 0.0, 0.0):
        raise InputError(f"repr_offset_q = {list(offset)}: allowed is none: the attitude is that of the body")
    q = [message.q1, message.q2, message.q3, message.q4]
    return Estimate(message.time_boot_ms * 1e-3, checked_estimate(q), resolution=1e-3)


def _vision_position_estimate(message: Any, origin: Origin) -> Estimate:
    rows = checked_estimate(
        {
            "q_nb": _by_euler(message.roll, message.pitch, message.yaw),
            **_place((message.x, message.y, message.z), origin),
        }
    )
    return Estimate(_seconds(message.usec, origin), rows, _pose_sigma(message.covariance))


def _odometry(message: Any, origin: Origin) -> Estimate:
    if message.frame_id != LOCAL_NED:
        raise InputError(f"frame_id = {message.frame_id}: allowed is {LOCAL_NED} (MAV_FRAME_LOCAL_NED)")
    if message.child_frame_id not in (LOCAL_NED, BODY_FRD):
        raise InputError(
            f"child_frame_id = {message.child_frame_id}: allowed is {BODY_FRD} (MAV_FRAME_BODY_FRD) or {LOCAL_NED}"
            " (MAV_FRAME_LOCAL_NED)"
        )
    rows = checked_estimate(
        {
            "q_nb": message.q,
            "velocity_n": (message.vx, message.vy, message.vz),
            **_place((message.x, message.y, message.z), origin),
        }
    )
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


def _by_euler(roll: float, pitch: float, heading: float) -> Array:
    angles = {"roll": roll, "pitch": pitch, "yaw": heading}
    for name, angle in angles.items():
        if not isfinite(angle) or abs(angle) > 7.0:
            raise InputError(f"{name} = {angle:g} rad: allowed is a finite angle up to a full turn")
    return np.asarray(attitude.numeric.from_euler(roll, pitch, heading))


def _place(offset: Sequence[float], origin: Origin) -> dict[str, float]:
    """Latitude, longitude, height of a position from home along the NED axes at home."""
    if not all(map(isfinite, offset)) or max(map(abs, offset)) > FARTHEST:
        raise InputError(
            f"x, y, z = {[round(v, 3) for v in offset]} m: allowed are finite distances from home up to {FARTHEST:g} m"
        )
    at = (origin.latitude, origin.longitude, origin.height)
    found = geodesy.numeric.geodetic_from_ned_offset(np.array(offset), *at)
    return {name: float(value) for name, value in zip(("latitude", "longitude", "height"), found, strict=True)}


def _pose_sigma(triangle: Sequence[float]) -> dict[str, float]:
    """Standard deviations by channel (m, deg) of a pose covariance; none where it is unknown: NaN, or not positive."""
    found = {}
    for place, channel in _POSE_SIGMA.items():
        variance = triangle[place] if place < len(triangle) else nan
        if isfinite(variance) and variance > 0.0:
            found[channel] = sqrt(variance) * (180.0 / np.pi if channel in ATTITUDE else 1.0)
    return found


HISTORY_S = 600.0
"""Time for which the truth is kept: older estimates are refused."""
MOST = 200_000
"""Estimates kept of one source; beyond it every second one is dropped, and so on."""
ANSWER_S = 1.0
"""Simulated time between two answers to one source."""
NAMES = {
    "roll_deg": "ROLL", "pitch_deg": "PITCH", "heading_deg": "HEADING",
    "north_m": "NORTH", "east_m": "EAST", "down_m": "DOWN",
    "vn_mps": "VN", "ve_mps": "VE", "vd_mps": "VD",
}  # fmt: skip
"""Names of NAMED_VALUE_FLOAT by channel, behind E_ (error, estimate minus truth) and L_ (limit, 1 sigma)."""
_POSE = ("velocity_n", "latitude", "longitude", "height")


@dataclass
class Source:
    """The estimates of one client by one kind of message.

    name: "odometry-42-191", message, system and component.  kept: (time, estimate, truth) of those that are recorded, every
    `stride`-th; count: of all accepted; delays: simulated seconds from stamp to arrival; latest: its latest error by channel.
    """

    name: str
    kept: list[tuple[Estimate, dict[str, Vector]]] = field(default_factory=list)
    stride: int = 1
    count: int = 0
    delays: list[float] = field(default_factory=list)
    latest: dict[str, float] = field(default_factory=dict)
    time: float = float("-inf")
    answered: float = float("-inf")

    def take(self, estimate: Estimate, truth: dict[str, Vector], delay: float) -> None:
        """Record an estimate and the truth at its time."""
        if self.count % self.stride == 0:
            self.kept.append((estimate, truth))
            self.delays.append(delay)
        self.count, self.time = self.count + 1, estimate.time
        if len(self.kept) >= MOST:
            self.kept, self.delays, self.stride = self.kept[::2], self.delays[::2], 2 * self.stride
        found = errors(_track([estimate.time], [estimate.rows]), _track([estimate.time], [truth]))
        self.latest = {name: float(value[0]) for name, value in found.items()}


class Score:
    """Errors of the estimates that clients send.

    view: the vehicle.  limit: the smallest standard deviation that any method can have, or None.  sources: by name.  refused:
    number of messages that were refused, by the sentence that says why (the first of its kind).
    """

    def __init__(self, view: View, limit: Limit | None = None) -> None:
        simulation = view.simulation
        self.view, self.limit = view, limit
        self.sources: dict[str, Source] = {}
        self.refused: Counter[str] = Counter()
        self.disturbed_at: float | None = None
        self._sentences: dict[tuple[str, str], str] = {}
        latitude, longitude, height = view.home
        # as HOME_POSITION rounds it, by which clients count
        place = (round(latitude * DEG_E7) / DEG_E7, round(longitude * DEG_E7) / DEG_E7)
        self.origin = Origin(*place, round((height - view.undulation) * 1e3) * 1e-3 + view.undulation, view.start_unix)
        rows = int(HISTORY_S / simulation.interval) + 1
        self._history = np.full((rows, 11), np.nan)
        self._first = 0

    def follow(self) -> None:
        """Keep the truth of the present sample, and notice what makes the limit another one."""
        simulation, truth = self.view.simulation, self.view.truth
        row = self._history[simulation.samples % len(self._history)]
        row[0], row[1:5] = simulation.time, truth["q_nb"]
        row[5:8] = truth["velocity_n"]
        row[8], row[9], row[10] = truth["latitude"], truth["longitude"], truth["height"]
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
        return self._answers(source)

    def limit_at(self, time: float) -> dict[str, float]:
        """The limit by channel at a time (s); empty where there is none: beyond its run, or after the scenario was changed."""
        if (
            self.limit is None
            or time > float(self.limit.time[-1])
            or (self.disturbed_at is not None and time > self.disturbed_at)
        ):
            return {}
        return {name: float(value[0]) for name, value in self.limit.at(np.array([time])).items()}

    def _answers(self, source: Source) -> list[Message]:
        time_ms, limit = round(source.time * 1e3), self.limit_at(source.time)
        values = {f"E_{NAMES[name]}": error for name, error in source.latest.items()}
        values |= {f"L_{NAMES[name]}": limit[name] for name in source.latest if name in limit}
        made = [self.view.fields.message("NAMED_VALUE_FLOAT", time_ms, name, value) for name, value in values.items()]
        return [message for message in made if message is not None]

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
            return _rows(self._history[nearest % len(self._history)])
        low = int(time / dt)
        before, after = (self._history[place % len(self._history)] for place in (low, low + 1))
        return _rows(_between(before, after, (time - low * dt) / dt))


def _between(before: Vector, after: Vector, share: float) -> Vector:
    """Rows linear between two samples, with the longitude across the date line and the attitude as a rotation."""
    row = before + share * (after - before)
    turn = attitude.numeric.to_rotation_vector(attitude.numeric.multiply(attitude.numeric.conjugate(before[1:5]), after[1:5]))
    row[1:5] = attitude.numeric.multiply(before[1:5], attitude.numeric.from_rotation_vector(share * turn))
    east = (after[9] - before[9] + np.pi) % (2.0 * np.pi) - np.pi
    row[9] = before[9] + share * east
    return np.asarray(row)


def _rows(row: Vector) -> dict[str, Vector]:
    values = (row[1:5].copy(), row[5:8].copy(), np.array(row[8]), np.array(row[9]), np.array(row[10]))
    return dict(zip(("q_nb", *_POSE), values, strict=True))


def _track(times: list[float], rows: list[dict[str, Vector]]) -> Track:
    """The track of rows at times, with what the first of them has."""
    return track_of(np.array(times), {name: np.array([row[name] for row in rows]) for name in rows[0]})


def tracks(source: Source) -> tuple[dict[str, Vector], Track]:
    """What a source has sent, by row name, and the truth at the same times."""
    estimates, truths = zip(*source.kept, strict=True)
    rows = {name: np.array([each.rows[name] for each in estimates]) for name in estimates[0].rows}
    return rows, _track([each.time for each in estimates], list(truths))


def stated(source: Source) -> dict[str, Vector]:
    """Standard deviations by channel that a source has stated with every estimate."""
    estimates: list[Any] = [estimate for estimate, _ in source.kept]
    names = set.intersection(*(set(each.sigma) for each in estimates))
    return {name: np.array([each.sigma[name] for each in estimates]) for name in NAMES if name in names}


# The report of estimates that came from outside: the same as that of a run.


def report_of(score: Score) -> Report:
    """The report of all sources that have sent estimates; its truth is that at the times of their estimates."""
    simulation = score.view.simulation
    scenario, found = simulation.plant.scenario, [_result(source, score) for source in score.sources.values()]
    notes = list(scenario.notes)
    if not found:
        notes.append("no estimate was received")
    notes += [f"refused {count} times: {sentence}" for sentence, count in score.refused.items()]
    if score.disturbed_at is not None:
        notes.append(f"no limit: the scenario was changed at {score.disturbed_at:g} s, from where on it is another one")
    if score.limit is not None and simulation.time > score.limit.time[-1] + simulation.interval:
        notes.append(f"no limit of estimates that last longer than the scenario, {score.limit.time[-1]:g} s")
    return Report(
        scenario=scenario.name,
        title=scenario.title,
        seed=simulation.plant.seed,
        duration_s=simulation.time,
        imu_samples=simulation.samples,
        truth=_joined([tracks(source)[1] for source in score.sources.values()]),
        results=tuple(found),
        notes=tuple(notes),
    )


def _result(source: Source, score: Score) -> Result:
    rows, truth = tracks(source)
    limit = score.limit
    if limit is not None and (truth.time[-1] > limit.time[-1] or score.disturbed_at is not None):
        limit = None
    delays = np.array(source.delays)
    notes: tuple[str, ...] = (
        f"{source.count} estimates by MAVLink; they arrived {np.median(delays) * 1e3:.3g} ms after their time stamp in the"
        f" median, at most {np.max(delays) * 1e3:.3g} ms",
    )
    if source.stride > 1:
        notes = (*notes, f"one in {source.stride} of them is recorded")
    called = Called(source.name, "latitude" in rows)
    return result_of(called, rows, truth, limit, us_per_sample=float("nan"), notes=notes, sigma=stated(source))


def _joined(parts: list[Track]) -> Track:
    """All rows of several tracks in order of time, each time once."""
    if not parts:
        return Track(np.zeros(0))
    times, rows = np.unique(np.concatenate([part.time for part in parts]), return_index=True)
    names = ("q_nb", "velocity_n", "latitude", "longitude", "height")
    return Track(times, **{name: np.concatenate([getattr(part, name) for part in parts])[rows] for name in names})
