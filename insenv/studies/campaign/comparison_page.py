"""The page of a comparison of estimators on the same runs: their tables, paired differences and errors over time."""

from __future__ import annotations

from typing import Any

from insenv.base.version import __version__
from insenv.report.page import assembled
from insenv.report.page.panels import Pool, intervals_panel, kept_records, section, table
from insenv.report.tables import label
from insenv.studies.campaign.campaign_page import (
    campaign_page_facts,
    campaign_page_notes,
    campaign_page_tables,
    course_sections,
    explained,
)
from insenv.studies.campaign.comparison import PAIR_COLUMNS, PAIR_MEANINGS, Comparison, pair_rows


def comparison_page(found: Comparison) -> str:
    """The HTML of a comparison."""
    document = comparison_page_document(found)
    return assembled(document["name"], {"report": document})


def comparison_page_document(found: Comparison) -> dict[str, Any]:
    """The document of the page of a comparison (web/README.md)."""
    ids, campaigns = list(found.summaries), list(found.summaries.values())
    pool, plan = Pool(), campaigns[0].plan
    keep = kept_records(len(campaigns[0].time), sum(5 * len(one.courses) for one in campaigns) + 1)
    tables = [
        table(f"{id} compared with {found.first}, run by run", PAIR_COLUMNS, pair_rows(pairs), group=ids.index(id))
        for id, pairs in found.pairs.items()
    ]
    for place, (id, one) in enumerate(found.summaries.items()):
        tables += campaign_page_tables(one, id, place)
    ratios = [
        intervals_panel(
            f"{id}: rms over that of {found.first}, 95 %",
            [(label(name), pair.ratio.value, pair.ratio.low, pair.ratio.high) for name, pair in pairs.items()],
        )
        for id, pairs in found.pairs.items()
    ]
    return {
        "kind": "report",
        "version": __version__,
        "name": f"{plan.name}: {' and '.join(ids)}",
        "title": str(plan.scenario.get("title", "")),
        "facts": campaign_page_facts(campaigns[0]),
        "truth": "truth",
        "shares": True,
        "legend": [{"name": f"{id}, median of the runs"} for id in ids],
        "tables": tables,
        "explained": list(
            dict.fromkeys([*(f"{one}." for one in PAIR_MEANINGS), *(t for one in campaigns for t in explained(one))])
        ),
        "notes": [*found.notes, *(f"{id}: {note}" for id, one in found.summaries.items() for note in campaign_page_notes(one))],
        "sections": [section("The difference", ratios, columns=2), *course_sections(campaigns, pool, keep)],
        "arrays": pool.as_json(),
    }
