"""`reproduce`: the published numbers of each paper, as printed, with insenv's own form, and the limit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.base.style import save
from insenv.core.tables import Array
from insenv.report.document import Block, Document, Line
from insenv.report.figures import draw
from insenv.report.files import OutputFolder
from insenv.report.panels import TRUTH_GROUP, Curve
from insenv.report.tables import number

Form = TypeVar("Form")

PAPERS = {
    "ecef": "ECEF fine alignment, 12-state Kalman filter",
    "navigation": "airborne wander-azimuth navigation, loosely coupled GPS and smoothing",
    "swaying": "inertial-frame alignment on a swaying base with FIR filters",
    "quaternion": "quaternion adaptive Kalman alignment",
    "large-misalignment": "large misalignment: additive quaternion error, EKF and simplified UKF",
}
"""Titles of the papers by short name; each is a module of this package with `quantities`, `pictures` and `CONDITIONS`."""


@dataclass(frozen=True)
class Quantity:
    """A row of a paper's table.

    quantity, unit: the quantity and its conditions; its unit.
    published: the number in the paper, None if it gives none.
    ours: the number measured here with insenv's own form of the method, None if the row is about the printed form alone.
    printed_form: that of the method as the paper prints it, None if the row is about insenv's form alone.
    limit: the theoretical limit, None if there is none.
    seeds: number of seeds (1 where nothing is random).
    note: how this row was judged, and further conditions; those of all rows of the paper are its `conditions`.
    paper: short name of the paper, which `reproduce` fills in.
    """

    quantity: str
    unit: str
    published: float | None = None
    ours: float | None = None
    printed_form: float | None = None
    limit: float | None = None
    seeds: int = 1
    note: str = ""
    paper: str = ""

    @property
    def ratio(self) -> float | None:
        """Ours over the limit (magnitudes); that of the printed form, if there is no other."""
        value = self.printed_form if self.ours is None else self.ours
        return abs(value / self.limit) if self.limit and value is not None else None

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        names = ("paper", "quantity", "unit", "published", "printed_form", "ours", "limit", "seeds", "note")
        return {**{name: getattr(self, name) for name in names}, "conditions": conditions(self.paper)}


def reproduce(paper: str | None = None) -> Iterator[tuple[str, list[Quantity]]]:
    """Yield (paper, its quantities) for one paper, or for all if None.  Raises `InputError` for an unknown paper."""
    for name in chosen(paper):
        yield name, [replace(row, paper=name) for row in _module(name).quantities()]


def conditions(paper: str) -> str:
    """Scenarios, seeds and the way of judging that all rows of a paper share."""
    return str(_module(paper).CONDITIONS)


def footnotes(notes: Iterable[str]) -> tuple[list[str], list[str]]:
    """The mark of each row, "" where its note is empty, and the notes that the marks refer to, each once."""
    notes = list(notes)
    shown = list(dict.fromkeys(note for note in notes if note))
    return [f" [{shown.index(note) + 1}]" if note else "" for note in notes], [f"[{i}] {n}" for i, n in enumerate(shown, 1)]


def figure(paper: str, folder: Path) -> list[Path]:
    """Draw the figures of a paper into `folder`; returns the paths of the files, PNG and SVG of each figure.

    All are written, or none.  Raises `InputError` for a folder that cannot be written to, `InsenvError` if writing fails.
    """
    target, names = OutputFolder(folder), list[str]()
    with target.staged() as part:
        for ending, picture in _module(paper).pictures().items():
            files = {kind: f"reproduce-{paper}{ending}.{kind}" for kind in ("png", "svg")}
            save(draw(picture), {kind: part(name) for kind, name in files.items()})
            names += files.values()
    return [folder / name for name in names]


def document(measured: Mapping[str, Sequence[Quantity]]) -> Document:
    """What is printed of the rows of papers."""
    rows = [quantity.as_json() for quantities in measured.values() for quantity in quantities]
    return Document("reproduce", {"rows": rows}, partial(_blocks, measured))


def _blocks(measured: Mapping[str, Sequence[Quantity]]) -> Iterator[Block]:
    """By paper: its conditions and notes, and its rows; what a row is about stands on the line above its numbers."""
    for name, quantities in measured.items():
        marks, notes = footnotes(q.note for q in quantities)
        yield Line()
        yield from map(Line, (f"{name}: {PAPERS[name]}", f"conditions: {conditions(name)}", *notes))
        yield Line()
        yield _columns(("published", "as printed", "ours", "limit", "ours/limit", "seeds"))
        for q, mark in zip(quantities, marks, strict=True):
            yield Line(f"{q.quantity}{mark}" + (f", {q.unit}" if q.unit else ""))
            yield _columns((*map(number, (q.published, q.printed_form, q.ours, q.limit, q.ratio)), str(q.seeds)))


def _columns(cells: Sequence[str]) -> Line:
    return Line("".join(f"{cell:>12}" for cell in cells))


def rms(values: Any) -> float:
    """Root mean square of all elements of an array."""
    return float(np.sqrt(np.mean(values**2)))


def both(forms: tuple[Form, Form], measure: Callable[[Form], Any]) -> tuple[float, float]:
    """A number of insenv's own form of a method, and that of the printed one."""
    return float(measure(forms[0])), float(measure(forms[1]))


def limits(x: Array, limit: float, label: str) -> Curve:
    """Plus and minus a limit that is the same at all times, drawn as that of a run."""
    return Curve(TRUTH_GROUP, np.full(len(x), limit), "limit", label=label)


def chosen(paper: str | None) -> list[str]:
    """The chosen paper, or all if None.  Raises `InputError` for an unknown paper."""
    if paper is not None and paper not in PAPERS:
        raise InputError(f"no paper {paper!r}{nearest(paper, PAPERS)}")
    return [paper] if paper else list(PAPERS)


def _module(paper: str):  # type: ignore[no-untyped-def]
    return import_module(f"insenv.reproduce.{paper.replace('-', '_')}")


__all__ = [
    "PAPERS",
    "Quantity",
    "both",
    "chosen",
    "conditions",
    "document",
    "figure",
    "footnotes",
    "limits",
    "reproduce",
    "rms",
]
