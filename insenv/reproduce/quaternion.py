"""The quaternion adaptive-Kalman paper: q-method, qakf and qakf-improved on a turntable, as printed and insenv's own.

Published (section 3.2, figure 4): mean and standard deviation in time of the heading error over 150-200 s of one run
with 200 ug of accelerometer noise: qakf-improved 0.0030 and 0.0032 deg, q-method 0.0050 and 0.0056 deg; figures 1 to 3:
qakf converges far more slowly, and more slowly with more noise.  The numbers of insenv are means over the seeds of each
run's |mean| and standard deviation in time, and are compared with the mean of |mean| that the limit allows; root mean squares
over all are compared with the limit itself.  The published means, of one run each, lie below both.  The plain vectors of the
paper are used (`PLAIN`: no low-pass filter, equal weights at all times), with which the q-method is the paper's own; results
with the default windows of insenv are listed too.

The printed form of the two filters is `qakf-printed` and `qakf-improved-printed`; `READINGS` is what the text leaves open.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array
from insenv.geodesy import NOMINAL_GRAVITY
from insenv.report.panels import TRUTH_GROUP, Curve, Picture, TimePanel
from insenv.reproduce import Quantity, rms
from insenv.reproduce.unit_limits import bias_errors_deg, mean_limit, noise_limit, unit_limit
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.scenario import Scenario, limit_of, load
from insenv.sensors import units
from insenv.vehicles.ship import SwaySection

Measure = Callable[[Ensemble, str], float | None]
"""Of a run and an estimator."""

Q, PLAIN_FILTER, IMPROVED = IDS = ("q-method", "qakf", "qakf-improved")
PRINTED = {Q: Q, PLAIN_FILTER: "qakf-printed", IMPROVED: "qakf-improved-printed"}
"""The printed form of each: the q-method with plain vectors is the paper's."""
FILTERS = (PRINTED[PLAIN_FILTER], PRINTED[IMPROVED])
GRADES = {0: "paper-quaternion-0ug", 50: "paper-quaternion", 100: "paper-quaternion-100ug", 200: "paper-quaternion-200ug"}
PLAIN = {"smoothing_time": 0.0, "memory_time": 1e9}
PUBLISHED = {(200, IMPROVED): (0.0030, 0.0032), (200, Q): (0.0050, 0.0056)}
SEEDS, TEST_SEEDS = 104, 32
BEGIN, REACHED = 150.0, 0.1  # s, deg
AT_50 = 50.0
LARGE_SWAY: dict[
    str, list[dict[str, float]]
] = {  # test 3: centres and frequencies of the paper, amplitudes twice those of its simulation (its table is lost)
    "roll": [{"amplitude_deg": 12.0, "frequency_hz": 0.2}],
    "pitch": [{"amplitude_deg": 16.0, "frequency_hz": 0.15}],
    "yaw": [{"amplitude_deg": 10.0, "frequency_hz": 0.125, "phase_deg": 180.0}],
}
SMALL_SWAY = {  # test 2: half of them
    part: [{**wave, "amplitude_deg": wave["amplitude_deg"] / 4} for wave in waves] for part, waves in LARGE_SWAY.items()
}
TESTS: dict[str, dict[str, list[dict[str, float]]]] = {
    "1, at rest": {},
    "2, small sway": SMALL_SWAY,
    "3, large sway": LARGE_SWAY,
}
TWO_ARCMIN = 2.0 / 60.0  # bound of the paper on the mean of all its tests
READINGS: dict[str, dict[str, float]] = {
    "noise known": {},  # that of the unit
    "b = 0.99": {"forgetting": 0.99},
    "b = 0.95": {"forgetting": 0.95},
    "s = 1": {"subtracted": 1.0},
    "s = 1, noise at least 0.1 ug": {"subtracted": 1.0, "least_noise_sigma": 1e-6},
    "s = 1, noise at least 1 ug": {"subtracted": 1.0, "least_noise_sigma": 1e-5},
}
"""Other readings of the adaptive filter, as parameters of the printed form."""
KNOWN_SHARE = "200 ug, runs with a standard deviation in time of at most 0.0032 deg"
UNIT = {"gyro_bias_sigma_deg_h": 0.006, "gyro_arw_deg_sqrt_h": 0.001, "accel_bias_sigma_ug": 50.0, "accel_vrw_ug_sqrt_hz": 20.0}
CONDITIONS = (
    "scenario turntable-quaternion, 200 Hz, 200 s, plain vectors; seeds from 1. Judged by |mean|: each run's mean over "
    "150 to 200 s, its magnitude averaged over the seeds; standard deviation in time: that of each run about its own mean"
    " over 150 to 200 s, averaged over the seeds; rms of all: over seeds and times; time to 0.1 deg: from which the rms "
    "over the seeds stays below it. Limits likewise: of the mean of |mean|, and root mean square"
)
"""Those of all rows."""


