"""Generated parts of the pages in docs/estimators: parameters (from the tables of the models) and accuracy (from
tests/estimators/accuracy.json, which ``python tools/accuracy.py`` writes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import accuracy
import numpy as np

from insenv import estimators
from insenv.core.tables import Row
from insenv.estimators import lssvm
from insenv.estimators.contract import Estimator
from insenv.estimators.fusion import ErrorState, available
from insenv.estimators.fusion.error_state import DRIFTING
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.settings import keys_by_row
from insenv.evaluation.errors import ATTITUDE, CHANNELS
from insenv.evaluation.limits import ratio
from insenv.sensors.data_sheet import ImuDataSheet

Markdown = Callable[[Iterable[str], Iterable[Iterable[str]]], str]
Part = Callable[[], str]

ON_PAGE = {
    "analytic": ("analytic",),
    "gyrocompass": ("gyrocompass",),
    "q-method": ("q-method",),
    "velocity-integration": ("velocity-integration",),
    "qakf": ("qakf", "qakf-improved"),
    "qakf-printed": ("qakf-printed", "qakf-improved-printed"),
    "inertial-fir": ("inertial-fir",),
    "ecef-kf": ("ecef-kf",),
    "ecef-kf-printed": ("ecef-kf-printed",),
    "lssvm": ("lssvm",),
    "aqe": ("aqe-sukf", "aqe-ekf"),
    "aqe-sukf-printed": ("aqe-sukf-printed",),
    "loosely-coupled": ("loosely-coupled",),
    "smoother": (),
    "fusion": ("fusion",),
    "wander-sins": ("wander-sins", "wander-sins-plain"),
}
"""By page, the estimators with a table of accuracy."""
PARAMETERS_OF = {page: (ids or (page,))[0] for page, ids in ON_PAGE.items()}
"""By page, the estimator whose parameters it lists."""
FROM_FILE = {"lssvm": lssvm.MACHINE.names}
"""By estimator, parameter rows that come from a file."""
SHOWN_ELEMENTS = 16
"""A row of more elements is not a parameter that a user sets by hand."""

_KNOWN = Knowledge(0.5, 0.5, 10.0, 0.01)
_OTHERWISE = Knowledge(
    -0.6, 0.7, 20.0, 0.02, np.full(3, 1.5), 0.11, 0.12, 0.13, np.full(3, 2.5), np.full(3, 0.7), 0.021, 0.22, np.full(3, 1e-6),
    np.full(3, 1e-3), 1e-6, 0.5, 1e-4, 1e-4, ImuDataSheet(1e-7, 2e-4, 2e-7, 2e-3, 7200.0, 7200.0),
    {"fix_wander_sigma": np.full(3, 0.5), "fix_wander_time": 61.0, "fix_common_sigma": np.full(3, 0.6),
     "antenna_lever_arm": np.full(3, 1.0)},
)  # fmt: skip


def pages(markdown: Markdown) -> dict[str, dict[str, Part]]:
    """By page, its generated parts by name; `markdown` makes a table of a head and rows."""
    found: dict[str, dict[str, Part]] = {
        f"docs/estimators/{page}.md": {
            "parameters": partial(parameters, PARAMETERS_OF[page], markdown),
            **({"accuracy": partial(accuracies, ids, markdown)} if ids else {}),
        }
        for page, ids in ON_PAGE.items()
    }
    found["docs/estimators/fusion.md"] |= {"states": partial(states, markdown), "aids": partial(aids, markdown)}
    return found


# --- states and aids of fusion filters ---------------------------------------------------------------


def states(markdown: Markdown) -> str:
    """The error states by name."""
    owner = {state.name: aid for aid, own in available.states_by_aid().items() for state in own}
    rows = [
        [f"`{name}`", f"{state.size}", state.value.unit, state.value.meaning.removeprefix("Estimated "),
         _shown_by(owner.get(name)), f"`{state.sigma}`", _course(state)]
        for name, state in available.all_states().items()
    ]  # fmt: skip
    return markdown(("state", "size", "SI unit", "what it is", "needs the aid", "sigma at the start", "correlation time"), rows)


def _course(state: ErrorState) -> str:
    """How it changes."""
    if state.name in DRIFTING:
        return f"constant, or `{DRIFTING[state.name].time}`"
    return f"`{state.time}`" if state.time else "constant" if state.process is None else state.process.called


def _shown_by(aid: str | None) -> str:
    return "" if aid is None else f"`{aid}`"


def aids(markdown: Markdown) -> str:
    """The aids by id."""
    rows = [
        [f"`{id}`", aid.title, f"{aid.size}: {aid.what}", ", ".join(f"`[{sensor}]`" for sensor in aid.sensors),
         ", ".join(f"`{row.name}`" for row in aid.parameters)]
        for id, aid in available.all_aids().items()
    ]  # fmt: skip
    return markdown(("aid", "what it is", "components", "section", "parameters"), rows)


# --- parameters --------------------------------------------------------------------------------------


def parameters(id: str, markdown: Markdown) -> str:
    """The parameters of an estimator that a user sets, and the names of those that follow from the start."""
    estimator = estimators.get(id)
    usual, other = estimator.parameters(_KNOWN), estimator.parameters(_OTHERWISE)
    keys = keys_by_row(estimator.model.parameters)
    rows, given = [], []
    from_file = FROM_FILE.get(id, ())
    for row in estimator.model.parameters:
        if row.name in from_file:
            continue
        if row.name not in keys:
            given += [f"`{row.name}`"] if row.size <= SHOWN_ELEMENTS else []
            continue
        if row.size > SHOWN_ELEMENTS:
            continue
        follows = row.name in other and not np.array_equal(usual.get(row.name, row.start), other[row.name])
        default = _source(row.name) if follows else _numbers(usual.get(row.name, row.start))
        shape = f" ({row.size})" if row.shape else ""
        named = ", ".join(f"`{key}`" for key in keys[row.name])
        rows.append([f"`{row.name}`{shape}", row.unit, default, _bounds(row), named, row.meaning])
    how = f"Set by a key in `[estimator.{id}]` of a scenario or log, or by `--set {id}.KEY=VALUE`."
    head = ("row", "SI unit", "default", "allowed, SI", "keys", "meaning")
    table = f"{how}\n\n{markdown(head, rows)}" if rows else "No parameter is set by hand."
    return table + (f"\n\nKnown from the run, not set here: {', '.join(given)}." if given else "")


_START = (
    "position_sigma", "velocity_sigma", "velocity_sigma_start", "tilt_sigma", "heading_sigma", "start_heading_sigma",
)  # fmt: skip


def _source(name: str) -> str:
    """Where a row that has no fixed default comes from."""
    if name == "block_samples":
        return "sample rate"
    if name.startswith(("fix_wander", "fix_common")):
        return "receiver"
    return "start" if name in _START else "data sheet"


def _numbers(value: Any) -> str:
    flat = [f"{number:.4g}" for number in np.ravel(np.asarray(value, dtype=np.float64))]
    return flat[0] if len(set(flat)) == 1 else ", ".join(flat)


_LARGEST = 1e12
"""An upper bound from here on is none for a user."""


def _bounds(row: Row) -> str:
    if row.flag:
        return "0 or 1"
    low = f"from {row.lower:.4g}" if math.isfinite(row.lower) else ""
    high = f"to {row.upper:.4g}" if row.upper < _LARGEST else ""
    return f"{low} {high}".strip() or "any"


# --- accuracy ----------------------------------------------------------------------------------------


def accuracies(ids: Iterable[str], markdown: Markdown) -> str:
    """The rows of `accuracy.TABLE` of these estimators, in one table for each."""
    ids, parts = tuple(ids), []
    for id in ids:
        rows = [found for found in accuracy.stored() if found["estimator"] == id]
        heading = f"`{id}`:\n\n" if len(ids) > 1 else ""
        parts.append(heading + _table(estimators.get(id), rows, markdown))
    return "\n\n".join(parts)


def _table(estimator: Estimator, rows: list[dict[str, Any]], markdown: Markdown) -> str:
    return (_navigation if estimator.navigates else _alignment)(rows, markdown)


def _alignment(rows: list[dict[str, Any]], markdown: Markdown) -> str:
    head = ("scenario", "at", "roll, pitch: rms", "limit", "heading: rms", "stated", "limit", "rms/limit", "beyond 3 sigma")
    lines = []
    for found in rows:
        rms, limit, stated = found["rms"], found["limit"], found["stated"]
        over = ratio(rms["heading_deg"], limit["heading_deg"], "heading_deg")
        level = [_short(math.hypot(of["roll_deg"], of["pitch_deg"]) / math.sqrt(2)) for of in (rms, limit)]
        heading = [_short(of["heading_deg"]) for of in (rms, stated, limit)]
        beyond = f"{_short(100 * max(found['beyond'].values()))} %"
        lines.append([found["case"], f"{found['at_s']:g} s", *level, *heading, _ratio(over), beyond])
    return markdown(head, lines)


def _navigation(rows: list[dict[str, Any]], markdown: Markdown) -> str:
    names = CHANNELS
    units = ["deg" if name in ATTITUDE else name.partition("_")[2].replace("mps", "m/s") for name in names]
    labels = [f"{name.partition('_')[0]}, {unit}" for name, unit in zip(names, units, strict=True)]
    lines = []
    for found in rows:
        begin = [found["case"], f"{found['at_s']:g} s"]
        for kind in ("rms", "stated", "limit"):
            if kind in found:
                lines.append([*begin, kind, *(_short(found[kind][name]) if name in found[kind] else "" for name in names)])
                begin = ["", ""]
        if "beyond" in found:
            lines.append(["", "", "beyond 3 sigma", *(f"{_short(100 * found['beyond'][name])} %" for name in names)])
    return markdown(("scenario", "at", "", *labels), lines)


def _ratio(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}" if value < 10 else f"{value:.0f}"


def _short(value: float) -> str:
    """Two significant digits, without an exponent where there are fewer than five zeros."""
    text = f"{value:.2g}"
    return text if "e-" in text else f"{float(text):g}"
