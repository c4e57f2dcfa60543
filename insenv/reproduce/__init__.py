"""`reproduce`: the published numbers of each paper, as printed, with insenv's own form, and the limit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest

PAPERS = {
    "ecef": "ECEF fine alignment, 12-state Kalman filter",
    "navigation": "airborne wander-azimuth navigation, loosely coupled GPS and smoothing",
    "swaying": "inertial-frame alignment on a swaying base with FIR filters",
    "quaternion": "quaternion adaptive Kalman alignment",
    "large-misalignment": "large misalignment: additive quaternion error, EKF and simplified UKF",
}
"""Titles of the papers by short name; each paper is a module of this package with `quantities`, `figure` and `CONDITIONS`."""


@dataclass(frozen=True)
class Quantity:
    """A row of a paper's table.

    paper: short name of the paper.
    quantity, unit: the quantity and its conditions; its unit.
    published: the number in the paper, None if it gives none.
    ours: the number measured here with insenv's own form of the method, None if the row is about the printed form alone.
    limit: the theoretical limit, None if there is none.
    seeds: number of seeds (1 where nothing is random).
    note: how this row was judged, and further conditions; those of all rows of the paper are its `conditions`.
    printed_form: the number measured here with the method as the paper prints it; None if the row is about insenv's form alone.
    """

    paper: str
    quantity: str
    unit: str
    published: float | None
    ours: float | None
    limit: float | None
    seeds: int
    note: str = ""
    printed_form: float | None = None

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
        yield name, _module(name).quantities()


def conditions(paper: str) -> str:
    """Scenarios, seeds and the way of judging that all rows of a paper share."""
    return str(_module(paper).CONDITIONS)


def footnotes(notes: Iterable[str]) -> tuple[list[str], list[str]]:
    """The mark of each row, "" where its note is empty, and the notes that the marks refer to, each once."""
    notes = list(notes)
    shown = list(dict.fromkeys(note for note in notes if note))
    return [f" [{shown.index(note) + 1}]" if note else "" for note in notes], [f"[{i}] {n}" for i, n in enumerate(shown, 1)]


def figure(paper: str, folder: Path) -> list[Path]:
    """Draw the figures of a paper into `folder`; returns the paths of the files, PNG and SVG of each figure."""
    return _module(paper).figure(folder / f"reproduce-{paper}")


def rms(values: Any) -> float:
    """Root mean square of all elements of an array."""
    return float(np.sqrt(np.mean(values**2)))


def chosen(paper: str | None) -> list[str]:
    """The chosen paper, or all if None.  Raises `InputError` for an unknown paper."""
    if paper is not None and paper not in PAPERS:
        raise InputError(f"no paper {paper!r}{nearest(paper, PAPERS)}")
    return [paper] if paper else list(PAPERS)


def _module(paper: str):  # type: ignore[no-untyped-def]
    return import_module(f"insenv.reproduce.{paper.replace('-', '_')}")


__all__ = ["PAPERS", "Quantity", "chosen", "conditions", "figure", "footnotes", "reproduce", "rms"]
