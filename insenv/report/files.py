"""Result files: every array of a run with its unit, frame and meaning, a summary, the page, the figure.

All of them are written, or none: an interrupted run leaves the files of an earlier run as they were.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError, InsenvError
from insenv.base.installing import advice, is_installed
from insenv.base.output import as_path, staged, to_json
from insenv.base.style import save
from insenv.core.tables import Row
from insenv.evaluation.errors import Result
from insenv.report.document import Document
from insenv.report.figures import draw, drawable
from insenv.report.page import run_page
from insenv.report.run_data import RunData
from insenv.report.tables import run_document

FORMAT = "insenv-results"
VERSION = 1
NOTHING_TO_DRAW = "no figure: there is neither a reference to compare with nor an estimate to show"
_TRUTH = ("time", "q_nb", "velocity_n", "latitude", "longitude", "height")
_UNITS = {"deg": "deg", "m": "m", "mps": "m/s"}


def no_matplotlib() -> str:
    """The note of results without a figure because matplotlib is not installed; empty if it is."""
    return "" if is_installed("matplotlib") else f"no figure: matplotlib is not installed: {advice('matplotlib', 'plot')}"


@dataclass(frozen=True)
class FilesWritten:
    """paths: the files written: npz, json, html, png, svg, then further ones. note: what was omitted and why, or empty."""

    paths: tuple[Path, ...]
    note: str = ""


class OutputFolder:
    """An output folder, checked before the long work. Raises `InputError` if it cannot be written to.

    The first file creates it: work that fails leaves no empty folder.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = as_path("folder", path)
        try:
            present = next(p for p in (self.path.absolute(), *self.path.absolute().parents) if p.exists())
            if not present.is_dir():
                raise InputError(f"cannot write to the output folder {str(path)!r}: {str(present)!r} is not a folder")
            with tempfile.TemporaryFile(dir=present):
                pass
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"cannot write to the output folder {str(path)!r}: {reason}") from None

    @contextmanager
    def staged(self) -> Iterator[Callable[[str], Path]]:
        """Write all files of the block or none; see `insenv.base.output.staged`. Raises `InsenvError` if writing fails.

        A name may have folders in it, which are made.
        """
        try:
            with ExitStack() as stack:
                parts: dict[Path, Callable[[str], Path]] = {}

                def part(name: str) -> Path:
                    inner = Path(name).parent
                    if inner not in parts:
                        (self.path / inner).mkdir(parents=True, exist_ok=True)
                        parts[inner] = stack.enter_context(staged(self.path / inner))
                    return parts[inner](Path(name).name)

                self.path.mkdir(parents=True, exist_ok=True)
                yield part
        except OSError as error:
            raise InsenvError(f"cannot write to {str(self.path)!r}: {error.strerror or error}") from error


def write_files(
    report: RunData,
    folder: OutputFolder,
    figure: bool = True,
    more: Mapping[str, str | bytes] | None = None,
    documents: Mapping[str, Any] | None = None,
) -> FilesWritten:
    """Write NAME.npz and NAME.json; if `figure`, the page NAME.html, and, with matplotlib, NAME.png and NAME.svg.

    NAME is the scenario's.  more: contents of further files by name.  documents: further ones of the page by kind, such as
    "live".  Raises `InsenvError` if that fails; then none of them is written.
    """
    name = file_name(report.scenario)
    note = ""
    if figure:
        note = NOTHING_TO_DRAW if not drawable(report) else no_matplotlib()
    drawn = figure and not note
    kinds = ["npz", "json", *(["html"] if figure else []), *(["png", "svg"] if drawn else [])]
    names = [*(f"{name}.{kind}" for kind in kinds), *(more or {})]
    paths = tuple(folder.path / n for n in names)
    arrays, described = collect(report)
    meta = {
        "format": FORMAT,
        "version": VERSION,
        "title": report.title,
        "run": run_document(report).as_json(),
        "arrays": described,
    }
    with folder.staged() as part:
        with part(names[0]).open("wb") as stream:
            np.savez_compressed(stream, allow_pickle=False, meta=np.array(to_json(meta, indent=None)), **arrays)
        text = to_json(run_document(report).as_json([str(path) for path in paths])) + "\n"
        part(names[1]).write_text(text, encoding="ascii")
        if figure:
            part(f"{name}.html").write_text(run_page(report, documents), encoding="utf-8", newline="\n")
        if drawn:
            save(draw(report), {kind: part(f"{name}.{kind}") for kind in ("png", "svg")})
        write_contents(more or {}, part)
    return FilesWritten(paths, note)


