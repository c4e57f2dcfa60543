"""Accuracy of every estimator where it is meant to work, over many seeds: the tables on the pages of docs/estimators.

    python tools/accuracy.py                all pairs, some minutes
    python tools/accuracy.py q-method       those of one estimator; the rows of the others are kept

The rows are kept in `tests/estimators/accuracy.json`; `python tools/pages.py` writes the tables from them. A row is an
estimator on a scenario: at the end of the run the root mean square of the errors over the runs, that of the stated standard
deviations, and the limit; and the share of all errors, over runs and recorded times, beyond three stated standard deviations.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import insenv
from insenv.evaluation.errors import CHANNELS
from insenv.scenario import load, parse
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import Plan, make_plan

TABLE = Path(__file__).parents[1] / "tests" / "estimators" / "accuracy.json"
FIRST_SEED, RUNS = 7000, 64
"""No estimator was tuned on these seeds."""
DIGITS = 3
BEYOND = 3.0


@dataclass(frozen=True)
class Case:
    """An estimator on a scenario, for `duration_s` seconds (None: those of the scenario), with settings of the estimator."""

    estimator: str
    scenario: str
    duration_s: float | None = None
    settings: tuple[tuple[str, Any], ...] = ()

    @property
    def label(self) -> str:
        """Scenario and settings, as a table shows them."""
        return ", ".join([self.scenario, *(f"`{key} = {value:g}`" for key, value in self.settings)])


IN_PLACE = ("static-ecef", "car-parked", "aircraft-parked", "ship-swaying", "ship-irregular-sea", "ship-moored-paper")
MOVING = ("car-city-drive", "ship-underway", "aircraft-survey")
PRINTED_QAKF = ("qakf-printed", "qakf-improved-printed")
FAR = ("car-unknown-heading", "aircraft-inflight-alignment")
LARGE = ("large-misalignment", "large-misalignment-extreme", "aircraft-inflight-alignment", "car-unknown-heading")
CASES = (
    *(Case("fusion", name) for name in ("car-city-drive", "car-survey", *FAR, "ship-at-sea", "ship-log-alignment")),
    *(Case("fusion", name) for name in ("ship-slow-surge", "ship-irregular-sea")),
    *(Case("analytic", name) for name in ("static-ecef", "car-parked", "aircraft-parked", "ship-swaying")),
    *(Case("gyrocompass", name) for name in ("car-parked-paper", "ship-moored-paper", "ship-irregular-sea")),
    Case("gyrocompass", "ship-irregular-sea", settings=(("heading_constant_s", 100.0),)),
    *(Case("q-method", name) for name in (*IN_PLACE, "turntable-quaternion")),
    *(Case("velocity-integration", name) for name in ("car-unknown-heading", "car-city-drive", "aircraft-inflight-alignment")),
    Case("velocity-integration", "aircraft-survey", 900.0),
    *(Case("velocity-integration", name) for name in ("ship-underway", "ship-at-sea", "ship-log-alignment")),
    *(Case(id, name) for id in ("qakf", "qakf-improved") for name in (*IN_PLACE, "turntable-quaternion")),
    *(Case(id, name) for id in PRINTED_QAKF for name in ("static-ecef", "car-parked", "turntable-quaternion")),
    *(Case("inertial-fir", name) for name in (*IN_PLACE, "car-parked-paper")),
    *(Case("ecef-kf", name) for name in IN_PLACE),
    *(Case("ecef-kf-printed", name) for name in ("static-ecef", "car-parked")),
    Case("ecef-kf", "ship-underway", 300.0, (("moving", 1.0),)),
    Case("ecef-kf", "ship-underway", 900.0, (("moving", 1.0),)),
    *(Case("lssvm", name) for name in LARGE[:2]),
    *(Case(id, name) for id in ("aqe-sukf", "aqe-ekf") for name in LARGE),
    *(Case("aqe-sukf-printed", name) for name in LARGE[:2]),
    *(Case("loosely-coupled", name) for name in MOVING),
    *(Case(id, "aircraft-free-inertial") for id in ("wander-sins", "wander-sins-plain")),
)  # fmt: skip


def plan_of(case: Case, runs: int = RUNS) -> Plan:
    """The campaign of a case."""
    scenario = load(case.scenario)
    if case.settings:
        values = scenario.model_dump(mode="json", warnings=False)
        tuned = values.get("estimator") or {}
        tuned[case.estimator] = {**tuned.get(case.estimator, {}), **dict(case.settings)}
        scenario = parse({**values, "estimator": tuned}, case.scenario, case.scenario)
    return make_plan(scenario, case.estimator, runs, first_seed=FIRST_SEED, duration_s=case.duration_s)


def row(case: Case, runs: int = RUNS) -> dict[str, Any]:
    """A row of the table: root mean squares by channel, as in `CHANNELS`, in the units of those."""
    plan = plan_of(case, runs)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    error = np.concatenate([block["error"] for block in blocks])
    limit = insenv.limit(case.scenario, duration_s=case.duration_s).at(plan.times[-1:])
    found: dict[str, Any] = {
        "estimator": case.estimator,
        "case": case.label,
        "seeds": [FIRST_SEED, FIRST_SEED + runs - 1],
        "at_s": float(plan.times[-1]),
        "rms": _by_channel(np.sqrt(np.mean(error[:, -1] ** 2, axis=0))),
    }
    found["limit"] = {name: _rounded(float(limit[name][-1])) for name in found["rms"] if name in limit}
    if "sigma" in blocks[0]:
        sigma = np.concatenate([block["sigma"] for block in blocks])
        found["stated"] = _by_channel(np.sqrt(np.mean(sigma[:, -1] ** 2, axis=0)))
        found["beyond"] = _by_channel(np.mean(np.abs(error) > BEYOND * sigma, axis=(0, 1)))
    return found


def _by_channel(values: Any) -> dict[str, float]:
    return {name: _rounded(float(value)) for name, value in zip(CHANNELS, values, strict=False)}


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def stored() -> list[dict[str, Any]]:
    """The rows of the table; empty if there is none."""
    return json.loads(TABLE.read_text(encoding="utf-8")) if TABLE.exists() else []


def text(rows: list[dict[str, Any]]) -> str:
    """JSON with one row per line, in the order of `CASES`."""
    order = {(case.estimator, case.label, case.duration_s): k for k, case in enumerate(CASES)}

    def place(found: Mapping[str, Any]) -> int:
        keys = [(found["estimator"], found["case"], at) for at in (found["at_s"], None)]
        return next((order[key] for key in keys if key in order), len(order))

    return "[\n" + ",\n".join(json.dumps(found) for found in sorted(rows, key=place)) + "\n]\n"


def main(ids: list[str]) -> None:
    """Compute the rows of these estimators (of all, if none is named) and write the table."""
    chosen = [case for case in CASES if not ids or case.estimator in ids]
    rows = [found for found in stored() if ids and found["estimator"] not in ids]
    for case in chosen:
        rows.append(row(case))
        print(json.dumps(rows[-1]), flush=True)
        TABLE.write_text(text(rows), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
