"""The LS-SVM large misalignment paper: additive quaternion error, extended and simplified unscented Kalman filter,
LS-SVM.

Published (section 5, figures 2-4): 0.05 deg/h and 50 ug, 600 s, filter interval 1 s; equal levelling for all; steady
heading error of about 0.1 deg with LS-SVM and SUKF and 0.2 deg with EKF; LS-SVM faster than SUKF.  The paper states
neither the initial errors nor the motion nor the GNSS receiver: the scenarios `large-misalignment` and
`large-misalignment-extreme` define them.

An equivalent east drift of 0.05 deg/h causes a heading error of 0.22 deg in a method that does not estimate it.  Both
filters do estimate it, knowing its size, and can be more accurate.  The error of the method itself is measured by
repeating the run, with the same noise, from initial errors within 2 deg, where every linearisation is accurate: the
difference of the two runs is due to the method.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from insenv.core.model import Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.estimators import get, lssvm
from insenv.report.panels import Curve, Picture, TimePanel
from insenv.reproduce import Quantity, limits, rms
from insenv.reproduce.unit_limits import bias_errors_deg
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.scenario import build, limit_of, load
from insenv.scenario.inputs import input_rows

EKF, SUKF, LSSVM = "aqe-ekf", "aqe-sukf", "lssvm"
IDS = (EKF, SUKF, LSSVM)
PRINTED, KALMAN = "aqe-sukf-printed", "loosely-coupled"
"""The printed form of aqe-sukf; the conventional Kalman filter of small angles, without a gate and with the covariance
kept at feedback (`CONVENTIONAL`)."""
CONVENTIONAL = {"innovation_gate": 0.0, "covariance_kept": 1.0}
READINGS: dict[str, dict[str, float]] = {
    "n + kappa = 3": {"point_spread": 3.0},
    "covariance kept at feedback": {"covariance_kept": 1.0},
}
"""What the text leaves open in the printed filter."""
MACHINE = "lssvm-printed"
MACHINES = {
    "differences since the last fix": "lssvm-printed-reset",
    "parameters by cross-validation": "lssvm-printed-validated",
}
"""The LS-SVM on raw differences, and what the text leaves open in it: the machines that insenv ships, by `lssvm.shipped`."""
PRINTED_OF = {SUKF: PRINTED, LSSVM: LSSVM}
"""The printed form of a method, in the runs of `_printed`."""
PUBLISHED = {EKF: 0.2, SUKF: 0.1, LSSVM: 0.1}
STARTS = {"(20, 20, 60) deg": "large-misalignment", "(60, 60, 150) deg": "large-misalignment-extreme"}
SEEDS = 40
DURATION, STEADY = 600.0, 300.0
NEAR = {
    "roll_error_deg": 0.5,
    "pitch_error_deg": 0.5,
    "heading_error_deg": 2.0,
    "tilt_sigma_deg": 0.5,
    "heading_sigma_deg": 2.0,
}
DRAWN = {"roll_error_deg": None, "pitch_error_deg": None, "heading_error_deg": None}
CONDITIONS = (
    "scenarios large-misalignment and large-misalignment-extreme, 100 Hz, 600 s, GNSS at 1 Hz; 0.05 deg/h and 50 ug; "
    "seeds 1 to 40. Judged by the root mean square over the seeds, steady: over 300 to 600 s, beside the limit at the "
    "same times; converged: heading within 1 deg at 600 s"
)
"""Those of all rows."""


def quantities() -> list[Quantity]:
    """The figures of the paper and of insenv; takes some ten seconds on two cores after compilation."""
    rows: list[Quantity] = []
    for start, name in STARTS.items():
        for id in IDS:
            rows += _of_method(id, start, name)
    for start, name in STARTS.items():
        for id in IDS:
            note = "initial errors drawn with these standard deviations; heading within 1 deg at 600 s"
            printed = _converged(_printed(name, drawn=True), PRINTED_OF[id]) if id in PRINTED_OF else None
            share = _converged(_run(name, drawn=True), id)
            rows.append(_row(f"{id}, initial errors drawn with {start}, converged", "%", None, share, printed, None, note))
    for what, id, steps in (
        (SUKF, SUKF, SUKF_STEPS),
        (LSSVM, LSSVM, LSSVM_STEPS),
        (f"{LSSVM}, inference alone", LSSVM, INFER_STEPS),
    ):
        note = "time on this machine, native, one update per second of GNSS: compare ratios"
        rows.append(Quantity(f"{what}, time of a filter update", "us", None, microseconds(id, steps), note=note))
    return rows + _baseline() + _readings()


def _of_method(id: str, start: str, name: str) -> list[Quantity]:
    """The rows of one method from one start, beside those of its printed form."""
    run, other = _run(name), PRINTED_OF.get(id)
    errors, where = _steady(run, id), f"{id} from {start}"
    heading, at_end = errors[..., 2], limit_of(run.plants[0]).sigma["heading_deg"][-1]
    near = _steady(_run("large-misalignment", near=True), id)

    def ours_and_printed(measure: Callable[[Ensemble, str], float]) -> tuple[float, float | None]:
        return measure(run, id), measure(_printed(name), other) if other else None

    def last(run: Ensemble, id: str) -> float:
        return rms(run.attitude_errors_deg(id)[:, -1, 2])

    drift = f"an equivalent east drift that is not estimated causes {rms(bias_errors_deg(run)[:, 2]):.3f} deg"
    level = f"accelerometer biases that are not estimated cause {rms(bias_errors_deg(run)[:, :2]):.4f} deg"
    bias, noise = "systematic, the same for every seed: due to the bias", "between seeds: due to white noise and the method"
    apart = "RMS difference from the same run with initial errors of (0.5, 0.5, 2) deg"
    method = rms(heading - near[..., 2])
    rows = [
        _row(
            f"{where}, steady heading, RMS",
            "deg",
            PUBLISHED[id],
            *ours_and_printed(_steady_heading),
            _heading_limit(run),
            drift,
        ),
        _row(f"{where}, heading at 600 s, RMS", "deg", PUBLISHED[id], *ours_and_printed(last), float(at_end), drift),
        _row(f"{where}, mean over seeds and time", "deg", None, float(np.mean(heading)), None, None, bias),
        _row(f"{where}, standard deviation between seeds", "deg", None, _spread(heading), None, None, noise),
        _row(f"{where}, heading, contribution of the method", "deg", None, method, None, None, apart),
        _row(f"{where}, roll and pitch, RMS", "deg", None, *ours_and_printed(_steady_level), _level_limit(run), level),
    ]
    seconds, until = ours_and_printed(_settled)
    if np.isfinite(seconds):
        until = until if until is not None and np.isfinite(until) else None
        note = "median time from which the error stays below 1 deg"
        rows.append(_row(f"{where}, time to a heading", "s", None, seconds, until, None, note))
    return rows


def _baseline() -> list[Quantity]:
    """The conventional Kalman filter, which the paper compares with and gives no number of."""
    rows, note = [], f"{KALMAN} without its gate and with its covariance kept at feedback: linear in small angles"
    for start, name in STARTS.items():
        run, where = _printed(name), f"Kalman filter of small angles from {start}"
        heading, level = _steady_heading(run, KALMAN), _steady_level(run, KALMAN)
        rows.append(_row(f"{where}, steady heading, RMS", "deg", None, None, heading, _heading_limit(run), note))
        rows.append(_row(f"{where}, roll and pitch, RMS", "deg", None, None, level, _level_limit(run), note))
        label = f"Kalman filter of small angles, initial errors drawn with {start}, converged"
        rows.append(_row(label, "%", None, None, _converged(_printed(name, drawn=True), KALMAN), None, note))
    return rows


def _readings() -> list[Quantity]:
    """The printed filter in other readings."""
    rows = []
    for start, name in STARTS.items():
        for reading in READINGS:
            run, note = _printed(name, reading=reading), "a reading of the printed filter"
            label = f"aqe-sukf from {start}, read with {reading}, steady heading, RMS"
            rows.append(_row(label, "deg", 0.1, None, _steady_heading(run, PRINTED), _heading_limit(run), note))
        for reading, machine in MACHINES.items():
            run, note = _machine(name, machine), "a reading of the LS-SVM on raw differences"
            label, heading, level = f"lssvm from {start}, read with {reading}", _heading_limit(run), _level_limit(run)
            rows.append(_row(f"{label}, steady heading, RMS", "deg", 0.1, None, _steady_heading(run, LSSVM), heading, note))
            rows.append(_row(f"{label}, roll and pitch, RMS", "deg", None, None, _steady_level(run, LSSVM), level, note))
    return rows


def pictures() -> dict[str, Picture]:
    """Figures 2 to 4 of the paper with insenv's methods, and with the printed filters."""
    return {"": _picture(_run, {EKF: 1, SUKF: 0, LSSVM: 2}), "-printed": _picture(_printed, {KALMAN: 3, PRINTED: 4})}


