"""Measure whether the filters' errors are as large as their covariances say; `make consistency` prints the table.

    python tools/consistency.py                       all cases, some minutes
    python tools/consistency.py fusion --write        those of one estimator, into docs/consistency.md; other rows stay

For each case the normalised estimation error squared (NEES) e^T P^-1 e is averaged over the runs at every recorded
time. If the errors have the stated covariance, the mean times the number of runs is chi-square distributed with
(degrees of freedom) x (runs) degrees of freedom, and lies within its 95 % bounds 95 % of the time.  Errors are
correlated in time, so the share found in one table scatters.  For estimators that state standard deviations but no
covariance, the sum of (error / sigma)^2 over roll, pitch and heading is used instead.

Bar-Shalom, Li, Kirubarajan (2001), section 5.4.2.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import estimators
from insenv.reproduce.ecef import laboratory
from insenv.scenario import Scenario, load
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.model import measured_model
from insenv.studies.campaign.plan import make_plan

Array = NDArray[np.float64]

RUNS = 56
LEVEL = 0.95
FIRST_SEED = 5000  # no filter was tuned on these seeds
MODELLED = {
    f"{triad}_{error}": 0.0
    for triad, error in (
        ("gyro", "scale_factor_sigma_ppm"), ("accel", "scale_factor_sigma_ppm"), ("gyro", "misalignment_sigma_urad"),
        ("accel", "misalignment_sigma_urad"), ("gyro", "g_sensitivity_deg_h_g"),
    )
}  # fmt: skip
"""Removes the sensor errors that grow with the motion; those that the 15-state error model describes remain."""


@dataclass(frozen=True)
class Case:
    """One filter on one scenario.

    what: description for the table.
    scenario: makes the scenario.
    from_s: time from which the filter counts as converged.
    duration_s: duration of a run; None: the scenario's.
    runs: number of seeds.
    """

    what: str
    estimator: str
    scenario: Callable[[], Scenario]
    from_s: float
    duration_s: float | None = None
    runs: int = RUNS


@dataclass(frozen=True)
class CaseResult:
    """The NEES of a case.

    time (records,) s, starting at the case's `from_s`; nees (runs, records); degrees: degrees of freedom of one value.
    """

    case: Case
    time: Array
    nees: Array
    degrees: int

    @property
    def mean(self) -> Array:
        """Mean NEES over the runs at each time, divided by the degrees of freedom: 1 for a consistent filter."""
        return np.asarray(self.nees.mean(axis=0) / self.degrees)

    @property
    def bounds(self) -> tuple[float, float]:
        """The 95 % bounds of `mean`."""
        return bounds(self.degrees, len(self.nees))

    @property
    def inside(self) -> float:
        """Share of the recorded times at which the mean lies within the bounds."""
        low, high = self.bounds
        return float(np.mean((self.mean > low) & (self.mean < high)))


def bounds(degrees: int, runs: int, level: float = LEVEL) -> tuple[float, float]:
    """Two-sided bounds of the mean over `runs` of a chi-square variable, divided by its degrees of freedom."""
    from scipy.stats import chi2

    low, high = chi2.ppf([(1 - level) / 2, (1 + level) / 2], degrees * runs) / (degrees * runs)
    return float(low), float(high)


def measure(case: Case, runs: int | None = None, first_seed: int = FIRST_SEED) -> CaseResult:
    """Run a case over `runs` seeds; None: those of the case."""
    runs = case.runs if runs is None else runs
    plan = make_plan(case.scenario(), case.estimator, runs, first_seed=first_seed, duration_s=case.duration_s)
    blocks = [run_block(plan, number) for number in range(len(plan.blocks))]
    degrees = measured_model(plan.plant.model, estimators.get(case.estimator)).degrees
    if degrees:
        nees = np.concatenate([block["nees"] for block in blocks])
    else:
        degrees = 3
        error, sigma = (np.concatenate([block[name] for block in blocks])[..., :3] for name in ("error", "sigma"))
        nees = np.sum((error / sigma) ** 2, axis=-1)
    late = plan.times >= case.from_s
    return CaseResult(case, plan.times[late], nees[:, late], degrees)


def changed(
    name: str,
    imu: Mapping[str, Any] | None = None,
    gnss: Mapping[str, Any] | None = None,
    tuning: Mapping[str, Mapping[str, Any]] | None = None,
) -> Scenario:
    """A scenario with other values in [imu] and [gnss] and another tuning of estimators."""
    loaded = load(name)
    update: dict[str, Any] = {"imu": loaded.imu.model_copy(update=imu or {})}
    if gnss and loaded.gnss is not None:
        update["gnss"] = loaded.gnss.model_copy(update=gnss)
    if tuning is not None:
        update["estimator"] = {**loaded.estimator, **tuning}
    return loaded.model_copy(update=update)


ID = "loosely-coupled"
RTK = {"grade": "rtk", "outlier_probability": 0.0}
MODELS_WANDER: Mapping[str, Any] = {"fix_wander_sigma_m": [1.5, 1.5, 3.05], "fix_wander_time_s": 60.0, "standing_window_s": 0.0}
IGNORES_WANDER: Mapping[str, Any] = {"fix_wander_sigma_m": [0.0, 0.0, 0.0], "standing_window_s": 0.0}


def _city(imu: Mapping[str, Any] | None, gnss: Mapping[str, Any] | None, tuning: Mapping[str, Any]) -> Callable[[], Scenario]:
    return lambda: changed("car-city-drive", imu, gnss, {ID: tuning})


def _named(name: str) -> Callable[[], Scenario]:
    return lambda: load(name)


WHITE_FIXES = Case("city drive, modelled errors only, white fixes", ID, _city(MODELLED, RTK, IGNORES_WANDER), 60.0)
WANDER_MODELLED = Case("the same, wandering fixes, modelled by the filter", ID, _city(MODELLED, None, MODELS_WANDER), 60.0)
WANDER_IGNORED = Case("the same, not modelled by the filter", ID, _city(MODELLED, None, IGNORES_WANDER), 60.0)

FUSION = {
    "car-city-drive": 60.0,
    "car-odometer": 60.0,
    "car-survey": 300.0,
    "car-unknown-receiver": 100.0,
    "multirotor-hover": 60.0,
    "ship-dvl": 60.0,
}
"""Scenarios of `fusion` with states and aids of its presets, and the times from which it counts as converged, s."""
CASES: tuple[Case, ...] = (
    Case("laboratory, at rest", "ecef-kf", laboratory, 120.0),
    Case("ship-swaying", "q-method", _named("ship-swaying"), 150.0),
    Case("ship-swaying", "qakf", _named("ship-swaying"), 150.0),
    Case("ship-swaying", "qakf-improved", _named("ship-swaying"), 150.0),
    Case("ship-swaying", "inertial-fir", _named("ship-swaying"), 200.0),
    Case("ship-swaying", "gyrocompass", _named("ship-swaying"), 250.0),
    WHITE_FIXES,
    WANDER_MODELLED,
    WANDER_IGNORED,
    Case("city drive, unchanged", ID, _named("car-city-drive"), 60.0),
    Case("large-misalignment", "aqe-sukf", _named("large-misalignment"), 60.0),
    Case("large-misalignment-extreme", "aqe-sukf", _named("large-misalignment-extreme"), 60.0),
    Case("large-misalignment", "aqe-ekf", _named("large-misalignment"), 60.0),
    *(Case(name, "fusion", _named(name), from_s, runs=64) for name, from_s in FUSION.items()),
)
"""The cases that `make consistency` measures."""


def row(found: CaseResult) -> str:
    """A line of the table in Markdown."""
    low, high = found.bounds
    return (
        f"| {found.case.estimator} | {found.case.what} | {len(found.nees)} | {found.case.from_s:g} s | {found.degrees} | "
        f"{100 * found.inside:.0f} % | {found.mean.mean():.2f} | {found.mean.min():.2f} - {found.mean.max():.2f} | "
        f"{low:.2f} - {high:.2f} |"
    )


HEADER = "\n".join((
    "| estimator | case | seeds | from | states | time inside | mean NEES / states | range in time | 95 % bounds |",
    "|---" * 9 + "|",
))  # fmt: skip
PAGE = Path(__file__).parents[1] / "docs" / "consistency.md"
BEGIN, END = "<!-- begin nees -->\n", "<!-- end nees -->"


def write(found: CaseResult, page: Path = PAGE) -> None:
    """Put a row into the table of the page, in the place of that of the same case, in the order of `CASES`."""
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    old, after = rest.split(END)
    table = {_key(line): line for line in (*old.splitlines(), row(found)) if line.count("|") == 10}
    keys = ((case.estimator, case.what) for case in CASES)
    lines = [table[key] for key in keys if key in table]
    page.write_text("\n".join([before + BEGIN.rstrip(), "", HEADER, *lines, "", END + after]), encoding="utf-8")


def _key(line: str) -> tuple[str, str]:
    estimator, what = (cell.strip() for cell in line.split("|")[1:3])
    return estimator, what


def main(arguments: list[str] | None = None) -> None:
    """Measure the cases of these estimators (all, if none is named), and print their rows as they come."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("estimators", nargs="*", help="all, if none is named")
    parser.add_argument("--write", action="store_true", help="write the rows into docs/consistency.md")
    given = parser.parse_args(arguments)
    print(HEADER)
    for case in CASES:
        if given.estimators and case.estimator not in given.estimators:
            continue
        found = measure(case)
        print(row(found), flush=True)
        if given.write:
            write(found)


if __name__ == "__main__":
    main()
