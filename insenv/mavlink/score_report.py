"""The report of estimates that came from outside: the same as that of a run."""

from __future__ import annotations

import numpy as np

from insenv.evaluation.errors import Result, Track
from insenv.mavlink.score import Score, Source, stated, tracks
from insenv.report import Report
from insenv.runs.function import Called
from insenv.runs.simulated import result_of


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