def _picture(runs: Callable[[str], Ensemble], methods: dict[str, int]) -> Picture:
    """Roll, pitch and heading errors of some methods, with the numbers of their colours."""
    grid: list[list[TimePanel]] = [[], [], []]
    for name in STARTS.values():
        run = runs(name)
        level, heading = _level_limit(run), _heading_limit(run)
        for row, (channel, limit) in enumerate((("roll", level), ("pitch", level), ("heading", heading))):
            panel = TimePanel(f"{channel} error", "deg", run.time, wraps=True, linear_to=0.01 if row < 2 else 0.1)
            panel.marks.append(limits(run.time, limit, "theoretical limit, ±1 sigma"))
            for id, group in methods.items():
                panel.marks += [Curve(group, error, "thin", label=id) for error in run.attitude_errors_deg(id)[:8, :, row]]
            grid[row].append(panel)
    title = "Moored boat, 0.05 deg/h and 50 ug, GNSS at 1 Hz, 8 seeds"
    return Picture(title, grid, (), (9.0, 7.0), heads=[f"from {start}" for start in STARTS])


def _row(
    quantity: str, unit: str, published: float | None, ours: float | None, printed: float | None, limit: float | None, note: str
) -> Quantity:
    return Quantity(quantity, unit, published, ours, printed, limit, SEEDS, note)