def quantities() -> list[Quantity]:
    """The figures of the paper and of insenv."""
    rows = []
    for noise in GRADES:
        run = _turntable(noise)
        for id in IDS:
            means, scatter = PUBLISHED.get((noise, id), (None, None))
            limit, expected, label = _limit(run), _mean_limit(run), f"{id}, {noise} ug, heading over 150-200 s"
            note = "limit: of the mean of |mean|"
            rows.append(_pair(run, id, f"{label}, |mean|", "deg", means, _mean, expected, note))
            rows.append(_pair(run, id, f"{label}, standard deviation in time", "deg", scatter, _scatter, None))
            rows.append(_pair(run, id, f"{label}, rms of all", "deg", None, _rms, limit))
            rows.append(_pair(run, id, f"{id}, {noise} ug, time to {REACHED} deg", "s", None, _time_below, None))
    run = _turntable(200, plain=False)
    for id in (Q, IMPROVED):
        label = f"{id} with insenv's windows, 200 ug, heading over 150-200 s"
        rows.append(Quantity(f"{label}, rms of all", "deg", None, _rms(run, id), None, _limit(run), 32))
    return rows + _one_run() + _figure_1() + _readings() + _tests()


def _one_run() -> list[Quantity]:
    """What one run can be by chance, as the paper's four numbers are: shares of the runs, and the mean by theory."""
    rows, run = [], _turntable(200)
    for id in (Q, IMPROVED):
        mean, scatter = PUBLISHED[200, id]
        note = "the bound is the published number of one run"
        for what, bound, measure in (("|mean|", mean, _means), ("standard deviation in time", scatter, _scatters)):
            quantity = f"{id}, 200 ug, runs with a {what} of at most {bound:g} deg"
            rows.append(_pair(run, id, quantity, "%", None, _share(measure, bound), None, note))
        note = "mean over all runs by linear theory, gyros exact; of the improved form with its noise known"
        quantity, known = f"{id}, 200 ug, standard deviation in time, by theory", run.plants[0].knowledge
        noise, times = float(units.ug_to_m_s2(200)) / NOMINAL_GRAVITY, run.time[run.time >= BEGIN]
        value = scatter_deg(noise, run.plants[0].sample_interval, known.latitude, times, id == IMPROVED)
        rows.append(Quantity(quantity, "deg", scatter, None, value, note=note))
    return rows


def _figure_1() -> list[Quantity]:
    """Rms of the heading over the seeds at 50 s, 50 ug."""
    run = _turntable(50)
    limit = float(noise_limit(run.plants[0]).at(np.array([AT_50]))["heading_deg"][0])
    return [_pair(run, id, f"{id}, 50 ug, heading at 50 s, rms (figure 1)", "deg", None, _at_50, limit) for id in IDS]


def _readings() -> list[Quantity]:
    """What other readings of the adaptive filter give: figure 1, and the scatter of figure 4."""
    rows = []
    for name in READINGS:
        note = "another reading of the printed filter: b forgetting factor, s part of H P H^T that is subtracted"
        slow, fast = _reading(50, name), _reading(200, name)
        for id in (PLAIN_FILTER, IMPROVED):
            for run, quantity, unit, published, measure in (
                (slow, "50 ug, heading at 50 s, rms", "deg", None, _at_50),
                *([(slow, f"50 ug, time to {REACHED} deg", "s", None, _time_below)] if not READINGS[name] else []),
                (fast, "200 ug, standard deviation in time", "deg", PUBLISHED.get((200, id), (None, None))[1], _scatter),
                (fast, "200 ug, rms of all", "deg", None, _rms),
                *(
                    [(fast, KNOWN_SHARE, "%", None, _share(_scatters, 0.0032))]
                    if name == "noise known" and id == IMPROVED
                    else []
                ),
            ):
                limit = _limit(run) if measure is _rms else None
                label, value = f"{id} read with {name}, {quantity}", measure(run, PRINTED[id])
                rows.append(Quantity(label, unit, published, None, value, limit, SEEDS, note))
    return rows


