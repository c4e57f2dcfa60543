"""`RunData`: the results of a run or a replay, which tables, figures and files show."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from insenv.evaluation.errors import Result, Track
from insenv.evaluation.limits import ratio_bounds


@dataclass(frozen=True, repr=False)
class RunData:
    """A whole run or replay: the truth (or reference) at the recorded times, and the result of each estimator.

    scenario: its name, or the path of a log. seed: None for a replay. imu_samples: number of inertial samples.
    published: name and RMS by channel of published results for the same log.
    """

    scenario: str
    title: str
    seed: int | None
    duration_s: float
    imu_samples: int
    truth: Track
    results: tuple[Result, ...]
    notes: tuple[str, ...] = ()
    published: tuple[tuple[str, dict[str, float]], ...] = field(default=())

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "scenario": self.scenario,
            "seed": self.seed,
            "duration_s": self.duration_s,
            "imu_samples": self.imu_samples,
            "results": [
                {
                    "estimator": r.estimator,
                    **r.statistics(),
                    "limit": r.limit,
                    "limit_ratio_95": list(ratio_bounds(1)) if r.limit and self.seed is not None else None,
                    "stated": r.stated(),
                    "health": None if r.health is None else r.health.as_json(),
                    "unit": [error.as_json() for error in r.unit],
                    "us_per_sample": r.us_per_sample,
                    "statistics_from_s": r.from_s,
                    "notes": list(r.notes),
                }
                for r in self.results
            ],
            "notes": list(self.notes),
        }