def _converged(run: Ensemble, id: str) -> float:
    """Share of the runs whose heading is within 1 deg at the end, %."""
    return 100.0 * float(np.mean(np.abs(run.attitude_errors_deg(id)[:, -1, 2]) < 1.0))


@cache
def _printed(name: str, drawn: bool = False, reading: str = "") -> Ensemble:
    """The printed filter and the conventional one over the seeds, recorded every second."""
    scenario = load(name)
    known = scenario.knowledge.model_copy(update=DRAWN if drawn else {})
    ids = (PRINTED,) if reading else (PRINTED, KALMAN, LSSVM)
    tuning = {PRINTED: READINGS.get(reading, {}), KALMAN: CONVENTIONAL, LSSVM: lssvm.shipped(MACHINE).rows(lssvm.SUPPORT)}
    tuning = {id: tuning[id] for id in ids}
    scenario, seeds = scenario.model_copy(update={"knowledge": known}), range(1, SEEDS + 1)
    return ensemble(scenario, ids, seeds, duration_s=DURATION, records=round(DURATION), tuning=tuning)


@cache
def _machine(name: str, machine: str) -> Ensemble:
    """A machine on raw differences over the seeds."""
    tuning = {LSSVM: lssvm.shipped(machine).rows(lssvm.SUPPORT)}
    return ensemble(load(name), (LSSVM,), range(1, SEEDS + 1), duration_s=DURATION, records=round(DURATION), tuning=tuning)


@cache
def _run(name: str, near: bool = False, drawn: bool = False) -> Ensemble:
    """All three methods over the seeds, recorded every second."""
    scenario = load(name)
    update = NEAR if near else DRAWN if drawn else {}
    scenario = scenario.model_copy(update={"knowledge": scenario.knowledge.model_copy(update=update)})
    return ensemble(scenario, IDS, range(1, SEEDS + 1), duration_s=DURATION, records=round(DURATION))


def _steady(run: Ensemble, id: str) -> Array:
    """Attitude errors (seeds, times, 3), degrees, from `STEADY` on."""
    return run.attitude_errors_deg(id)[:, run.time >= STEADY]


def _steady_heading(run: Ensemble, id: str) -> float:
    return rms(_steady(run, id)[..., 2])


def _steady_level(run: Ensemble, id: str) -> float:
    """Of roll and pitch."""
    return rms(_steady(run, id)[..., :2])


def _heading_limit(run: Ensemble) -> float:
    """Limit of the steady heading, deg."""
    return limit_of(run.plants[0]).rms(run.time, STEADY)["heading_deg"]


def _level_limit(run: Ensemble) -> float:
    """Limit of steady roll and pitch, deg, root mean square of both."""
    limit = limit_of(run.plants[0]).rms(run.time, STEADY)
    return rms(np.array([limit["roll_deg"], limit["pitch_deg"]]))


def _spread(heading: Array) -> float:
    return float(np.sqrt(np.mean(np.var(heading, axis=0, ddof=1))))


def _settled(run: Ensemble, id: str) -> float:
    """Median over the seeds of the time from which the heading error stays below 1 deg."""
    wrong = np.abs(run.attitude_errors_deg(id)[..., 2]) >= 1.0
    last = np.where(wrong.any(axis=1), wrong.shape[1] - np.argmax(wrong[:, ::-1], axis=1), 0)
    times = np.r_[run.time, np.inf][last]
    return float(np.median(times))


# Time of one filter update: the steps that run on a fix, without inertial samples, in the native loop.

REPETITIONS = 5
UPDATES = 50_000
WARM_UP_S = 60.0
SUKF_STEPS = ("predict", "gnss")
LSSVM_STEPS = ("fix", "infer")
INFER_STEPS = ("infer",)


def microseconds(id: str, steps: tuple[str, ...]) -> float:
    """Median time (us) of the named steps over repetitions, with the state and fix at the end of a warm-up run."""
    estimator, plant = get(id), build(load("large-misalignment"), duration_s=WARM_UP_S)
    columns = dict(plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples)))
    columns["dt"] = np.full(plant.samples, plant.sample_interval)
    rows = input_rows(estimator.model, columns, plant.samples)
    warm = make_runner(estimator.model, estimator.parameters(plant.knowledge))
    warm.run(plant.samples, rows, 0)
    fix = rows[columns["gnss_valid"] != 0][-1]

    runner = make_runner(_alone(estimator.model, {step: Step(estimator.model.steps[step].function) for step in steps}), warm.p)
    taken = []
    for _ in range(REPETITIONS):
        runner.x[:] = warm.x
        begin = time.process_time()
        runner.run(UPDATES, fix, 0)
        taken.append(time.process_time() - begin)
    return statistics.median(taken) / UPDATES * 1e6


def _alone(model: Model, steps: Mapping[str, Step]) -> Model:
    """The model with only these steps, which run on every advance."""
    return replace(model, id=f"{model.id}-{'-'.join(steps)}", steps=steps)
