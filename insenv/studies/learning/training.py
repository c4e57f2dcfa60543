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
from numpy.typing import NDArray

from insenv import attitude
from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.base.shipped import __version__
from insenv.core.runner import check_progress
from insenv.core.tables import Array
from insenv.estimators.lssvm import FEATURES, SUPPORT, TrainedMachine
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.scenario import Scenario, load

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


# Training samples: the inputs of `lssvm` and the result of `aqe-sukf` on the same simulated measurements.
#
# The SINS runs unaided from its initial attitude.  In operation the machine meets misalignments of every size, from the
# initial one down to zero.  The initial errors are therefore drawn with the sigmas of the scenario times one of `SHARES`;
# the filter is always given the full sigmas, because the machine will not know more.
#
# De-noising: LS-SVM large misalignment paper, section 4: five levels, high-frequency coefficients set to 0, noisy
# coefficients of lower frequency reduced by a soft threshold.  Interpretation here: the details of the finest `DROPPED`
# levels are set to 0; the others are reduced by Donoho's universal threshold, s sqrt(2 ln n), with s from the median of
# the finest.

FILTER = "aqe-sukf"
SHARES = (1.0, 0.3, 0.1, 0.03, 0.0)
TIMES = 24
"""Samples per run, evenly spaced at a random phase over the time in which the heading is observable."""
WAVELET, LEVELS, DROPPED = "db4", 5, 3
ASTRAY_DEG = 5.0
"""A run whose filter ends further than this from the truth is not used."""
SETTLED_DEG = 1.0
"""Samples are taken from the time from which the filter stays this close to its final value."""
EMPTY = {
    "support": np.zeros((SUPPORT, FEATURES)),
    "coefficients": np.zeros((SUPPORT, 3)),
    "offset": np.zeros(3),
    "scale": np.zeros(FEATURES),
    "machine_sigma": np.zeros(3),
    "raw_inputs": 0.0,
}


@dataclass(frozen=True)
class Samples:
    """Training samples.

    inputs (n, 6) and outputs (n, 3, rad) of the machine; angle (n,): size of the misalignment, rad; run (n,): number of
    the run of each sample; runs: number of runs; astray: number of runs left out because the filter ended more than
    `ASTRAY_DEG` from the truth.
    """

    inputs: Array
    outputs: Array
    angle: Array
    run: NDArray[np.int64]
    runs: int
    astray: int


def collect(
    scenarios: Sequence[Scenario],
    seeds: Sequence[int],
    duration_s: float | None,
    progress: Callable[[int, int], None] | None,
    raw_inputs: int = 0,
) -> Samples:
    """Collect samples from every scenario and seed; seed number k starts with share k modulo the number of shares.

    raw_inputs: as in the file of a machine; the outputs are then the angles (rotation vector).

    Raises `InputError` for a scenario in which the filter cannot work, or if fewer than two runs are usable.
    """
    runs: list[tuple[Array, Array]] = []  # inputs and misalignment quaternions of each run
    work = [
        (scenario, share, seeds[place :: len(SHARES)])
        for scenario in scenarios
        for place, share in enumerate(SHARES[: len(seeds)])
    ]
    for scenario in scenarios:
        if scenario.gnss is None:
            raise InputError(f"scenario {scenario.name!r} has no [gnss]: {FILTER} and lssvm need it")
        if not scenario.vehicle.in_place:
            raise InputError(f"scenario {scenario.name!r} moves: lssvm is for a vehicle that stays in place")
    for done, (scenario, share, chosen) in enumerate(work, 1):
        runs += _runs(scenario, share, chosen, duration_s, raw_inputs)
        if progress is not None:
            progress(done, len(work))
    if len(runs) < 2:
        raise InputError(f"training needs at least two runs in which {FILTER} finds the attitude: there are {len(runs)}")
    inputs, misalignment = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    return Samples(
        inputs,
        attitude.numeric.to_rotation_vector(misalignment) if raw_inputs else sine_vector(misalignment),
        2 * np.arcsin(np.minimum(np.linalg.norm(misalignment[:, 1:], axis=1), 1.0)),
        np.repeat(np.arange(len(runs)), [len(rows) for rows, _ in runs]),
        len(runs),
        len(scenarios) * len(seeds) - len(runs),
    )


