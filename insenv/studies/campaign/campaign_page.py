"""The page of a campaign: its tables and the courses of its errors, as one document for the front end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from insenv.base.version import __version__
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.report.page import assembled
from insenv.report.page.of_run import EXPLAINED, NAMES, unit_of
from insenv.report.page.panels import TRUTH_GROUP, Pool, TimePanel, kept_records, section, table
from insenv.report.scales import threshold_of
from insenv.report.tables import label, number
from insenv.studies.campaign.presentation import (
    CAMPAIGN_COLUMNS,
    campaign_facts,
    campaign_rows,
    consistency_lines,
    drawn,
    failed_lines,
    horizontal_lines,
    meanings,
    sensitivity_meaning,
    sensitivity_tables,
)
from insenv.studies.campaign.statistics import Statistics

GROUPS = (("Attitude error", ATTITUDE), ("Position error", POSITION), ("Velocity error", VELOCITY))


def campaign_page(found: Statistics) -> str:
    """The HTML of a campaign."""
    return assembled(f"{found.plan.name}: {found.plan.estimator}", {"report": campaign_page_document(found)})


def campaign_page_document(found: Statistics) -> dict[str, Any]:
    """The document of the page of a campaign (web/README.md)."""
    pool = Pool()
    keep = kept_records(len(found.time), 8 * len(found.courses) + 2)
    sections = course_sections([found], pool, keep)
    if found.nees is not None:
        sections.append(section("Consistency", [_nees(found, pool, keep)], columns=1))
    plan = found.plan
    return {
        "kind": "report",
        "version": __version__,
        "name": f"{plan.name}: {plan.estimator}",
        "title": str(plan.scenario.get("title", "")),
        "facts": campaign_page_facts(found),
        "truth": "truth",
        "shares": True,
        "legend": [{"name": "median of the runs"}],
        "tables": campaign_page_tables(found),
        "explained": explained(found),
        "notes": campaign_page_notes(found),
        "sections": sections,
        "arrays": pool.as_json(),
    }


def campaign_page_facts(found: Statistics) -> list[str]:
    """Runs, seeds and varied keys."""
    return [campaign_facts(found), *(f"{one.key} drawn {drawn(one)}" for one in found.plan.variations)]


def campaign_page_tables(found: Statistics, name: str = "", group: int | None = None) -> list[dict[str, Any]]:
    """The tables that are printed.  name, group: of the estimator, if the page has several."""
    rows = [(text, *map(number, values)) for text, values in campaign_rows(found)]
    ratio = CAMPAIGN_COLUMNS.index("rms/limit")
    above = [(k, ratio) for k, (_, values) in enumerate(campaign_rows(found)) if (values[ratio - 1] or 0.0) > 3.0]
    start = [] if found.from_s <= 0 else [f"Statistics from {found.from_s:g} s on"]
    levels = [f"{level:g} %" for level in found.percentile_levels]
    ends = [(label(channel), *map(number, row["percentiles"].values())) for channel, row in found.figures().items()]
    of = f": {name}" if name else ""
    meaning = [sensitivity_meaning(found)]
    sensitivities = [
        table(f"Sensitivity of {', '.join(columns[1::2])}{of}", columns, cells, group=group, below=meaning, wide=True)
        for columns, cells in sensitivity_tables(found)
    ]
    return [
        table(
            f"Errors over the runs{of}", CAMPAIGN_COLUMNS, rows, group=group,
            below=[*start, *consistency_lines(found)], warnings=above,
        ),
        table(
            f"Percentiles of the errors at the end{of}", ("error", *levels), ends, group=group,
            below=list(horizontal_lines(found)),
        ),
        *sensitivities,
    ]  # fmt: skip


def explained(found: Statistics) -> list[str]:
    """What the columns of the tables mean."""
    return [*(f"{meaning}." for meaning in meanings(found)), EXPLAINED["limit"]]


def campaign_page_notes(found: Statistics) -> list[str]:
    """The runs that failed, and what must be said of the campaign."""
    return [*failed_lines(found), *found.notes]


def course_sections(campaigns: Sequence[Statistics], pool: Pool, keep: Any) -> list[dict[str, Any]]:
    """The errors over time of campaigns of the same runs, by channel; the place of a campaign is its group of curves."""
    sections = []
    for title, group in GROUPS:
        shown = [name for name in group if any(name in one.courses for one in campaigns)]
        if shown:
            sections.append(section(title, [_course(campaigns, pool, keep, name) for name in shown]))
    return sections


def _course(campaigns: Sequence[Statistics], pool: Pool, keep: Any, name: str) -> dict[str, Any]:
    """Median and bands of one channel, and the limit of the first campaign that has the channel."""
    own = [(place, one, one.courses[name]) for place, one in enumerate(campaigns) if name in one.courses]
    _, found, first = own[0]
    reach = 0.0 if first.limit is None else float(np.nanmax(first.limit[-max(1, len(found.time) // 4) :]))
    ends = [np.stack([course.percentiles[0], course.percentiles[-1]], 1).ravel() for _, _, course in own]
    start = min(one.from_s for _, one, _ in own)
    panel = TimePanel(
        pool, NAMES[name], unit_of(name), found.time[keep], wraps=name in ATTITUDE,
        threshold=threshold_of(ends, [reach] * len(ends)), from_s=start if start > 0 else None,
    )  # fmt: skip
    for place, _, course in own:
        low, lower, _, upper, high = course.percentiles
        panel.between(place, low[keep], high[keep])
        panel.between(place, lower[keep], upper[keep], 1.6)
    if first.limit is not None:
        panel.curve(TRUTH_GROUP, first.limit[keep], "limit")
    for place, _, course in own:
        panel.curve(place, course.percentiles[2][keep])
    return panel.as_json()


def _nees(found: Statistics, pool: Pool, keep: Any) -> dict[str, Any]:
    assert found.nees is not None
    times = found.time[keep]
    panel = TimePanel(pool, f"Mean NEES of {found.nees.degrees:g} states, with its 95 % bounds", "1", times)
    panel.between(2, np.full(len(times), found.nees.low), np.full(len(times), found.nees.high))
    panel.curve(0, found.nees.mean[keep])
    return panel.as_json()
