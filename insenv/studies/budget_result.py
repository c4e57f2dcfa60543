"""`Budget`: the shares of the sources of error, to be printed, drawn and saved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.evaluation.limits import ratio_bounds
from insenv.report import FilesWritten, OutputFolder
from insenv.report.notebook import require_matplotlib
from insenv.report.tables import runs_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Budget:
    """The error budget of an estimator in a scenario.

    time (records,) s.  channels, sources: their names.  from_s: time from which root mean squares are taken.
    Mean squares over the runs, (records, channels), in the squares of deg, m and m/s: whole: of the error with all sources;
    none: with none, that of the method; interaction: of what is left of the whole after all contributions, run by run;
    limit: of the theoretical limit with all sources, or None.  (sources, records, channels): alone: of the contributions,
    the error with one source minus that with none; without: of the error with all sources but one.  NaN where the estimator
    diverges.
    diverged: seeds of runs with a number that is not finite, which are left out.
    """

    scenario: str
    estimator: str
    runs: int
    first_seed: int
    duration_s: float
    from_s: float
    time: Array
    channels: tuple[str, ...]
    sources: tuple[str, ...]
    whole: Array
    none: Array
    interaction: Array
    alone: Array
    without: Array
    limit: Array | None
    diverged: tuple[int, ...]
    notes: tuple[str, ...]

    @property
    def sum(self) -> Array:
        """Mean square that the contributions and the method have together if they are uncorrelated, (records, channels)."""
        return self.none + self.alone.sum(axis=0)

    def rms(self, squares: Array) -> Array:
        """Root mean square (..., channels) of mean squares (..., records, channels) from `from_s` on."""
        late = self.time >= self.from_s - 1e-9
        return np.sqrt(np.mean(squares[..., late, :], axis=-2))

    def shares(self) -> Array:
        """Share of each source, and at the end of the method, in `sum` from `from_s` on: (sources + 1, channels)."""
        parts = self.rms(np.concatenate([self.alone, self.none[None]])) ** 2
        total = parts.sum(axis=0)
        return np.divide(parts, total, out=np.zeros_like(parts), where=total > 0.0)

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""

        def by_channel(values: Array) -> dict[str, float]:
            return dict(zip(self.channels, map(float, values), strict=True))

        shares = self.shares()
        alone, without = self.rms(self.alone), self.rms(self.without)
        count = self.runs - len(self.diverged)
        return {
            "scenario": self.scenario,
            "estimator": self.estimator,
            "runs": self.runs,
            "first_seed": self.first_seed,
            "duration_s": self.duration_s,
            "statistics_from_s": self.from_s,
            "sources": [
                {
                    "name": name,
                    "alone": by_channel(alone[k]),
                    "without": by_channel(without[k]),
                    "share": by_channel(shares[k]),
                }
                for k, name in enumerate(self.sources)
            ],
            "method": by_channel(self.rms(self.none)),
            "root_sum_square": by_channel(self.rms(self.sum)),
            "whole": by_channel(self.rms(self.whole)),
            "interaction": by_channel(self.rms(self.interaction)),
            "limit": {} if self.limit is None else by_channel(self.rms(self.limit)),
            "rms_ratio_95": list(ratio_bounds(count)),
            "diverged": list(self.diverged),
            "notes": list(self.notes),
        }

    def plot(self) -> Figure:
        """The figure of the contributions over time.  Raises `InsenvError` if matplotlib is missing."""
        from insenv.studies.budget_figure import draw_budget

        require_matplotlib()
        return draw_budget(self)

    def to_dataframe(self) -> DataFrame:
        """One row per source: columns ``alone_CHANNEL``, ``without_CHANNEL`` and ``share_CHANNEL``.

        Raises `InsenvError` if pandas is missing.
        """
        from insenv.report.notebook import data_frame

        columns: dict[str, Array] = {}
        for kind, values in (
            ("alone", self.rms(self.alone)),
            ("without", self.rms(self.without)),
            ("share", self.shares()[:-1]),
        ):
            columns |= {f"{kind}_{name}": values[:, place] for place, name in enumerate(self.channels)}
        return data_frame(np.array(self.sources), columns, "source")

    def save(self, folder: str | Path, figure: bool = True) -> FilesWritten:
        """Write budget.npz, budget.json and, if `figure` and matplotlib is installed, the figure.

        Raises `InputError` if the folder cannot be written to, `InsenvError` if writing fails.
        """
        from insenv.studies.budget_presentation import write_budget

        return write_budget(self, OutputFolder(folder), figure)

    def __repr__(self) -> str:
        shares = self.shares()[:-1]
        lines = []
        for place, name in enumerate(self.channels):
            best = int(np.nanargmax(shares[:, place]))
            lines.append(f"{name}: {self.rms(self.whole)[place]:.3g}, most from {self.sources[best]}")
        return f"Budget of {self.scenario}: {self.estimator}, {runs_of(self.runs)}\n  " + "\n  ".join(lines)
