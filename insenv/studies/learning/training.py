"""Training of `lssvm`: samples, cross-validation over kernel width and weight of the errors, the machine.

Errors are weighted relative to the misalignment: a tenth of a degree does not matter at 60 degrees, which the loop
leaves within a second, but matters near zero, where it ends.  The weight of a sample is therefore 1 / (angle^2 +
FLOOR^2), in training and in the score. A fold contains whole runs; the samples of one run are never split between
folds.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.shipped import __version__
from insenv.core.runner import check_progress
from insenv.core.tables import Array
from insenv.estimators.lssvm import SUPPORT, TrainedMachine
from insenv.scenario import Scenario, load
from insenv.studies.learning.samples import FILTER, SHARES, Samples, collect

GAMMAS = (1e2, 1e3, 1e4, 1e5, 1e6)
SIGMAS = (1.0, 2.0, 4.0)
FOLDS = 4
FLOOR = 0.005
"""rad; misalignments well below it have equal weight."""
SMALL = 0.02
"""rad; misalignments up to this size determine the stated scatter of the machine, that of the settled loop."""
DIGITS = 12
"""Digits kept of the trained numbers, so that they do not depend on the last bits of the linear algebra."""
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Choice:
    """Candidates for the kernel width and the weight of the errors, the number of support vectors, and the inputs."""

    gammas: tuple[float, ...] = GAMMAS
    sigmas: tuple[float, ...] = SIGMAS
    support: int = SUPPORT
    raw_inputs: int = 0


PRINTED = Choice((2 * 15.0,), (math.sqrt(0.2),), raw_inputs=1)
"""The machine as the paper prints it: raw differences, c = 15 (gamma is 2 c), delta^2 = 0.2, inputs over their standard
deviation, samples without weights."""


def train(
    scenarios: Sequence[str | Scenario],
    seeds: Sequence[int],
    *,
    duration_s: float | None = None,
    choice: Choice | None = None,
    progress: Progress | None = None,
) -> TrainedMachine:
    """Train a machine on runs of `aqe-sukf`: every scenario (name, path or object) with every seed.

    Raises `InputError` for unsuitable scenarios or too few seeds, or if scikit-learn or PyWavelets is not
    installed.
    """
    check_progress(progress, ("work", "done", "total"))
    need_packages()
    choice = choice or Choice()
    loaded = [load(scenario) for scenario in scenarios]
    if not loaded:
        raise InputError("training needs a scenario")
    if len(seeds) < len(SHARES):
        raise InputError(
            f"training needs at least {len(SHARES)} seeds, one for each size of initial error: there are {len(seeds)}"
        )
    if duration_s is not None and not np.isfinite(duration_s):
        raise InputError(f"duration_s = {duration_s:g} s: allowed is a finite number")
    if not 1 <= choice.support <= SUPPORT:
        raise InputError(f"support = {choice.support}: allowed is from 1 to {SUPPORT}")

    def reporter(work: str) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, total: progress(work, done, total)

    samples = collect(loaded, seeds, duration_s, reporter("simulating"), choice.raw_inputs)
    weights = np.ones(len(samples.angle)) if choice.raw_inputs else relative_weights(samples.angle)
    size = samples.inputs.std(axis=0) if choice.raw_inputs else np.ones(samples.inputs.shape[1])
    samples = replace(samples, inputs=samples.inputs / size)
    from threadpoolctl import threadpool_limits  # comes with scikit-learn

    with threadpool_limits(1):  # the matrices are small, and sums must not depend on the number of cores
        search, held_out = _search(samples, weights, choice, reporter("learning"))
    best = search.best_estimator_
    small = samples.angle < (np.inf if choice.raw_inputs else SMALL)
    scatter = np.sqrt(np.mean(held_out[small if small.any() else slice(None)] ** 2, axis=0))
    training = {
        "filter": FILTER,
        "runs": [
            {
                "scenario": scenario.name or scenario.title,
                "digest": digest(scenario),
                "seeds": [int(seed) for seed in seeds],
                "duration_s": float(scenario.duration_s if duration_s is None else duration_s),
            }
            for scenario in loaded
        ],
        "samples": len(samples.inputs),
        "runs_used": samples.runs,
        "runs_astray": samples.astray,
        "parameters": {"gamma": float(best.gamma), "sigma": float(best.sigma), "support": len(best.support_)},
        "tried": {"gamma": list(choice.gammas), "sigma": list(choice.sigmas)},
        "scores": {
            "folds": search.n_splits_,
            "relative_error": _rounded(np.sqrt(np.mean(np.sum(held_out**2, axis=1) / (samples.angle**2 + FLOOR**2)))),
            "residual_deg": _rounded(np.degrees(scatter)),
            "small_samples": int(small.sum()),
        },
    }
    return TrainedMachine(
        support=_rounded_array(best.support_ / best.sigma),
        coefficients=_rounded_array(best.dual_coef_),
        offset=_rounded_array(best.intercept_),
        scale=_rounded_array(1.0 / (best.sigma * size)) if choice.raw_inputs else np.full(len(size), 1.0 / best.sigma),
        machine_sigma=_rounded_array(scatter),
        training=training,
        insenv=__version__,
        raw_inputs=choice.raw_inputs,
    )


def relative_weights(angle: Array) -> Array:
    """Weights (n) of samples, with mean 1, from the angles of their misalignments (n, rad)."""
    weights = 1.0 / (angle**2 + FLOOR**2)
    return weights / weights.mean()


def digest(scenario: Scenario) -> str:
    """Fingerprint of a scenario: of the values that are not defaults, so that a new optional key changes none."""
    names = {"title", "description", "estimators"}
    text = json.dumps(scenario.model_dump(mode="json", exclude=names, exclude_defaults=True), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def need_packages() -> None:
    """Raise `InputError` if a package that training needs is not installed."""
    for module, package in (("sklearn", "scikit-learn"), ("pywt", "PyWavelets")):
        need("training", module, package=package, extra="ml")


def _search(samples: Samples, weights: Array, choice: Choice, progress: Callable[[int, int], None] | None) -> tuple[Any, Array]:
    """The fitted grid search, and the error (n, 3) of each sample with the machine trained without its run."""
    import sklearn
    from sklearn.metrics import make_scorer
    from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_predict

    from insenv.studies.learning.regressor import LSSVMRegressor

    folds = GroupKFold(n_splits=min(FOLDS, samples.runs))
    total = len(choice.gammas) * len(choice.sigmas) * folds.n_splits
    done = 0

    def relative_square(true: Array, predicted: Array, sample_weight: Array) -> float:
        nonlocal done
        done += 1
        if progress is not None:
            progress(min(done, total), total)
        return float(np.mean(sample_weight * np.sum((predicted - true) ** 2, axis=1)))

    with sklearn.config_context(enable_metadata_routing=True):
        search = GridSearchCV(
            LSSVMRegressor(support=choice.support).set_fit_request(sample_weight=True),
            {"gamma": list(choice.gammas), "sigma": list(choice.sigmas)},
            scoring=make_scorer(relative_square, greater_is_better=False).set_score_request(sample_weight=True),
            cv=folds,
            error_score="raise",
        )
        routed = {"groups": samples.run, "sample_weight": weights}
        search.fit(samples.inputs, samples.outputs, **routed)
        held_out = cross_val_predict(search.best_estimator_, samples.inputs, samples.outputs, cv=folds, params=routed)
    return search, held_out - samples.outputs


def _rounded(value: Any) -> Any:
    """A number, or a list of numbers, rounded to six digits for the reader."""
    return [float(f"{v:.6g}") for v in value] if np.ndim(value) else float(f"{value:.6g}")


def _rounded_array(value: Array) -> Array:
    return np.array([float(f"{v:.{DIGITS}g}") for v in np.ravel(value)]).reshape(np.shape(value))
