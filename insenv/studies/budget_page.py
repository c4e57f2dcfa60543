"""The page of an error budget: its tables, and the contributions stacked over time, as one document for the front end."""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv.base.version import __version__
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.report.page import assembled
from insenv.report.page.of_run import NAMES, unit_of
from insenv.report.page.panels import TRUTH_GROUP, Pool, TimePanel, kept_records, section, table
from insenv.report.scales import threshold_of
from insenv.report.tables import label, number
from insenv.studies.budget_presentation import GROUPS, budget_rows, facts, left_out, ranked, sentences
from insenv.studies.budget_result import Array, Budget

SOURCES, ALL, OTHERS, METHOD = (0, 1, 2, 3, 4, 5, 7, 8, 9, 10), 6, 11, 12
"""Groups of curves: of the sources with a colour of their own, the error with all sources, the other sources, the method."""
OPAQUE = 4.5
"""Strength of bands that do not overlap."""


def budget_page(found: Budget) -> str:
    """The HTML of a budget."""
    return assembled(f"{found.scenario}: error budget of {found.estimator}", {"report": budget_page_document(found)})


def budget_page_document(found: Budget) -> dict[str, Any]:
    """The document of the page of a budget (web/README.md)."""
    drawn = _Drawn(found)
    sections = []
    for title, names in (("Attitude", ATTITUDE), ("Position", POSITION), ("Velocity", VELOCITY)):
        own = [name for name in names if name in found.channels]
        sections.append(section(f"{title}: root of the sum of squares", [drawn.stack(name) for name in own]))
        sections.append(section(f"{title}: shares in the variance", [drawn.shares(name) for name in own]))
    others = f"{len(drawn.others)} other sources" if drawn.others else ""
    named = {ALL: "all sources", OTHERS: others, METHOD: "method"} | {group: found.sources[k] for group, k in drawn.own}
    return {
        "kind": "report",
        "version": __version__,
        "name": f"{found.scenario}: {found.estimator}",
        "title": "Error budget: which source of error dominates",
        "facts": [facts(found)],
        "truth": "truth",
        "legend": [{"name": named.get(group, ""), "first": group == ALL} for group in range(METHOD + 1)],
        "tables": [_table(found, title, names) for title, names in GROUPS if any(name in found.channels for name in names)],
        "explained": [f"{sentence}." for sentence in sentences(found)],
        "notes": [*filter(None, [left_out(found)]), *found.notes],
        "sections": [one for one in sections if one["panels"]],
        "arrays": drawn.pool.as_json(),
    }


def _table(found: Budget, title: str, names: tuple[str, ...]) -> dict[str, Any]:
    places = [found.channels.index(name) for name in names if name in found.channels]
    columns = ["rms", *(text for place in places for text in (label(found.channels[place]), "w/o"))]
    rows = [(row.name, *("" if value is None else number(value) for value in row.values)) for row in budget_rows(found, places)]
    return table(title.partition(",")[0].capitalize(), columns, rows)


class _Drawn:
    """The panels of a budget.  own: group and place of each source with a colour; others: places of the other sources."""

    def __init__(self, found: Budget) -> None:
        own, self.others = ranked(found)
        self.own = list(zip(SOURCES, own, strict=False))
        self.found, self.pool = found, Pool()
        self.keep = kept_records(len(found.time), len(found.channels) * 2 * (len(own) + 4) + 1)

    def _bands(self, name: str) -> list[tuple[int, Array]]:
        """Group and mean square (records,) of each band, the lowest first."""
        found, place = self.found, self.found.channels.index(name)
        squares = np.nan_to_num(found.alone[..., place])[:, self.keep]
        bands = [(group, squares[k]) for group, k in self.own]
        bands += [(OTHERS, squares[self.others].sum(axis=0))] if self.others else []
        return [*bands, (METHOD, found.none[self.keep, place])]

    def _panel(self, name: str, unit: str, **more: Any) -> TimePanel:
        from_s = self.found.from_s if self.found.from_s > 0 else None
        return TimePanel(self.pool, NAMES[name], unit, self.found.time[self.keep], from_s=from_s, positive=True, **more)

    def stack(self, name: str) -> dict[str, Any]:
        """Mean squares add up: a band ends at the root of the sum of those below it and its own."""
        found, place = self.found, self.found.channels.index(name)
        whole = np.sqrt(found.whole[self.keep, place])
        limit = None if found.limit is None else np.sqrt(found.limit[self.keep, place])
        reach = 0.0 if limit is None else float(np.nanmax(limit[-max(1, len(limit) // 4) :]))
        panel = self._panel(name, unit_of(name), threshold=threshold_of([whole], [reach]))
        below = np.zeros(len(self.keep))
        for group, square in self._bands(name):
            panel.between(group, np.sqrt(below), np.sqrt(below + square), OPAQUE)
            below = below + square
        if limit is not None:
            panel.curve(TRUTH_GROUP, limit, "limit")
        panel.curve(ALL, whole)
        return panel.as_json()

    def shares(self, name: str) -> dict[str, Any]:
        """What each band has of their sum."""
        panel = self._panel(name, "%", most=100.0)
        bands = self._bands(name)
        total = np.sum([square for _, square in bands], axis=0)
        below = np.zeros(len(self.keep))
        for group, square in bands:
            above = below + 100.0 * np.divide(square, total, out=np.zeros_like(total), where=total > 0.0)
            panel.between(group, below, above, OPAQUE)
            below = above
        return panel.as_json()
