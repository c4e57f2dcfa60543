"""Whether samples are regular: only then does a long step between two stamps mean that samples are missing.

Samples of a phone, of a bus that is polled, or stamps of arrival in bursts have steps of every length. Each sample then covers
the time since the one before, and a gap is a step far beyond all usual ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv.base.errors import InputError
from insenv.logs.units import Array

OFF = 0.25
"""Part of the interval by which a regular step differs from a whole number of intervals at most."""
MOST_OFF = 0.2
"""Share of steps that may differ by more: jitter."""
MOST_MISSING = 0.5
"""Missing samples per sample from which it is the interval that is wrong, not the samples that are missing."""
MANY_GAPS = 0.01
"""Share of steps, likewise: a single long gap is a gap."""
GAP = 5.0
"""In irregular sampling a gap is a step longer than this many times the step that 99 % do not exceed."""
LATE = 1.5
"""A step longer than this many nominal intervals may be a gap."""
COVERED = 0.5
"""Part of the missing time from which the increment beside a long step covers it: it is larger by as much."""
FASTEST_HZ = 1e4
"""Mean rate of samples from which the unit of the time stamps is wrong, unless the rate is stated."""
NEIGHBOURS = 2
"""Steps on either side that are searched for the jitter of a late stamp."""


@dataclass(frozen=True)
class Sampling:
    """How a unit samples: interval (s), the nominal or the median one; gap_s: steps beyond it are gaps (None: regular)."""

    interval: float
    gap_s: float | None = None
    notes: tuple[str, ...] = ()

    def missing(self, time: Array) -> np.ndarray:
        """Number of samples missing after each stamp, (n - 1,) integers."""
        if self.gap_s is None:
            return missing_samples(time, self.interval)
        steps = np.diff(time)
        return np.where(steps > self.gap_s, np.rint(steps / self.interval).astype(np.int64) - 1, 0)


def sampling(time: Array, rate_hz: float | None, label: str = "imu") -> Sampling:
    """The sampling of a unit by its time stamps (n,) s and, if it is stated, its rate.

    A stated rate means regular sampling; it must agree with the median step within 5 %. Raises InputError.
    """
    if time.size < 3:
        raise InputError(f"{label}: {time.size} samples in the window, at least 3 are needed")
    steps = np.diff(time)
    median = float(np.median(steps))
    if rate_hz is not None:
        if abs(median * rate_hz - 1.0) > 0.05:
            raise InputError(
                f"{label}: imu.rate_hz = {rate_hz:g} Hz, but the median step of the time stamps is {median:.6g} s"
                f" ({1.0 / median:.6g} Hz): they must agree within 5 %; check time_unit and time_scale"
            )
        return Sampling(1.0 / rate_hz)
    mean_hz = steps.size / float(time[-1] - time[0])  # not by the median: stamps of arrival come in bursts
    if mean_hz > FASTEST_HZ:
        raise InputError(
            f"{label}: {time.size} samples in {time[-1] - time[0]:.4g} s are {mean_hz:.6g} Hz: allowed is up to {FASTEST_HZ:g} "
            "Hz, unless imu.rate_hz states the rate; check time_unit and time_scale"
        )
    whole = np.maximum(np.rint(steps / median), 1.0)
    off = float(np.mean(np.abs(steps / median - whole) > OFF))
    missing = missing_samples(time, median)
    too_many = missing.sum() > MOST_MISSING * time.size and np.count_nonzero(missing) > MANY_GAPS * time.size
    if off <= MOST_OFF and not too_many:
        return Sampling(median)
    low, usual = (float(np.quantile(steps, q)) for q in (0.01, 0.99))
    gap = GAP * usual
    note = (
        f"{label}: irregular time stamps, with steps of {low * 1e3:.3g} to {usual * 1e3:.3g} ms (median {median * 1e3:.3g} ms):"
        f" each sample covers the time since the one before, and only steps above {gap * 1e3:.3g} ms are gaps"
        " (rate_hz states regular sampling)"
    )
    return Sampling(median, gap, (note,))


def covered_steps(time: Array, increments: Array, sampled: Sampling, stamp: str) -> np.ndarray:
    """Long steps (n - 1,) of regular sampling without a gap: the increment over each covers the whole step.

    Loggers add up the increments of samples that they merge; where samples are lost, their increments are missing. The size of
    the specific force, which gravity determines on most vehicles, shows which.

    time (n,) s; increments (n, 3) m/s, of velocity; stamp: "interval_end" or "interval_start".
    """
    missing = sampled.missing(time)
    if sampled.gap_s is not None or not missing.any():
        return np.zeros(missing.shape, bool)
    size = np.linalg.norm(increments, axis=1)
    over, late = (size[1:] if stamp == "interval_end" else size[:-1]), missing > 0
    usual = float(np.median(over[~late])) if (~late).any() else 0.0
    covered = late & (over > usual * (1 + COVERED * missing)) & (usual > 0)
    return covered if np.count_nonzero(covered) > 0.5 * np.count_nonzero(late) else np.zeros_like(covered)


def missing_samples(time: Array, interval: float) -> np.ndarray:
    """Number of samples missing after each stamp of regular sampling, (n - 1,) integers.

    With T the nominal interval, a step s_i between two stamps is late if s_i > 1.5 T. If the steps next to it are shorter than
    T, the late stamp is at least partly jitter: the amount by which the two steps on either side fall short of T is
    subtracted. The rest, divided by T and rounded, less one, is the number of missing samples.
    """
    steps = np.diff(time)
    short = np.minimum(steps - interval, 0.0)
    padded = np.concatenate((np.zeros(NEIGHBOURS), short, np.zeros(NEIGHBOURS)))
    size = steps.size
    around = np.zeros(size)
    for k in range(1, NEIGHBOURS + 1):
        around += padded[NEIGHBOURS - k : NEIGHBOURS - k + size] + padded[NEIGHBOURS + k : NEIGHBOURS + k + size]
    missing = np.rint((steps + around) / interval).astype(np.int64) - 1
    return np.where(steps > LATE * interval, np.maximum(missing, 0), 0)
