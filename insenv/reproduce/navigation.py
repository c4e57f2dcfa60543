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
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insenv import geodesy
from insenv.evaluation.errors import POSITION, Result
from insenv.reproduce import Quantity, rms, table_2
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.runs.simulated import run
from insenv.scenario import Scenario, limit_of, load
from insenv.sensors import units

Array = NDArray[np.float64]

PAPER = "navigation"
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
    found = ensemble(flown, ["loosely-coupled"], range(SEEDS[reading]), duration_s=end, records=round(end / 10))
    at = np.searchsorted(found.time, BEGIN_S + 60.0 * np.arange(11) - 1e-6)
    y, truth = found.outputs["loosely-coupled"], found.truth
    places = [(t["latitude"][:, at], t["longitude"][:, at], t["height"][:, at]) for t in (y, truth)]
    distance = np.linalg.norm(geodesy.numeric.ned_offset(*places[0], *places[1]), axis=-1)
    position = limit_of(found.plants[0]).at(found.time[at])
    limit = np.linalg.norm([position[name] for name in POSITION], axis=0)
    gyro, accel = (_left(found, name, int(at[0])) for name in ("gyro_bias", "accel_bias"))
    return Drift(distance, limit, float(units.rad_s_to_deg_h(gyro)), float(units.m_s2_to_ug(accel)))


def _left(found: Ensemble, name: str, record: int) -> float:
    """Root mean square error of a bias estimate."""
    error = found.outputs["loosely-coupled"][name][:, record] - found.truth[f"{name}_true"][:, record]
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
        found = drift(reading)
        left = [f"{float(f'{value:.2g}'):g}" for value in (found.gyro_deg_h, found.accel_ug)]
        note = f"after aided flight bias errors of {left[0]} deg/h and {left[1]} ug remain (rms); median"
        for minute in (1, 5, 10):
            rows.append(
                Quantity(
                    PAPER,
                    f"free inertial, distance error after {minute} min, {reading} biases",
                    "m",
                    PUBLISHED_M[minute],
                    float(np.median(found.distance[:, minute])),
                    float(found.limit[minute]),
                    SEEDS[reading],
                    note,
                )
            )
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
    count = SMOOTHED_SEEDS
    return [
        Quantity(
            PAPER,
            f"{what}: largest error of a channel",
            "m",
            0.3,
            float(max(largest)),
            None,
            count,
            f"the paper gives a bound; largest 1 sigma stated by the smoother: {max(sigma):.3f} m",
        ),
        Quantity(
            PAPER,
            f"{what}: position of the largest error within the outage (median)",
            "1",
            0.5,
            float(np.median(places)),
            None,
            count,
            "0: begin, 1: end",
        ),
        Quantity(
            PAPER,
            f"{what}: largest change between records near its ends",
            "m",
            0.0,
            float(max(jumps)),
            None,
            count,
            f"records every {duration_s / 3000 if where else 0.6:.1f} s; the paper: no jump",
        ),
    ]


def figure(path_stem: Path) -> list[Path]:
    """Drift and outages, and table 2 with the readings of its cause.  PNG and SVG of each."""
    return [*_drift_and_outages(path_stem), *table_2.figure(path_stem.with_name(f"{path_stem.name}-table-2"))]


def _drift_and_outages(path_stem: Path) -> list[Path]:
    """Like figures 4 and 6 of the paper: distance error over ten minutes, and smoothed errors over four outages."""
    from insenv.base import style
    from insenv.base.style import COLOURS, DASHED, LIMIT, PALE, TRUTH

    minutes = np.arange(11)
    found = drift("in-run")
    result, outages = smoothed("in-run", 1)
    with style.page(9.0, 7.5) as page:
        top, bottom = page.subplots(2, 1)
        top.plot(minutes, found.distance.T, color=TRUTH, lw=0.8)
        top.plot([], [], color=TRUTH, label="insenv, each seed")
        top.plot(minutes, np.median(found.distance, axis=0), color=COLOURS[0], label=f"median of {SEEDS['in-run']} seeds")
        top.plot(minutes, found.limit, color=LIMIT, ls=DASHED, label="theoretical limit, 1 sigma")
        top.plot(minutes, PUBLISHED_M, "o", color=COLOURS[1], label="paper, Table 2")
        top.set(xlabel="time without GNSS [min]", ylabel="distance error [m]", title="Free inertial, in-run biases")
        top.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        shown = result.time > 1000.0
        time = (result.time[shown] - 1000.0) / 60
        style.shade(bottom, [((begin - 1000) / 60, (end - 1000) / 60) for begin, end in outages])
        for channel, colour in zip(POSITION, (COLOURS[0], COLOURS[1], COLOURS[2]), strict=True):
            bottom.plot(time, result.errors[channel][shown], color=colour, lw=1, label=channel.removesuffix("_m"))
            for sign in (-1, 1):
                bottom.plot(time, sign * result.sigma[channel][shown], color=colour, lw=0.8, ls=":")
        bottom.plot([], [], color=PALE, lw=0.8, ls=":", label="stated ±1 sigma")
        bottom.set(xlabel="time [min]", ylabel="position error [m]", title="Smoothed, four outages of 1 min, seed 1")
        bottom.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        style.title(page, "Airborne navigation: ten minutes without GNSS, and outages smoothed")
        return style.save_both(page, path_stem)
