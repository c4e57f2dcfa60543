"""What a page needs to judge its estimators as `insenv.run` does: rules, sentences, the limit, the time of the statistics."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from insenv.base.remarks import TEXTS
from insenv.core.compile import wasm, wasm_functions
from insenv.core.runner import Progress
from insenv.core.tables import Vector
from insenv.estimators import Estimator, Finding
from insenv.estimators.parts.finding import departure
from insenv.estimators.parts.rows import FIX_HEALTH, aid_health, reported_aids
from insenv.evaluation import health, nis
from insenv.evaluation.errors import RATIO, larger_error, statistics_from, steep_pitch
from insenv.evaluation.limits import FLOOR, Limit
from insenv.report.tables import columns_of
from insenv.scenario import Plant, limit_of, no_limit
from insenv.web.model import Member

LIMIT_TIMES = 300
"""Number of times at which the limit is shown."""
SAID = ("aid-misfit", "fixes-count-less", "steep-pitch", "too-sure")
"""Remarks that a page says by itself, beside those on fixes."""


def rules(members: Sequence[Member]) -> dict[str, Any]:
    """What web/judge.js judges the estimators of a page with: rules of `insenv.evaluation`, compiled, and their texts.

    wasm: a function of each rule, from its arguments one after the other to the numbers `gives`.  sizes: of its longest
    arguments, of which shorter ones are filled up.
    """
    sizes = {
        "groups": max((row.size for one in members for row in one.estimator.health_rows), default=1),
        "instruments": 1 + max(len(reported_aids(one.estimator.model.outputs.names)) for one in members),
        "elements": max(row.size for one in members for row in one.estimator.model.outputs),
    }
    functions, gives = {}, {}
    for name, (rule, takes) in _compiled(**sizes).items():
        arguments = [ca.SX.sym("a", max(size, 1)) for size in takes]
        numbers = rule(*(one if size else one[0] for one, size in zip(map(_listed, arguments), takes, strict=True)))
        functions[name] = ca.Function(name, [ca.vertcat(*arguments)], [ca.vertcat(*numbers.values())], {"cse": True})
        gives[name] = list(numbers)
    return {
        "wasm": base64.b64encode(wasm(wasm_functions(functions, "a"))).decode(),
        "gives": gives,
        "sizes": sizes,
        "blocks": nis.BLOCKS,
        "late": nis.LATE_SHARE,
        "instrument": health.INSTRUMENT,
        "filter": health.FILTER,
        "or_aids": health.OR_AIDS,
        "fixes": health.FIX_REMARKS,
        "ratio": RATIO,
        **{code: TEXTS[code] for code in SAID},
    }


def _compiled(groups: int, instruments: int, elements: int) -> dict[str, tuple[Callable[..., health.Numbers], list[int]]]:
    """The rules by name, with the sizes of their arguments; 0: one number."""

    def instrument(ends: list[Any], late: list[Any]) -> health.Numbers:
        count, refused = ends[-len(late) :][:2]
        return health.of_instrument(nis.flat(ca.vertcat(*ends), ca.vertcat(*late)), count, refused)

    width = 2 + 4 * groups
    return {
        "instrument": (instrument, [nis.BLOCKS * width, width]),
        "filter": (health.of_filter, [instruments, instruments, 0, 0]),
        "fixes": (health.of_fixes, [0, 0, 0, 0, 0]),
        "counted_less": (health.counted_less, [3, 3]),
        "steep_pitch": (steep_pitch, [0]),
        "larger_error": (larger_error, [0, 0]),
        "departure": (departure, [elements, elements, elements, 0]),
    }


def _listed(symbols: ca.SX) -> list[ca.SX]:
    return [symbols[place] for place in range(symbols.numel())]


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
