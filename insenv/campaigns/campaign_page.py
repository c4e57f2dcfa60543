"""The page of a campaign: its tables and the courses of its errors, as one document for the front end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import insenv
from insenv.campaigns.presentation import CAMPAIGN_COLUMNS, campaign_facts, campaign_rows, consistency_lines, drawn
from insenv.campaigns.statistics import Statistics
from insenv.evaluation.errors import ATTITUDE, POSITION, VELOCITY
from insenv.report.page import assembled
from insenv.report.page.arrays import Pool, kept_records
from insenv.report.page.of_run import NAMES, unit_of
from insenv.report.page.panels import TRUTH_GROUP, TimePanel, section, table
from insenv.report.scales import threshold_of
from insenv.report.tables import label, number


def campaign_page(found: Statistics) -> str:
    """The HTML of a campaign."""
    return assembled(f"{found.plan.name}: {found.plan.estimator}", {"report": campaign_page_document(found)})


def campaign_page_document(found: Statistics) -> dict[str, Any]:
    """The document of the page of a campaign (web/README.md)."""
    pool = Pool()
    keep = kept_records(len(found.time), 8 * len(found.courses) + 2)
    groups = (("Attitude error", ATTITUDE), ("Position error", POSITION), ("Velocity error", VELOCITY))
    sections = [
        section(title, [_course(found, pool, keep, name) for name in group if name in found.courses]) for title, group in groups
    ]
    if found.nees is not None:
        sections.append(section("Consistency", [_nees(found, pool, keep)], columns=1))
    rows = [(text, *map(number, values)) for text, values in campaign_rows(found)]
    ratio = CAMPAIGN_COLUMNS.index("rms/limit")
    above = [(k, ratio) for k, (_, values) in enumerate(campaign_rows(found)) if (values[ratio - 1] or 0.0) > 3.0]
    levels = [f"{level:g} %" for level in found.percentile_levels]
    ends = [(label(name), *map(number, row["percentiles"].values())) for name, row in found.figures().items()]
    plan = found.plan
    return {
        "kind": "report",
        "version": insenv.__version__,
        "name": f"{plan.name}: {plan.estimator}",
        "title": str(plan.scenario.get("title", "")),
        "facts": [campaign_facts(found), *(f"{one.key} drawn {drawn(one)}" for one in plan.variations)],
        "truth": "truth",
        "shares": True,
        "legend": [{"name": "median of the runs"}],
        "tables": [
            table("Errors over the runs", CAMPAIGN_COLUMNS, rows, below=_sentences(found), warnings=above),
            table("Percentiles of the errors at the end", ("error", *levels), ends),
        ],
        "explained": [
            "mean, percentiles: of the errors at the end; rms, limit, stated: over the time of the statistics, all runs.",
            "limit: the smallest standard deviation that any method can have.",
        ],
        "notes": list(found.notes),
        "sections": [one for one in sections if one["panels"]],
        "arrays": pool.as_json(),
    }


def _sentences(found: Statistics) -> Sequence[str]:
    start = [] if found.from_s <= 0 else [f"Statistics from {found.from_s:g} s on"]
    return [*start, *consistency_lines(found)]


def _course(found: Statistics, pool: Pool, keep: Any, name: str) -> dict[str, Any]:
    course = found.courses[name]
    low, lower, median, upper, high = course.percentiles
    reach = 0.0 if course.limit is None else float(np.nanmax(course.limit[-max(1, len(found.time) // 4) :]))
    panel = TimePanel(
        pool, NAMES[name], unit_of(name), found.time[keep], wraps=name in ATTITUDE,
        threshold=threshold_of([np.stack([low, high], 1).ravel()], [reach]), from_s=found.from_s if found.from_s > 0 else None,
    )  # fmt: skip
    panel.between(0, low[keep], high[keep])
    panel.between(0, lower[keep], upper[keep], 1.6)
    if course.limit is not None:
        panel.curve(TRUTH_GROUP, course.limit[keep], "limit")
    panel.curve(0, median[keep])
    return panel.as_json()


def _nees(found: Statistics, pool: Pool, keep: Any) -> dict[str, Any]:
    assert found.nees is not None
    times = found.time[keep]
    panel = TimePanel(pool, f"Mean NEES of {found.nees.degrees:g} states, with its 95 % bounds", "1", times)
    panel.between(2, np.full(len(times), found.nees.low), np.full(len(times), found.nees.high))
    panel.curve(0, found.nees.mean[keep])
    return panel.as_json()
