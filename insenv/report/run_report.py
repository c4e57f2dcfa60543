"""`Report`: what a run or a replay returns; its document and files."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, nearest
from insenv.base.output import finite, to_json
from insenv.core.tables import Row
from insenv.evaluation.errors import Result
from insenv.report.document import Document
from insenv.report.files import FilesWritten, OutputFolder, file_name, write_document
from insenv.report.notebook import Shown, data_frame
from insenv.report.of_run import drawable, run_page, run_picture
from insenv.report.run_data import RunData
from insenv.report.tables import facts, run_blocks, unit_of

if TYPE_CHECKING:
    from pandas import DataFrame

FORMAT = "insenv-results"
VERSION = 1
NOTHING_TO_DRAW = "no figure: there is neither a reference to compare with nor an estimate to show"
TRUTH_ROWS = ("time", "q_nb", "velocity_n", "latitude", "longitude", "height")


class Report(RunData, Shown):
    """A whole run or replay: the truth (or reference) at the recorded times, and the result of each estimator.

    scenario: its name, or the path of a log.  title, seed (None for a replay), duration_s (s), imu_samples (number of inertial
    samples).  truth: `Track`.  results: a `Result` for each estimator.  notes: sentences for the reader.  published: name and
    RMS by channel of published results for the same log.
    """

    def document(self) -> Document:
        """What is printed and kept of it."""
        return run_document(self)

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

    def __repr__(self) -> str:
        return "\n  ".join((f"Report of {self.scenario}, {', '.join(facts(self))}", *map(str, self.results)))


def run_document(report: RunData, further: Mapping[str, Any] | None = None) -> Document:
    """What is printed and kept of a run or replay; the JSON form has `published` if there are results of others.

    further: documents of the page by kind, such as "live".
    """
    values = report.as_json()
    if report.published:
        values["published"] = [{"name": name, "rms": dict(rms)} for name, rms in report.published]
    return Document(
        file_name(report.scenario),
        values,
        partial(run_blocks, report),
        arrays=partial(_arrays, report, values),
        page=partial(run_page, report, further),
        figure=partial(run_picture, report) if drawable(report) else None,
        undrawn="" if drawable(report) else NOTHING_TO_DRAW,
        located=True,
    )


def write_files(
    report: RunData,
    folder: OutputFolder,
    figure: bool = True,
    more: Mapping[str, str | bytes] | None = None,
    documents: Mapping[str, Any] | None = None,
) -> FilesWritten:
    """Write the files of a run.  more: contents of further files by name.  documents: further ones of the page by kind."""
    return write_document(run_document(report, documents), folder, figure, more)


def _arrays(report: RunData, values: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """All arrays of a run by key; meta: the JSON form, and unit, frame, shape and meaning of each array."""
    arrays, described = collect(report)
    meta = {"format": FORMAT, "version": VERSION, "title": report.title, "run": finite(values), "arrays": described}
    return {"meta": np.array(to_json(meta, indent=None)), **arrays}


def collect(report: RunData) -> tuple[dict[str, NDArray[Any]], dict[str, dict[str, Any]]]:
    """All arrays of a report by key, and {"unit", "frame", "shape", "meaning"} by key."""
    arrays: dict[str, NDArray[Any]] = {}
    described: dict[str, dict[str, Any]] = {}

    def add(key: str, array: NDArray[Any], unit: str, frame: str, meaning: str) -> None:
        arrays[key] = np.asarray(array)
        described[key] = {"unit": unit, "frame": frame, "shape": list(arrays[key].shape), "meaning": meaning}

    rows = _truth_rows()
    for name in TRUTH_ROWS:
        value = getattr(report.truth, name)
        if value is not None:
            meaning = rows[name].meaning if report.seed is not None else f"Of the log's reference: {name}"
            add(f"truth/{name}", value, rows[name].unit, rows[name].frame, meaning)
    for result in report.results:
        prefix = result.estimator
        outputs = _output_rows(result)
        add(f"{prefix}/time", result.time, "s", "", "Times of the estimator's outputs, errors and sigmas")
        for name, value in result.outputs.items():
            row = outputs.get(name)
            known = (row.unit, row.frame, row.meaning) if row else ("", "", "")
            add(f"{prefix}/outputs/{name}", value, *known)
        for kind, series, meaning in (
            ("errors", result.errors, "Error, estimate minus truth"),
            ("sigma", result.sigma, "Standard deviation that the estimator states"),
            ("limit", result.limit_sigma, "Smallest standard deviation that any method can have"),
        ):
            for channel, value in series.items():
                frame = "" if channel.endswith("_deg") else "n"
                add(f"{prefix}/{kind}/{channel}", value, unit_of(channel), frame, meaning)
        if result.outages is not None:
            lost = [(one.time, one.error, one.sigma) for one in result.outages.each]
            time, error, sigma = (np.concatenate(part) for part in zip(*lost, strict=True))
            add(f"{prefix}/outages/time", time, "s", "", "Times of the withheld fixes in the outages")
            add(f"{prefix}/outages/error", error, "m", "n", "Estimated less measured position of the antenna at these times")
            add(f"{prefix}/outages/sigma", sigma, "m", "n", "Standard deviation of that, of estimate and fix together")
    return arrays, described


def _truth_rows() -> dict[str, Row]:
    from insenv.vehicles import TRUTH_STATE

    return {"time": Row("time", "Time since the start", "s"), **{row.name: row for row in TRUTH_STATE}}


def _output_rows(result: Result) -> dict[str, Row]:
    from insenv.estimators.registry import get, names

    if result.estimator not in names():
        return {}
    return {row.name: row for row in get(result.estimator).model.outputs}
