"""The page of a tuning: what was changed, the errors before and after, and the search, as one document for the front end."""

from __future__ import annotations

from typing import Any

import numpy as np

from insenv.base.version import __version__
from insenv.report.page import assembled
from insenv.report.page.panels import TRUTH_GROUP, Pool, TimePanel, intervals_panel, section, table
from insenv.report.tables import label, number
from insenv.studies.tune_result import CHANNEL_COLUMNS, PARAMETER_COLUMNS, Tuning, channel_rows, parameter_rows, sentences


def tuning_page(found: Tuning) -> str:
    """The HTML of a tuning."""
    return assembled(f"{found.source}: tuning of {found.estimator}", {"report": tuning_page_document(found)})


def tuning_page_document(found: Tuning) -> dict[str, Any]:
    """The document of the page of a tuning (web/README.md)."""
    pool = Pool()
    factors = [
        (parameter.key, float(factor), None, None) for parameter, factor in zip(found.parameters, found.factors, strict=True)
    ]
    ratios = [(label(one.name), one.ratio.value, one.ratio.low, one.ratio.high) for one in found.channels]
    changes = [intervals_panel("Factors on the parameters", factors)]
    changes += [intervals_panel(f"rms after / before, 95 %, on {found.judged_on}", ratios)] if ratios else []
    tables = [table("Parameters", PARAMETER_COLUMNS, parameter_rows(found))]
    tables += [table(f"Errors on {found.judged_on}", CHANNEL_COLUMNS, channel_rows(found))] if ratios else []
    return {
        "kind": "report",
        "version": __version__,
        "name": f"{found.source}: {found.estimator}",
        "title": "Tuning" if found.is_better else "Tuning: no better than by chance, keep the present one",
        "facts": [f"sought on {found.trained_on}", f"judged on {found.judged_on}", f"{number(found.duration_s)} s"],
        "truth": "before",
        "axis": {"name": "Generation", "unit": "", "whole": True},
        "legend": [{"name": "best of a population"}, {"name": "median of a population"}],
        "tables": tables,
        "explained": [f"{sentence}." for sentence in sentences(found)],
        "notes": list(found.notes),
        "sections": [
            section("Before and after", changes, columns=2),
            section("The search", [_history(found, pool)], columns=1),
        ],
        "arrays": pool.as_json(),
    }


def _history(found: Tuning, pool: Pool) -> dict[str, Any]:
    generations = np.arange(1.0, len(found.history) + 1)
    panel = TimePanel(pool, f"Objective on {found.trained_on}", "1", generations)
    panel.curve(TRUTH_GROUP, np.full(len(generations), found.start))
    for group in (1, 0):
        panel.curve(group, found.history[:, group])
    return panel.as_json()