def _runs(
    scenario: Scenario, share: float, seeds: Sequence[int], duration_s: float | None, raw_inputs: int
) -> list[tuple[Array, Array]]:
    """Inputs and misalignment quaternions of each run whose filter does not end astray."""
    known = scenario.knowledge
    drawn = dict.fromkeys(("roll_error_deg", "pitch_error_deg", "heading_error_deg"), None if share else 0.0)
    sigmas = {name: getattr(known, name) * (share or 1.0) for name in ("tilt_sigma_deg", "heading_sigma_deg")}
    knowledge = known.model_copy(update={**drawn, **sigmas})
    whole = {name: np.radians(getattr(known, f"{name}_deg")) for name in ("tilt_sigma", "heading_sigma")}
    seconds = scenario.duration_s if duration_s is None else duration_s
    run = ensemble(
        scenario.model_copy(update={"knowledge": knowledge}),
        [FILTER, "lssvm"],
        seeds,
        duration_s=duration_s,
        records=max(2, round(seconds)),
        tuning={FILTER: whole, "lssvm": {**EMPTY, "raw_inputs": float(raw_inputs)}},
    )
    last = run.attitude_errors_deg(FILTER)[:, -1]
    return [_samples(run, row, seed) for row, seed in enumerate(seeds) if np.abs(last[row]).max() <= ASTRAY_DEG]


def _samples(run: Ensemble, row: int, seed: int) -> tuple[Array, Array]:
    sins, teacher = run.outputs["lssvm"], run.outputs[FILTER]
    errors = run.attitude_errors_deg(FILTER)[row]
    moving = np.abs(errors - errors[-1]).max(axis=1) > SETTLED_DEG
    unready = (sins["ready"][row] == 0) | moving
    ready = np.arange(len(unready) - int(np.argmax(unready[::-1])) if unready.any() else 0, len(unready))
    if len(ready) < TIMES:
        raise InputError(
            f"{len(ready)} s of {run.time[-1]:g} s in which {FILTER} has settled: allowed are {TIMES} s and more; a longer run"
        )
    misalignment = smooth_misalignment(sins["q_nb"][row, ready], teacher["q_nb"][row, ready])
    phase = np.random.default_rng(seed).uniform()
    places = ((np.arange(TIMES) + phase) * len(ready) / TIMES).astype(int)
    return sins["features"][row, ready][places], misalignment[places]


def smooth_misalignment(q_sins: Array, q_filter: Array) -> Array:
    """Misalignment of the SINS according to the filter (n, 4): q_sins times the inverse of q_filter, de-noised.

    De-noising acts on the rotation vectors from the last value.
    """
    numeric = attitude.numeric
    raw = numeric.multiply(q_sins, numeric.conjugate(q_filter))
    last = raw[-1]
    away = numeric.to_rotation_vector(numeric.multiply(raw, numeric.conjugate(last)))
    return numeric.multiply(numeric.from_rotation_vector(denoised(away)), last)


def sine_vector(q: Array) -> Array:
    """Axis times sine of the angle (n, 3) of rotations (n, 4): the vector of (R - R^T) / 2."""
    return 2 * q[:, :1] * q[:, 1:]


def denoised(signal: Array) -> Array:
    """The signal (n, ...) de-noised along its first axis; a short signal uses fewer wavelet levels."""
    import pywt

    signal = np.asarray(signal, dtype=np.float64)
    levels = min(LEVELS, pywt.dwt_max_level(len(signal), pywt.Wavelet(WAVELET).dec_len))
    if levels < 1:
        return signal.copy()
    parts = pywt.wavedec(signal, WAVELET, mode="smooth", level=levels, axis=0)
    noise = np.median(np.abs(parts[-1]), axis=0) / 0.6745
    threshold = noise * np.sqrt(2 * np.log(len(signal)))
    for place in range(1, len(parts)):
        if place > levels - DROPPED:
            parts[place] = np.zeros_like(parts[place])
        else:
            parts[place] = np.sign(parts[place]) * np.maximum(np.abs(parts[place]) - threshold, 0.0)
    return pywt.waverec(parts, WAVELET, mode="smooth", axis=0)[: len(signal)]