def write_document(document: Document, folder: OutputFolder, figure: bool = True) -> FilesWritten:
    """Write the files of a document: its texts, NAME.npz, NAME.json; if `figure`, its page and, with matplotlib, its figure.

    Raises `InsenvError` if that fails; then none of them is written.  The JSON document names the files without the folder, so
    that equal results are equal files.
    """
    note = no_matplotlib() if figure and document.figure else ""
    page, draw_figure = (document.page, None if note else document.figure) if figure else (None, None)
    kinds = {"npz": document.arrays, "json": True, "html": page, "png": draw_figure, "svg": draw_figure}
    made = [f"{document.name}.{kind}" for kind, there in kinds.items() if there]
    names = [*document.texts, *made, *document.further]
    with folder.staged() as part:
        write_contents(document.texts, part)
        if document.arrays is not None:
            with part(f"{document.name}.npz").open("wb") as stream:
                np.savez_compressed(stream, allow_pickle=False, **document.arrays())
        part(f"{document.name}.json").write_text(to_json(document.as_json(names)) + "\n", encoding="ascii")
        for name, write in document.further.items():
            write(part(name))
        if page is not None:
            part(f"{document.name}.html").write_text(page(), encoding="utf-8", newline="\n")
        if draw_figure is not None:
            save(draw_figure(), {kind: part(f"{document.name}.{kind}") for kind in ("png", "svg")})
    return FilesWritten(tuple(folder.path / name for name in names), note)


def write_contents(contents: Mapping[str, str | bytes], part: Callable[[str], Path]) -> None:
    """Write texts and bytes by name through `part`, the function that `OutputFolder.staged` gives."""
    for name, content in contents.items():
        part(name).write_bytes(content.encode() if isinstance(content, str) else content)


def file_name(scenario: str) -> str:
    """The scenario's name (of a file: without folder and suffix) as a file name that is valid on every system."""
    name = Path(scenario).stem if scenario.endswith(".toml") else scenario
    return re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "run"


def collect(report: RunData) -> tuple[dict[str, NDArray[Any]], dict[str, dict[str, Any]]]:
    """All arrays of a report by key, and {"unit", "frame", "shape", "meaning"} by key."""
    arrays: dict[str, NDArray[Any]] = {}
    described: dict[str, dict[str, Any]] = {}

    def add(key: str, array: NDArray[Any], unit: str, frame: str, meaning: str) -> None:
        arrays[key] = np.asarray(array)
        described[key] = {"unit": unit, "frame": frame, "shape": list(arrays[key].shape), "meaning": meaning}

    rows = _truth_rows()
    for name in _TRUTH:
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
                add(f"{prefix}/{kind}/{channel}", value, _UNITS[channel.rpartition("_")[2]], frame, meaning)
    return arrays, described


def _truth_rows() -> dict[str, Row]:
    from insenv.vehicles import TRUTH_STATE

    return {"time": Row("time", "Time since the start", "s"), **{row.name: row for row in TRUTH_STATE}}


def _output_rows(result: Result) -> dict[str, Row]:
    from insenv.estimators.registry import get, names

    if result.estimator not in names():
        return {}
    return {row.name: row for row in get(result.estimator).model.outputs}
