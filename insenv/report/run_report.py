"""`Report`: what a run or a replay returns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from insenv.base.errors import InputError, InsenvError, nearest
from insenv.report.figures import draw, drawable
from insenv.report.files import NOTHING_TO_DRAW, FilesWritten, OutputFolder, write_files
from insenv.report.notebook import HtmlTable, data_frame, html_document, require_matplotlib
from insenv.report.run_data import RunData
from insenv.report.tables import (
    ESTIMATE_COLUMNS,
    error_columns,
    error_rows,
    estimate_rows,
    facts,
    number,
    unit_columns,
    unit_rows,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


class Report(RunData):
    """A whole run or replay: the truth (or reference) at the recorded times, and the result of each estimator.

    scenario: its name, or the path of a log.  title, seed (None for a replay), duration_s (s), imu_samples (number of inertial
    samples).  truth: `Track`.  results: a `Result` for each estimator.  notes: sentences for the reader.  published: name and
    RMS by channel of published results for the same log.
    """

    def plot(self) -> Figure:
        """The figure of all estimators: errors over time with their limits, and the track.

        Raises `InsenvError` if matplotlib is missing or there is nothing to draw.
        """
        require_matplotlib()
        if not drawable(self):
            raise InsenvError(NOTHING_TO_DRAW)
        return draw(self)

    def to_dataframe(self, estimator: str | None = None) -> DataFrame:
        """One estimator's result as a pandas DataFrame, indexed by time (s).

        Columns: ``error_CHANNEL``, ``sigma_CHANNEL``, ``limit_CHANNEL``, the truth as ``truth_ROW``, and the estimator's
        outputs by row name (``NAME_0``, ``NAME_1``, ... for vectors). estimator: may be None if the run has only one.
        Raises `InputError` for an unknown estimator, `InsenvError` if pandas is missing.
        """
        results = {result.estimator: result for result in self.results}
        if estimator is None and len(results) != 1:
            raise InputError(f"estimator: must be named, this run has {', '.join(results) or 'none'}")
        if estimator is not None and estimator not in results:
            raise InputError(f"estimator {estimator!r}: not in this run{nearest(str(estimator), results)}")
        result = self.results[0] if estimator is None else results[estimator]
        columns = {f"error_{name}": values for name, values in result.errors.items()}
        columns |= {f"sigma_{name}": values for name, values in result.sigma.items()}
        columns |= {f"limit_{name}": values for name, values in result.limit_sigma.items()}
        truth = {f"truth_{name}": values for name, values in self.truth.at(result.time).items()}
        return data_frame(result.time, {**columns, **truth, **result.outputs})

    def save(self, folder: str | Path, figure: bool = True) -> FilesWritten:
        """Write every array, the summary and, if `figure`, the page and (with matplotlib) the figure, as ``--out`` does.

        Raises `InputError` if the folder cannot be written to, `InsenvError` if writing fails.
        """
        return write_files(self, OutputFolder(folder), figure)

    def __repr__(self) -> str:
        return "\n  ".join((f"Report of {self.scenario}, {', '.join(facts(self))}", *map(str, self.results)))

    def _repr_html_(self) -> str:
        tables: list[HtmlTable] = []
        for result in self.results:
            if result.errors:
                rows = [(name, *map(number, values.values())) for name, values in error_rows(result)]
                tables.append((result.estimator, error_columns(result), rows))
            else:
                tables.append((result.estimator, ESTIMATE_COLUMNS, estimate_rows(result)))
            if result.unit:
                tables.append((result.estimator, unit_columns(result), unit_rows(result)))
        health = [f"{r.estimator}, health: {line}" for r in self.results if r.health is not None for line in r.health.lines]
        told = [*health, *(f"{r.estimator}: {note}" for r in self.results for note in r.notes), *self.notes]
        return html_document(
            f"{self.scenario}: {self.title}", ", ".join(facts(self)), tables, told, self.plot if drawable(self) else None
        )