def _tests() -> list[Quantity]:
    rows, note = [], "amplitudes, random walk and white noise are chosen by insenv: the tables of the paper are lost"
    for test in TESTS:
        run, label = _test(test), f"test {test[0]}"
        limit, expected = _limit(run), _mean_limit(run)
        last = test[0] == "3"
        if last:
            at_80 = f"{label}, qakf-improved, heading at 80 s, rms"
            rows.append(_pair(run, IMPROVED, at_80, "deg", 0.2366, _at_80, None, note, TEST_SEEDS))
        mean, scatter = f"{label}, |mean| over 150-200 s", f"{label}, standard deviation in time"
        bound = 0.0198 if last else TWO_ARCMIN
        rows.append(_pair(run, IMPROVED, mean, "deg", bound, _mean, expected, note, TEST_SEEDS))
        rows.append(_pair(run, IMPROVED, scatter, "deg", 0.0396 if last else None, _scatter, None, note, TEST_SEEDS))
        for id in IDS:
            rest = f"test {test}, {id}, rms of all"
            rows.append(_pair(run, id, rest, "deg", None, _rms, limit, note, TEST_SEEDS))
    return rows


def _pair(
    run: Ensemble, id: str, quantity: str, unit: str, published: float | None, measure: Measure, limit: float | None,
    note: str = "", seeds: int = SEEDS,
) -> Quantity:  # fmt: skip
    """A row with insenv's own form and the printed one."""
    return Quantity(quantity, unit, published, measure(run, id), measure(run, PRINTED[id]), limit, seeds, note)


def pictures() -> dict[str, Picture]:
    """Figures 1 to 4 of the paper with insenv's filters, and with its filters as printed."""
    return {"": _ours(), "-printed": _printed()}


def _printed() -> Picture:
    """The heading errors of figures 1 to 4, of one run each."""
    panels = []
    for title, noises, ids, begin in (
        ("figure 1: q-method and QAKF, 50 ug", (50,), (Q, PLAIN_FILTER), 0.0),
        ("figure 2: QAKF by the noise of the accelerometers", (0, 50, 100), (PLAIN_FILTER,), 0.0),
        ("figure 3: all three from 20 s, 50 ug", (50,), IDS, 20.0),
        ("figure 4: q-method and improved QAKF, 200 ug", (200,), (Q, IMPROVED), 20.0),
    ):
        span = 1.0 if begin else 45.0
        panel = TimePanel(
            title, "deg", _turntable(50).time, x_span=(begin, 200.0), span=(-span, span),
            linear_to=0.02 if begin else 0.1,
        )  # fmt: skip
        for k, noise in enumerate(noises):
            for id in ids:
                group, label = (3 + k, f"{noise} ug") if len(noises) > 1 else (IDS.index(id), "")
                panel.marks.append(Curve(group, _heading(_turntable(noise), PRINTED[id])[0], label=label))
        panels.append(panel)
    names = [PRINTED[id] for id in IDS]
    return Picture(
        "Heading error of the paper's filters as printed, seed 1", [panels[:2], panels[2:]], names, (9.0, 6.5), columns=6
    )


def _ours() -> Picture:
    """qakf with four noise levels; all methods with 200 ug: rms over the seeds, and one run."""
    run = _turntable(200)
    title = f"qakf: rms of heading error over {SEEDS} seeds, by accelerometer noise"
    top, middle = (TimePanel(name, "deg", run.time, log=True) for name in (title, "all three, 200 ug"))
    bottom = TimePanel("heading error of one run, 200 ug", "deg", run.time, span=(-0.3, 0.3))
    for k, noise in enumerate(GRADES):
        top.marks.append(Curve(3 + k, _heading_rms(_turntable(noise), PLAIN_FILTER), label=f"{noise} ug"))
    middle.marks += [Curve(group, _heading_rms(run, id)) for group, id in enumerate(IDS)]
    late = run.time[run.time >= BEGIN]
    limit = np.full(len(late), _limit(run))
    middle.marks.append(Curve(TRUTH_GROUP, limit, "model", late, "limit over 150-200 s"))
    bottom.marks += [Curve(IDS.index(id), _heading(run, id)[0]) for id in (Q, IMPROVED)]
    return Picture("Three-axis turntable, the paper's plain vectors", [[top], [middle], [bottom]], IDS, (9.0, 8.0))


