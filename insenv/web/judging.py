"""What a page needs to judge its estimators as `insenv.run` does: rules, sentences, the limit, the time of the statistics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from insenv.core.runner import Progress
from insenv.core.tables import Vector
from insenv.estimators import Estimator
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation import nis, sentences
from insenv.evaluation.chi_square import bound_polynomial
from insenv.evaluation.errors import STEEP, TOO_SURE, statistics_from
from insenv.evaluation.health import models_slow_errors
from insenv.evaluation.limits import FLOOR, Limit
from insenv.report.tables import columns_of
from insenv.scenario import Plant, limit_of, no_limit
from insenv.web.model import Member

LIMIT_TIMES = 300
"""Number of times at which the limit is shown."""


def rule() -> dict[str, Any]:
    """The figures and sentences of `insenv.evaluation`, with which web/health.js and web/judge.js judge."""
    return {
        "sentences": {name.lower(): text for name, text in vars(sentences).items() if name.isupper() and name[0] != "_"},
        "too_sure": TOO_SURE,
        "steep": STEEP,
        "bounds": [bound_polynomial(probability) for probability in nis.PROBABILITIES],
        "blocks": nis.BLOCKS,
        "notable": nis.NOTABLE,
        "many": nis.MANY,
        "most": nis.MOST,
        "apart": nis.APART,
        "last": nis.LAST,
        "fewest": nis.FEWEST,
        "verdicts": nis.VERDICTS,
        "wrong": nis.WRONG,
    }


def health_rows(estimator: Estimator, parameters: Mapping[str, Any]) -> dict[str, Any] | None:
    """The outputs that tell its health: of fixes (None: it takes none) and of aids by id; None if it tells none.

    With them, what its notes need: whether it models slow errors with these parameters (by row name); causes by id of an aid.
    """
    if not estimator.reports_health:
        return None
    aids = {id: aid_health(id) for id in reported_aids(estimator.model.outputs.names)}
    fixes = FIX_HEALTH.names if estimator.reports_fixes else None
    return {"fixes": fixes, "aids": aids, "slow": models_slow_errors(parameters), "causes": dict(estimator.causes)}


def findings(estimator: Estimator, parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What the end of its run may show with these parameters (by row name): of a row's elements place, middle and scale."""
    found = []
    for finding in estimator.to_find(parameters):
        row = estimator.model.outputs[finding.row]
        about, scale = (np.broadcast_to(values, (row.size,)).tolist() for values in (finding.about, finding.scale))
        elements = [one for one in zip(range(row.size), about, scale, strict=True) if np.isfinite(one[2])]
        found.append({"row": finding.row, "elements": elements, "limit": finding.limit, "sentence": finding.sentence})
    return found


def judged(member: Member, plant: Plant, every: int, limit: Limit | None) -> dict[str, Any]:
    """Start of its statistics, the limit over their time by channel, and the columns of its table, as `insenv.run` prints them.

    columns: of the scenario as prepared, and of one that is changed, whose limit is unknown.
    """
    times = np.arange(1, plant.samples // every + 1, dtype=np.float64) * (every * plant.sample_interval)
    from_s = statistics_from(member.estimator.navigates, float(times[-1]))
    found = {} if limit is None else limit.rms(times, from_s)
    limits = {name: value for name, value in found.items() if name in member.channels}
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
    found = limit.at(times)
    sigma = {name: _rounded(values) for name, values in found.items()}
    return {"time_s": _rounded(times), "sigma": sigma, "floor": {name: FLOOR[name] for name in found}}


def _rounded(values: Vector) -> list[float]:
    return [float(f"{value:.6g}") for value in values]
