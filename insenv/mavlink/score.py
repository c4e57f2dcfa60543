"""The score of estimates that clients send: each against the truth at its own time, and against the limit.

An estimate is judged at its time stamp, so that neither the link nor the client's computing time counts as error; how late it
arrived is counted apart.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError
from insenv.core.tables import Vector
from insenv.evaluation.errors import Track, errors, track_of
from insenv.evaluation.limits import Limit
from insenv.mavlink.messages.fields import DEG_E7, Message
from insenv.mavlink.messages.view import View
from insenv.mavlink.received import Estimate, Origin, estimate_of

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