def _of_noise(noise: int) -> Scenario:
    """The turntable with an accelerometer noise in ug."""
    scenario = load("turntable-quaternion")
    return scenario.model_copy(update={"imu": scenario.imu.model_copy(update={"grade": GRADES[noise]})})


@cache
def _turntable(noise: int, plain: bool = True) -> Ensemble:
    scenario = _of_noise(noise)
    if plain:
        tuning = dict.fromkeys(IDS, PLAIN)
        return ensemble(scenario, (*IDS, *FILTERS), range(1, SEEDS + 1), records=400, tuning=tuning)
    return ensemble(scenario, (Q, IMPROVED), range(1, 33), records=400)


@cache
def _reading(noise: int, name: str) -> Ensemble:
    """The printed filters in another reading."""
    tuning = READINGS[name] or {"noise_sigma": float(units.ug_to_m_s2(noise))}
    return ensemble(_of_noise(noise), FILTERS, range(1, SEEDS + 1), records=400, tuning=dict.fromkeys(FILTERS, tuning))


@cache
def _test(name: str) -> Ensemble:
    """A test of section 4, with the centres of its sway."""
    scenario = load("turntable-quaternion")
    sway = SwaySection.model_validate(TESTS[name])
    sections = {
        "start": scenario.start.model_copy(update={"heading_deg": -90.0, "pitch_deg": 2.0, "roll_deg": -2.0}),
        "vehicle": scenario.vehicle.model_copy(update={"sway": sway}),
        "imu": type(scenario.imu).model_validate({"grade": "perfect", **UNIT}),
    }
    scenario = scenario.model_copy(update=sections)
    tuning = dict.fromkeys(IDS, PLAIN)
    return ensemble(scenario, (*IDS, *FILTERS), range(1, TEST_SEEDS + 1), records=400, tuning=tuning)


def _heading(run: Ensemble, id: str) -> Array:
    """Heading errors (seeds, records), degrees."""
    return run.attitude_errors_deg(id)[:, :, 2]


def _heading_rms(run: Ensemble, id: str) -> Array:
    return np.sqrt(np.mean(_heading(run, id) ** 2, axis=0))


def _time_below(run: Ensemble, id: str) -> float | None:
    """Time from which the rms over the seeds stays below `REACHED`; None if there is none."""
    above = np.flatnonzero(_heading_rms(run, id) > REACHED)
    last = int(above[-1]) + 1 if above.size else 0
    return float(run.time[last]) if last < run.time.size else None


def _late(run: Ensemble, id: str) -> Array:
    """Heading errors over the time of the statistics."""
    return _heading(run, id)[:, run.time >= BEGIN]


def _means(run: Ensemble, id: str) -> Array:
    """Magnitude of each run's mean."""
    return np.abs(_late(run, id).mean(axis=1))


def _scatters(run: Ensemble, id: str) -> Array:
    """Standard deviation of each run about its own mean."""
    return _late(run, id).std(axis=1)


def _mean(run: Ensemble, id: str) -> float:
    return float(_means(run, id).mean())


def _scatter(run: Ensemble, id: str) -> float:
    return float(_scatters(run, id).mean())


def _share(measure: Callable[[Ensemble, str], Array], bound: float) -> Measure:
    """Share of the runs of which a number is at most `bound`, %."""
    return lambda run, id: 100.0 * float(np.mean(measure(run, id) <= bound))


def _rms(run: Ensemble, id: str) -> float:
    return rms(_late(run, id))


def _at(run: Ensemble, id: str, time: float) -> float:
    return rms(_heading(run, id)[:, np.argmin(np.abs(run.time - time))])


def _at_50(run: Ensemble, id: str) -> float:
    return _at(run, id, AT_50)


