"""The airborne-navigation paper: free-inertial navigation for ten minutes, and four smoothed outages of one minute.

The paper flies a unit of 0.1 deg/h and 1e-3 g, aided by centimetre-grade GPS until the outage, so that the drift is due
to the errors that the filter could not estimate.  It does not state which part of these two figures is constant.  Two
interpretations are shown:

turn-on  the figures are constant biases (1 sigma), as in `aircraft-survey`: the filter estimates nearly all of them,
         and the remaining drift is a hundredth of the paper's. in-run   the figures are the standard deviation of
         Gauss-Markov biases with a correlation time of one hour: the filter tracks them as well as theory allows.

Table 2 row by row, with `wander-sins-plain` as the printed form, is in `insenv.reproduce.table_2`.

The flight is insenv's own, because the paper gives no track; the outage begins 60 s into the first survey line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv import geodesy
from insenv.core.tables import Array
from insenv.evaluation.errors import POSITION, Result
from insenv.report.panels import TRUTH_GROUP, Curve, Picture, TimePanel
from insenv.reproduce import Quantity, rms, table_2
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.runs.simulated import run
from insenv.scenario import Scenario, limit_of, load
from insenv.sensors import units

SEEDS = {"in-run": 20, "turn-on": 8}
SMOOTHED_SEEDS = 3
WHOLE_S = 7200.0
BEGIN_S = 1060.0
PUBLISHED_M = (0.0, 2.08, 8.46, 23.83, 47.04, 77.42, 119.22, 181.48, 259.73, 352.06, 458.77)
"""Table 2: distance error after 0, 1, ... 10 min."""
IN_RUN = {
    "gyro_bias_sigma_deg_h": 0.0,
    "gyro_instability_deg_h": 0.1,
    "accel_bias_sigma_ug": 0.0,
    "accel_instability_ug": 1000.0,
}
READINGS: dict[str, dict[str, float]] = {"in-run": IN_RUN, "turn-on": {}}
CONDITIONS = (
    "scenario aircraft-survey, 200 Hz; free inertial flight after 1060 s with GNSS, seeds from 0; outages smoothed, seeds"
    " 1 to 3; table 2 is fitted with the response to one constant error, without noise. Judged by the median distance "
    "error over the seeds, smoothed by the largest over seeds and outages; limit: the root sum square of the limits of "
    "the three components at that time"
)
"""Those of all rows."""


@dataclass(frozen=True)
class Drift:
    """Free-inertial navigation after aided flight.

    distance (seeds, 11) m: position error after each minute.
    limit (11,) m: of the distance, root sum square of the position's limits.
    gyro_deg_h, accel_ug: bias errors at the beginning of the outage, root mean square over seeds and axes.
    """

    distance: Array
    limit: Array
    gyro_deg_h: float
    accel_ug: float


def scenario(reading: str, outages: tuple[tuple[float, float], ...] | None = None) -> Scenario:
    """`aircraft-survey` with the unit interpreted as `reading` and other outages (None: its own)."""
    loaded = load("aircraft-survey")
    gnss = loaded.gnss if outages is None or loaded.gnss is None else loaded.gnss.model_copy(update={"outages_s": outages})
    return loaded.model_copy(update={"gnss": gnss, "imu": loaded.imu.model_copy(update=READINGS[reading])})


def drift(reading: str) -> Drift:
    """Ten minutes without GNSS, over `SEEDS`."""
    end = BEGIN_S + 600.0
    flown = scenario(reading, ((BEGIN_S + 0.5, end + 1.0),))  # the fix at the beginning is the last
    runs = ensemble(flown, ["loosely-coupled"], range(SEEDS[reading]), duration_s=end, records=round(end / 10))
    at = np.searchsorted(runs.time, BEGIN_S + 60.0 * np.arange(11) - 1e-6)
    y, truth = runs.outputs["loosely-coupled"], runs.truth
    places = [(t["latitude"][:, at], t["longitude"][:, at], t["height"][:, at]) for t in (y, truth)]
    distance = np.linalg.norm(geodesy.numeric.ned_offset(*places[0], *places[1]), axis=-1)
    position = limit_of(runs.plants[0]).at(runs.time[at])
    limit = np.linalg.norm([position[name] for name in POSITION], axis=0)
    gyro, accel = (_left(runs, name, int(at[0])) for name in ("gyro_bias", "accel_bias"))
    return Drift(distance, limit, float(units.rad_s_to_deg_h(gyro)), float(units.m_s2_to_ug(accel)))


def _left(runs: Ensemble, name: str, record: int) -> float:
    """Root mean square error of a bias estimate."""
    error = runs.outputs["loosely-coupled"][name][:, record] - runs.truth[f"{name}_true"][:, record]
    return rms(error)


def smoothed(reading: str, seed: int, duration_s: float = 1720.0) -> tuple[Result, tuple[tuple[float, float], ...]]:
    """The smoothed flight, and its four outages."""
    flown = scenario(reading)
    assert flown.gnss is not None
    return run(flown, ["smoother"], seed=seed, duration_s=duration_s).results[0], flown.gnss.outages_s


def quantities() -> list[Quantity]:
    """The numbers of the paper and of insenv."""
    rows: list[Quantity] = []
    for reading in READINGS:
        drifted = drift(reading)
        left = [f"{float(f'{value:.2g}'):g}" for value in (drifted.gyro_deg_h, drifted.accel_ug)]
        note = f"after aided flight bias errors of {left[0]} deg/h and {left[1]} ug remain (rms); median"
        for minute in (1, 5, 10):
            label = f"free inertial, distance error after {minute} min, {reading} biases"
            median, limit = float(np.median(drifted.distance[:, minute])), float(drifted.limit[minute])
            rows.append(Quantity(label, "m", PUBLISHED_M[minute], median, None, limit, SEEDS[reading], note))
    for reading in READINGS:
        rows += _outages(reading)
    for reading in READINGS:
        rows += _outages(reading, WHOLE_S, " inside the flight of 2 h")
    return rows + table_2.quantities()


def _outages(reading: str, duration_s: float = 1720.0, where: str = "") -> list[Quantity]:
    largest, places, jumps, sigma = [], [], [], []
    for seed in range(1, SMOOTHED_SEEDS + 1):
        result, outages = smoothed(reading, seed, duration_s)
        time, step = result.time, float(result.time[1] - result.time[0])
        for begin, end in outages:
            inside = (time > begin) & (time < end)
            size = np.sqrt(np.sum([result.errors[channel][inside] ** 2 for channel in POSITION], axis=0))
            places.append((time[inside][np.argmax(size)] - begin) / (end - begin))
            for channel in POSITION:
                error = result.errors[channel]
                largest.append(np.abs(error[inside]).max())
                sigma.append(result.sigma[channel][inside].max())
                jumps += [np.abs(np.diff(error[np.abs(time - edge) < max(1.5, 1.1 * step)])).max() for edge in (begin, end)]
    what = f"1 min outages smoothed{where}, {reading} biases"
    bound = f"the paper gives a bound; largest 1 sigma stated by the smoother: {max(sigma):.3f} m"
    records = f"records every {duration_s / 3000 if where else 0.6:.1f} s; the paper: no jump"
    return [
        Quantity(f"{what}: {name}", unit, published, float(value), None, None, SMOOTHED_SEEDS, note)
        for name, unit, published, value, note in (
            ("largest error of a channel", "m", 0.3, max(largest), bound),
            ("position of the largest error within the outage (median)", "1", 0.5, np.median(places), "0: begin, 1: end"),
            ("largest change between records near its ends", "m", 0.0, max(jumps), records),
        )
    ]


def pictures() -> dict[str, Picture]:
    """Drift and outages, and table 2 with the readings of its cause."""
    return {"": _drift_and_outages(), "-table-2": table_2.picture()}


def _drift_and_outages() -> Picture:
    """Like figures 4 and 6 of the paper: distance error over ten minutes, and smoothed errors over four outages."""
    drifted, (result, outages) = drift("in-run"), smoothed("in-run", 1)
    top = TimePanel("Free inertial, in-run biases: distance error", "m", np.arange(11.0), x_name="time without GNSS [min]")
    top.marks = [Curve(TRUTH_GROUP, distance, "thin") for distance in drifted.distance]
    top.marks += [
        Curve(0, np.median(drifted.distance, axis=0), label=f"median of {SEEDS['in-run']} seeds"),
        Curve(TRUTH_GROUP, drifted.limit, "model", label="theoretical limit, 1 sigma"),
        Curve(1, np.array(PUBLISHED_M), "circles", label="paper, Table 2"),
    ]
    shown = result.time > 1000.0
    shade = [((begin - 1000) / 60, (end - 1000) / 60) for begin, end in outages]
    label, time = "Smoothed, four outages of 1 min, seed 1: position error [m]", (result.time[shown] - 1000.0) / 60
    bottom = TimePanel("Smoothed", "m", time, label, shade=shade, x_name="time [min]")
    for group, channel in enumerate(POSITION):
        error, sigma = result.errors[channel][shown], result.sigma[channel][shown]
        bottom.marks += [Curve(group, error, label=channel.removesuffix("_m"))]
        bottom.marks += [Curve(group, sign * sigma, "dotted", label="stated ±1 sigma") for sign in (-1, 1)]
    title = "Airborne navigation: ten minutes without GNSS, and outages smoothed"
    return Picture(title, [[top], [bottom]], (), (9.0, 7.5), "insenv, each seed")
