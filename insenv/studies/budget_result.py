"""`Budget`: the shares of the sources of error, to be printed, drawn and saved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from insenv.base.output import to_json
from insenv.base.remarks import Remark, as_json
from insenv.core.tables import Array
from insenv.evaluation.errors import ATTITUDE, CHANNELS, POSITION, VELOCITY
from insenv.evaluation.limits import ratio_bounds
from insenv.report.document import Block, Document, Line, Page, Sentences, Table, page_of
from insenv.report.notebook import Shown, data_frame
from insenv.report.of_run import NAMES
from insenv.report.panels import OPAQUE, TRUTH_GROUP, Curve, Picture, Range, Section, TimePanel
from insenv.report.tables import label, left_out, number, runs_of, seeds_of, since, unit_of

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, repr=False)
class Budget(Shown):
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
    notes: tuple[Remark, ...]

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
            **as_json(self.notes),
        }

    def to_dataframe(self) -> DataFrame:
        """One row per source: columns ``alone_CHANNEL``, ``without_CHANNEL`` and ``share_CHANNEL``.

        Raises `InsenvError` if pandas is missing.
        """
        columns: dict[str, Array] = {}
        for kind, values in (
            ("alone", self.rms(self.alone)),
            ("without", self.rms(self.without)),
            ("share", self.shares()[:-1]),
        ):
            columns |= {f"{kind}_{name}": values[:, place] for place, name in enumerate(self.channels)}
        return data_frame(np.array(self.sources), columns, "source")

    def document(self) -> Document:
        """What is printed and kept of it."""
        arrays, page = partial(budget_arrays, self), partial(budget_page, self)
        figure = partial(budget_picture, self)
        return Document(NAME, self.as_json(), partial(budget_blocks, self), arrays=arrays, page=page, figure=figure)

    def __repr__(self) -> str:
        shares = self.shares()[:-1]
        lines = []
        for place, name in enumerate(self.channels):
            best = int(np.nanargmax(shares[:, place]))
            lines.append(f"{name}: {self.rms(self.whole)[place]:.3g}, most from {self.sources[best]}")
        return f"Budget of {self.scenario}: {self.estimator}, {runs_of(self.runs)}\n  " + "\n  ".join(lines)


# Output of an error budget: tables for 80 columns, the document, the files.

NAME = "budget"
GROUPS = (("attitude, deg", ATTITUDE), ("velocity, m/s", VELOCITY), ("position, m", POSITION))
SMALL = 1e-3
"""Share of the variance, in every channel of a table, below which a source is not listed."""
SHOWN = 10
"""Largest number of sources that have a colour of their own; the others are one band."""


def budget_blocks(budget: Budget) -> Iterator[Block]:
    """The printed lines and tables, top to bottom."""
    yield Line(f"{budget.scenario}: {budget.estimator}", "bold")
    yield Sentences("facts", [facts(budget)])
    for heading, names in GROUPS:
        places = [budget.channels.index(name) for name in names if name in budget.channels]
        if places:
            yield Line()
            yield budget_table(budget, heading, places)
    yield Line()
    yield Sentences("explained", sentences(budget), "dim")
    yield Sentences("notes", left_out(budget.diverged, budget.runs), "yellow")
    yield Sentences("notes", budget.notes, head="note: ")


def sentences(budget: Budget) -> tuple[str, ...]:
    """What the lines and columns mean."""
    count = budget.runs - len(budget.diverged)
    low, high = ratio_bounds(count)
    return (
        f"rms {since(budget.from_s)}: change by a source alone; w/o: error without it",
        "method: no source at all; interaction: all sources minus all contributions",
        f"rms of {runs_of(count)} over that of many runs: {low:.2f} to {high:.2f} (95 %)",
    )


def ranked(budget: Budget) -> tuple[list[int], list[int]]:
    """The sources with a colour of their own, the largest first, and the others; by place."""
    shares = np.nan_to_num(budget.shares()[:-1])
    order = sorted(range(len(budget.sources)), key=lambda k: -shares[k].max())
    return order[:SHOWN], order[SHOWN:]


def facts(budget: Budget) -> str:
    """Runs, duration, seeds and sources in one line."""
    seeds = seeds_of(budget.first_seed, budget.first_seed + budget.runs - 1)
    return f"{runs_of(budget.runs)} of {budget.duration_s:g} s, {seeds}; {len(budget.sources)} sources of error"


def budget_table(budget: Budget, heading: str, places: list[int]) -> Table:
    """Some channels, by their places: the sources by their share, in bold with a quarter of the variance, then what they make
    together."""
    names = [budget.channels[place] for place in places]
    shares = budget.shares()[:, places]
    alone, without = budget.rms(budget.alone)[:, places], budget.rms(budget.without)[:, places]
    largest = np.nan_to_num(shares[:-1], nan=np.inf).max(axis=1)
    order = sorted(range(len(budget.sources)), key=lambda k: -largest[k])
    small = [k for k in order if largest[k] < SMALL]
    if len(small) < 2:
        small = []
    rows = [
        _row(budget.sources[k], alone[k], shares[k] >= 0.25, list(map(number, without[k]))) for k in order if k not in small
    ]
    lines = [(f"{len(small)} smaller ones", np.sqrt(np.sum(alone[small] ** 2, axis=0)))] if small else []
    squares = {"method": budget.none, "root sum of squares": budget.sum, "all sources": budget.whole}
    squares |= {"interaction": budget.interaction} | ({} if budget.limit is None else {"limit": budget.limit})
    lines += [(name, budget.rms(each)[places]) for name, each in squares.items()]
    columns = (heading, *(text for name in names for text in (name.rpartition("_")[0], "w/o")))
    heads = ("rms", *(text for name in names for text in (label(name), "w/o")))
    nothing = [""] * len(places)
    rule, caption = len(rows) + bool(small), heading.partition(",")[0].capitalize()
    rows += [_row(name, values, [name == "all sources"] * len(places), nothing) for name, values in lines]
    return Table(columns, rows, rule, gap=1, caption=caption, heads=heads)


def _row(name: str, values: Array, large: Sequence[bool], beside: Sequence[str]) -> tuple[str | Line, ...]:
    cells = zip(map(number, values), large, beside, strict=True)
    return (name, *(cell for text, bold, other in cells for cell in (Line(text, "bold" if bold else ""), other)))


def budget_arrays(budget: Budget) -> dict[str, Any]:
    """All arrays of a budget by key (docs/budget.md): root mean squares over the runs at each time."""
    arrays: dict[str, Any] = {"time": budget.time, "channels": np.array(budget.channels), "sources": np.array(budget.sources)}
    for name in ("whole", "none", "interaction", "sum", "alone", "without", "limit"):
        squares = getattr(budget, name)
        if squares is not None:
            arrays[{"none": "method", "sum": "root_sum_square"}.get(name, name)] = np.sqrt(squares)
    arrays["meta"] = np.array(to_json({"format": "insenv-budget", "version": 1, **budget.as_json()}, indent=None))
    return arrays


# The page and the figure of an error budget: its tables, and the contributions stacked over time, with their shares.

SOURCES, ALL, OTHERS, METHOD = (0, 1, 2, 3, 4, 5, 7, 8, 9, 10), 6, 11, 12
"""Groups of curves: of the sources with a colour of their own, the error with all sources, the other sources, the method."""


def budget_page(budget: Budget) -> Page:
    """The page of a budget."""
    drawn = _Panels(budget)
    sections = []
    for heading, names in (("Attitude", ATTITUDE), ("Position", POSITION), ("Velocity", VELOCITY)):
        channels = [name for name in names if name in budget.channels]
        sections.append(Section(f"{heading}: root of the sum of squares", [drawn.stack(name) for name in channels]))
        sections.append(Section(f"{heading}: shares in the variance", [drawn.shares(name) for name in channels]))
    return page_of(
        budget_blocks(budget),
        tab=f"{budget.scenario}: error budget of {budget.estimator}",
        title="Error budget: which source of error dominates",
        legend=[{"name": name, "first": group == ALL} for group, name in enumerate(drawn.names("other sources"))],
        sections=sections,
    )


def budget_picture(budget: Budget) -> Picture:
    """By channel: root of the sum of squares, band by band, with the error with all sources and the limit; their shares.

    The largest source is the lowest band; the thickness of a band higher up therefore shows less than its rms.
    """
    drawn = _Panels(budget)
    title = f"{budget.scenario}: error budget of {budget.estimator}\n{runs_of(budget.runs)} of {budget.duration_s:g} s"
    names = [name for name in CHANNELS if name in budget.channels]
    if len(names) == 3:
        grid = [[drawn.stack(name), drawn.shares(name)] for name in names]
        heads = ("Contributions: root of the sum of squares", "Shares in the variance, %")
        return Picture(title, grid, drawn.names("others"), (9.5, 8.4), heads=heads, ratios=(1.4, 1))
    grid = [[drawn.stack(name) for name in names[row : row + 3]] for row in range(0, len(names), 3)]
    return Picture(title, grid, drawn.names("others"), (11.0, 1.8 + 2.3 * len(grid)))


class _Panels:
    """The panels of a budget.  places: of the sources with a colour, by group; others: of the other sources."""

    def __init__(self, budget: Budget) -> None:
        largest, self.others = ranked(budget)
        self.budget, self.places = budget, dict(zip(SOURCES, largest, strict=False))

    def names(self, others: str) -> list[str]:
        """The legend; others: what the sources without a colour are called."""
        named = {ALL: "all sources", OTHERS: f"{len(self.others)} {others}" if self.others else "", METHOD: "method"}
        named |= {group: self.budget.sources[place] for group, place in self.places.items()}
        return [named.get(group, "") for group in range(METHOD + 1)]

    def stack(self, name: str) -> TimePanel:
        """Mean squares add up: a band ends at the root of the sum of those below it and its own."""
        budget, place = self.budget, self.budget.channels.index(name)
        panel = self._panel(name, unit_of(name), errors=True, label=label(name))
        below = np.zeros(len(budget.time))
        for group, square in self._bands(name):
            panel.marks.append(Range(group, np.sqrt(below), np.sqrt(below + square), OPAQUE))
            below = below + square
        if budget.limit is not None:
            panel.marks.append(Curve(TRUTH_GROUP, np.sqrt(budget.limit[:, place]), "limit"))
        panel.marks.append(Curve(ALL, np.sqrt(budget.whole[:, place])))
        return panel

    def shares(self, name: str) -> TimePanel:
        """What each band has of their sum."""
        panel, bands = self._panel(name, "%", most=100.0), self._bands(name)
        total = np.sum([square for _, square in bands], axis=0)
        below = np.zeros(len(self.budget.time))
        for group, square in bands:
            above = below + 100.0 * np.divide(square, total, out=np.zeros_like(total), where=total > 0.0)
            panel.marks.append(Range(group, below, above, OPAQUE))
            below = above
        return panel

    def _bands(self, name: str) -> list[tuple[int, Array]]:
        """Group and mean square (records,) of each band, the lowest first."""
        budget, place = self.budget, self.budget.channels.index(name)
        squares = np.nan_to_num(budget.alone[..., place])
        bands = [(group, squares[k]) for group, k in self.places.items()]
        bands += [(OTHERS, squares[self.others].sum(axis=0))] if self.others else []
        return [*bands, (METHOD, budget.none[:, place])]

    def _panel(self, name: str, unit: str, **more: Any) -> TimePanel:
        from_s = self.budget.from_s if self.budget.from_s > 0 else None
        return TimePanel(NAMES[name], unit, self.budget.time, from_s=from_s, positive=True, **more)