def _at_80(run: Ensemble, id: str) -> float:
    return _at(run, id, 80.0)


def _drawn(run: Ensemble) -> bool:
    """Whether the biases differ between units."""
    return bool(np.any(run.plants[0].parameters["gyro_bias_sigma"]))


def _limit(run: Ensemble) -> float:
    """Limit of the heading over the time of the statistics (deg): of the paper's unit, or of units with drawn biases."""
    if _drawn(run):
        return limit_of(run.plants[0]).rms(run.time, BEGIN)["heading_deg"]
    return float(unit_limit(run, bias_errors_deg(run), BEGIN)[2])


def _mean_limit(run: Ensemble) -> float:
    """Limit of the mean of |mean| over that time (deg)."""
    times = run.time[run.time >= BEGIN]
    if _drawn(run):
        return mean_limit(limit_of(run.plants[0]).at(times)["heading_deg"], np.zeros(1))
    return mean_limit(noise_limit(run.plants[0]).at(times)["heading_deg"], bias_errors_deg(run)[:, 2])


# Theory of the in-run standard deviation: how much the heading of one run moves about its own mean.
#
# With the gyros exact, the vectors of the paper observe a tilt a and a heading psi, y_k = a + psi W cos L t_k + n_k, with
# the horizontal Earth rate W cos L and white n.  With h_k = (1, W cos L t_k) and A_k the sum of h h^T up to k, the q-method
# solves A_i x = sum of h_k n_k.  The Kalman filter on the integral K_j = A_j dt takes all observations for equally noisy:
#
#     sum over j <= i of K_j^2  x = sum over j <= i of K_j (sum over k <= j of h_k n_k) dt
#
# Both errors are sums of the n_k with known weights, so their covariance over the times of a run is known, and with it the mean
# of the standard deviation of a run about its own mean.


STEP_S = 0.05
"""s: the noise of the samples in a step is averaged; far below all times here."""


def scatter_deg(tilt_sigma: float, interval: float, latitude: float, times: Array, integrated: bool) -> float:
    """Mean over runs of the standard deviation in time of the heading error, degrees.

    tilt_sigma: white noise per sample, rad. interval: of the samples, s. latitude: rad. times (n,) s: records, in order.
    integrated: the Kalman filter on the integral, with its noise known; otherwise the q-method.
    """
    count = round(times[-1] / STEP_S)
    h = np.stack([np.ones(count), geodesy.OMEGA_IE * np.cos(latitude) * STEP_S * (np.arange(count) + 0.5)], axis=1)
    A = np.cumsum(h[:, :, None] * h[:, None, :], axis=0)
    records = np.round(times / STEP_S).astype(int) - 1
    weights = np.zeros((len(times), count))
    before = np.concatenate([np.zeros((1, 2, 2)), np.cumsum(A, axis=0)])
    for row, i in enumerate(records):
        if integrated:
            solve = np.linalg.inv(np.einsum("jab,jbc->ac", A[: i + 1], A[: i + 1]))
            weights[row, : i + 1] = np.einsum("a,kab,kb->k", solve[1], before[i + 1] - before[: i + 1], h[: i + 1])
        else:
            weights[row, : i + 1] = h[: i + 1] @ np.linalg.inv(A[i])[1]
    moves = weights - weights.mean(axis=0)
    squares = np.linalg.eigvalsh(moves @ moves.T / len(times))
    return float(np.degrees(tilt_sigma * np.sqrt(interval / STEP_S)) * _mean_root(np.maximum(squares, 0.0)))


def _mean_root(squares: Array) -> float:
    """Mean of the root of a sum of squares of independent normal numbers with these variances (n,).

    Of a positive x it is the integral over u > 0 of (1 - E exp(-u^2 x)) / u^2, divided by the root of pi.
    """
    scale = np.sqrt(squares.sum())
    u = np.geomspace(1e-6, 1e6, 20001) / scale
    characteristic = np.exp(-0.5 * np.log1p(2 * np.outer(u**2, squares)).sum(axis=1))
    values = (1 - characteristic) / u  # du = u d(log u)
    return float(np.sum((values[1:] + values[:-1]) / 2 * np.diff(np.log(u))) / np.sqrt(np.pi))
