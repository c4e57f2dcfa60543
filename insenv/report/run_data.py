"""`RunData`: the results of a run or a replay, which tables, figures and files show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insenv.base.remarks import Remark, as_json
from insenv.core.tables import Array
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
    notes: tuple[Remark, ...] = ()
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
                    "specific_force": None if r.specific_force is None else r.specific_force.as_json(),
                    **({} if r.outages is None else {"outages": r.outages.as_json()}),
                    "us_per_sample": r.us_per_sample,
                    "statistics_from_s": r.from_s,
                    **as_json(r.notes),
                }
                for r in self.results
            ],
            **as_json(self.notes),
        }


# Times without fixes, from the count of the fixes that a filter has used.


LONGER = 3.5
"""Intervals between fixes after which a gap is an outage."""


def outages(time: Array, count: Array) -> tuple[tuple[float, float], ...]:
    """Begin and end of each time without fixes (s), the end of the run included.

    time (n,) s: of the records. count (n,): fixes so far.
    """
    fixes = time[1:][np.diff(count) > 0]
    if len(fixes) < 3:
        return ()
    longest = LONGER * float(np.median(np.diff(fixes)))
    ends = np.append(fixes[1:], time[-1])
    return tuple((float(a), float(b)) for a, b in zip(fixes, ends, strict=True) if b - a > longest)


def has_fixes(result: Result) -> bool:
    """Whether an estimator reports the health of fixes of GNSS, and had some: there are filters that have other aids alone."""
    return result.health is not None and result.health.fixes > 0


def without_fixes(results: Iterable[Result]) -> tuple[tuple[float, float], ...]:
    """Times without fixes (s), by the estimator that has used the most."""
    counts = [(r.time, r.outputs["fix_count"]) for r in results if has_fixes(r)]
    return outages(*max(counts, key=lambda one: float(one[1][-1]))) if counts else ()
