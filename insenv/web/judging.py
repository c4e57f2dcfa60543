"""What a page needs to judge its estimators as `insenv.run` does: rules, sentences, the limit, the time of the statistics."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np

from insenv.base.remarks import TEXTS
from insenv.core.compile import wasm, wasm_functions
from insenv.core.runner import Progress
from insenv.core.tables import Vector
from insenv.estimators import Estimator, Finding
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation import health, nis
from insenv.evaluation.errors import STEEP, TOO_SURE, statistics_from
from insenv.evaluation.limits import FLOOR, Limit
from insenv.report.tables import columns_of
from insenv.scenario import Plant, limit_of, no_limit
from insenv.web.model import Member

LIMIT_TIMES = 300
"""Number of times at which the limit is shown."""
SAID = (
    "no-fix",
    "no-fix-but-aids",
    "fixes-diverged",
    "fixes-overconfident",
    "fixes-slow-errors",
    "fixes-count-less",
    "aid-misfit",
    "steep-pitch",
    "too-sure",
)
"""Remarks that a page says by itself."""


def rule(groups: int) -> dict[str, Any]:
    """What web/health.js and web/judge.js judge with: figures and sentences of `insenv.evaluation`, and its rule compiled.

    groups: the largest number of groups of components of an instrument of the page; 0: no estimator tells its health.
    """
    source = wasm_functions({"judge": nis.equation(groups)}, "el") if groups else ""
    return {
        "wasm": base64.b64encode(wasm(source)).decode() if source else None,
        "groups": groups,
        "sentences": {
            **health.LINES,
            "or-aids": health.OR_AIDS,
            "causes": health.CAUSES,
            **{code: TEXTS[code] for code in SAID},
        },
        "too_sure": TOO_SURE,
        "larger": health.LARGER,
        "steep": STEEP,
        "blocks": nis.BLOCKS,
        "notable": nis.NOTABLE,
        "last": nis.LATE_SHARE,
        "verdicts": nis.VERDICTS,
        "wrong": nis.WRONG,
    }


def health_rows(estimator: Estimator, parameters: Mapping[str, Any]) -> dict[str, Any] | None:
    """The outputs that tell its health: of fixes (None: it takes none) and of aids by id; None if it tells none.

    With them, what its notes need: whether it models slow errors with these parameters (by row name), and without estimating
    them; causes by id of an aid.
    """
    if not estimator.reports_health:
        return None
    aids = {id: aid_health(id) for id in reported_aids(estimator.model.outputs.names)}
    fixes = FIX_HEALTH.names if estimator.reports_fixes else None
    slow, less = health.models_slow_errors(parameters), health.counts_fixes_less(parameters, estimator.model.outputs.names)
    return {"fixes": fixes, "aids": aids, "slow": slow, "less": less, "causes": dict(estimator.causes)}


def groups_of(estimator: Estimator) -> int:
    """The largest number of groups of components of its instruments; 0 if it does not tell its health."""
    return max((row.size for row in estimator.health_rows if row.name.endswith("nis_used")), default=0)


def findings(estimator: Estimator, parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What the end of its run may show with these parameters (by row name): of a row's elements place, middle and scale."""
    listed = []
    for finding in estimator.to_find(parameters):
        if not isinstance(finding, Finding):
            continue
        row = estimator.model.outputs[finding.row]
        about, scale = (np.broadcast_to(values, (row.size,)).tolist() for values in (finding.about, finding.scale))
        elements = [one for one in zip(range(row.size), about, scale, strict=True) if np.isfinite(one[2])]
        listed.append({"row": finding.row, "elements": elements, "limit": finding.limit, "sentence": finding.sentence})
    return listed


def judged(member: Member, plant: Plant, every: int, limit: Limit | None) -> dict[str, Any]:
    """Start of its statistics, the limit over their time by channel, and the columns of its table, as `insenv.run` prints them.

    columns: of the scenario as prepared, and of one that is changed, whose limit is unknown.
    """
    times = np.arange(1, plant.samples // every + 1, dtype=np.float64) * (every * plant.sample_interval)
    from_s = statistics_from(member.estimator.navigates, float(times[-1]))
    over_time = {} if limit is None else limit.rms(times, from_s)
    limits = {name: value for name, value in over_time.items() if name in member.channels}
    stated = bool(member.stated)
    columns = {"prepared": columns_of(stated, bool(limits)), "changed": columns_of(stated, False)}
    return {"from_s": from_s, "limit": limits, "columns": columns}


def limit_along(plain: Plant, progress: Progress | None) -> Limit | None:
    """The limit of the scenario as it stands; None if there is none."""
    return None if no_limit(plain) else limit_of(plain, progress)


def limit_document(limit: Limit | None, duration_s: float) -> dict[str, Any] | None:
    """Its course by channel."""
    if limit is None:
        return None
    times = np.linspace(0.0, duration_s, LIMIT_TIMES + 1)[1:]
    course = limit.at(times)
    sigma = {name: _rounded(values) for name, values in course.items()}
    return {"time_s": _rounded(times), "sigma": sigma, "floor": {name: FLOOR[name] for name in course}}


def _rounded(values: Vector) -> list[float]:
    return [float(f"{value:.6g}") for value in values]
