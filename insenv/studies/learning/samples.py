"""Training samples: the inputs of `lssvm` and the result of `aqe-sukf` on the same simulated measurements.

The SINS runs unaided from its initial attitude.  In operation the machine meets misalignments of every size, from the
initial one down to zero.  The initial errors are therefore drawn with the sigmas of the scenario times one of `SHARES`;
the filter is always given the full sigmas, because the machine will not know more.

De-noising: LS-SVM large misalignment paper, section 4: five levels, high-frequency coefficients set to 0, noisy
coefficients of lower frequency reduced by a soft threshold.  Interpretation here: the details of the finest `DROPPED`
levels are set to 0; the others are reduced by Donoho's universal threshold, s sqrt(2 ln n), with s from the median of
the finest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.estimators.lssvm import FEATURES, SUPPORT
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.scenario import Scenario

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
