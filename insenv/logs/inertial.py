"""Inertial samples of a log: from time-stamped rates or increments to increments without gaps.

Missing samples are interpolated: their stamps at equal distances between the two stamps around the gap, their rates linear
between the rates on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array

# Whether samples are regular: only then does a long step between two stamps mean that samples are missing.
#
# Samples of a phone, of a bus that is polled, or stamps of arrival in bursts have steps of every length. Each sample then
# covers the time since the one before, and a gap is a step far beyond all usual ones.

MAX_JITTER = 0.25
"""Part of the interval by which a regular step differs from a whole number of intervals at most."""
MAX_JITTER_SHARE = 0.2
"""Share of steps that may differ by more: jitter."""
MAX_MISSING_SHARE = 0.5
"""Missing samples per sample from which it is the interval that is wrong, not the samples that are missing."""
MAX_GAP_SHARE = 0.01
"""Share of steps, likewise: a single long gap is a gap."""
GAP_STEPS = 5.0
"""In irregular sampling a gap is a step longer than this many times the step that 99 % do not exceed."""
LATE_STEPS = 1.5
"""A step longer than this many nominal intervals may be a gap."""
MIN_COVERED_SHARE = 0.5
"""Part of the missing time from which the increment beside a long step covers it: it is larger by as much."""
MAX_RATE_HZ = 1e4
"""Mean rate of samples from which the unit of the time stamps is wrong, unless the rate is stated."""
NEIGHBOURS = 2
"""Steps on either side that are searched for the jitter of a late stamp."""
_IRREGULAR = declared(
    "stamps-irregular",
    "{label}: irregular time stamps, with steps of {low:.3g} to {usual:.3g} ms (median {median:.3g} ms): each sample covers "
    "the time since the one before, and only steps above {gap:.3g} ms are gaps (rate_hz states regular sampling)",
)
_WRONG_FORCE = declared(
    "force-implausible",
    "imu: the median specific force is {size:.4g} m/s2, expected about 9.8: check accel_unit, accel_scale, kind",
)
_FORCE_DOWN = declared(
    "force-down", "imu: the specific force points down (+z of FRD); a vehicle at rest has -9.8 there: check axes, accel_axes"
)


@dataclass(frozen=True)
class Sampling:
    """How a unit samples: interval (s), the nominal or the median one; gap_s: steps beyond it are gaps (None: regular)."""

    interval: float
    gap_s: float | None = None
    notes: tuple[Remark, ...] = ()

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
    if mean_hz > MAX_RATE_HZ:
        raise InputError(
            f"{label}: {time.size} samples in {time[-1] - time[0]:.4g} s are {mean_hz:.6g} Hz: allowed is up to "
            f"{MAX_RATE_HZ:g} Hz, unless imu.rate_hz states the rate; check time_unit and time_scale"
        )
    whole = np.maximum(np.rint(steps / median), 1.0)
    off = float(np.mean(np.abs(steps / median - whole) > MAX_JITTER))
    missing = missing_samples(time, median)
    too_many = missing.sum() > MAX_MISSING_SHARE * time.size and np.count_nonzero(missing) > MAX_GAP_SHARE * time.size
    if off <= MAX_JITTER_SHARE and not too_many:
        return Sampling(median)
    low, usual = (float(np.quantile(steps, q)) for q in (0.01, 0.99))
    gap = GAP_STEPS * usual
    note = _IRREGULAR.filled(label=label, low=low * 1e3, usual=usual * 1e3, median=median * 1e3, gap=gap * 1e3)
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
    covered = late & (over > usual * (1 + MIN_COVERED_SHARE * missing)) & (usual > 0)
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
    return np.where(steps > LATE_STEPS * interval, np.maximum(missing, 0), 0)


_MIN_FORCE, _MAX_FORCE = 8.0, 14.0  # m/s^2: an aircraft that circles with 45 deg of bank has 13.9
"""Expected range of the median specific force of a vehicle on the Earth [m/s2]."""


@dataclass(frozen=True)
class Gaps:
    """Gaps that were bridged: count, samples interpolated, the longest [s], and (start, end) of each [s]."""

    count: int = 0
    samples: int = 0
    longest_s: float = 0.0
    intervals: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class InertialSamples:
    """Increments in body axes (FRD).

    imu_time (n,) s: end of each sample interval; delta_angle (n, 3) rad and delta_velocity (n, 3) m/s: increments over the
    interval; dt (n,) s: its length; bridged (n,): True for interpolated samples; gaps: where those are; temperature (n,) K: of
    the unit, None if the log does not have it.
    """

    imu_time: Array
    delta_angle: Array
    delta_velocity: Array
    dt: Array
    bridged: np.ndarray
    gaps: Gaps
    temperature: Array | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Bridged:
    """Samples without gaps: time (n,) [s]; rates (n, k); original (n,): whether the log has the row; gaps."""

    time: Array
    rates: Array
    original: np.ndarray
    gaps: Gaps


def increments(
    stamps: Array,
    samples: Array,
    sampled: Sampling,
    kind: str,
    stamp: str,
    max_gap_s: float,
    label: str = "imu",
    covered: np.ndarray | None = None,
    lengths: Array | None = None,
) -> InertialSamples:
    """Bridge the gaps and integrate rates over the sample intervals.

    The outermost of increments that cover intervals of different lengths is left out, because its length is not known.

    stamps (m,) s, strictly increasing; samples (m, 6): gyro and accelerometer in SI and body FRD; sampled: how; kind, stamp,
    max_gap_s: see the keys of a log's [imu]; label: the unit, in messages; covered (m - 1,): long steps that increments cover
    (`covered_steps`); lengths (m,) s: of the sample intervals, where the log states them. Raises InputError for a longer gap.
    """
    is_rate, interval = kind == "rate", sampled.interval
    rates, unequal = samples, not is_rate and (sampled.gap_s is not None or (covered is not None and bool(covered.any())))
    if not is_rate:
        if lengths is not None:
            unequal, rates = False, samples / lengths[:, None]
        else:
            rates = samples / (_lengths(stamps, interval, stamp, sampled, covered)[:, None] if unequal else interval)
    result = bridge(stamps, rates, sampled, max_gap_s, label, covered)
    if stamp == "interval_end":
        end, dt = result.time, np.diff(result.time, prepend=result.time[0] - interval)
    elif stamp == "interval_start":
        end = np.append(result.time[1:], result.time[-1] + interval)
        dt = end - result.time
    else:
        end, dt = result.time[1:], np.diff(result.time)
    bridged = ~result.original
    if lengths is not None:
        dt[result.original] = lengths
    if stamp == "instant":
        integrals = 0.5 * (result.rates[1:] + result.rates[:-1]) * dt[:, None]
        bridged = bridged[1:]
    else:
        integrals = result.rates * dt[:, None]
        if not is_rate:
            integrals[result.original] = samples
    known = slice(None) if not unequal else slice(1, None) if stamp == "interval_end" else slice(0, -1)
    end, integrals, dt, bridged = (values[known] for values in (end, integrals, dt, bridged))
    return InertialSamples(end, integrals[:, :3].copy(), integrals[:, 3:].copy(), dt, bridged, result.gaps)


def at_instants(means: Array) -> Array:
    """The samples (n, k) at the ends of intervals of which `means` (n, k) are the means by the trapezoidal rule.

    The rule m_k = (r_k + r_k-1) / 2 takes a quarter of the variance of white noise at one interval, and the noise of a unit is
    that of its samples.  It leaves one thing open, an alternation c (-1)^k: c is the median of what the differences of samples
    have of it, which is wrong by the noise of a sample over sqrt(n), and right where samples repeat.
    """
    sign = np.where(np.arange(len(means)) % 2, -1.0, 1.0)[:, None]
    samples = sign * (2.0 * np.cumsum(sign * means, axis=0))
    steps = np.diff(samples, axis=0)
    return np.asarray(samples - sign * (0.5 * np.median(sign[1:] * steps, axis=0)))


def _lengths(stamps: Array, interval: float, stamp: str, sampled: Sampling, covered: np.ndarray | None) -> Array:
    """Length (m,) s of the interval that each increment covers: up to its stamp, or from it; one interval beside a gap."""
    steps = np.diff(stamps)
    if sampled.gap_s is None and covered is not None:
        steps = np.where((sampled.missing(stamps) > 0) & ~covered, interval, steps)
    return np.insert(steps, 0 if stamp == "interval_end" else len(steps), interval)


def implausible(samples: InertialSamples) -> list[Remark]:
    """Notes on a median specific force that no vehicle on the Earth has: wrong unit, kind or axes."""
    force = samples.delta_velocity / samples.dt[:, None]
    size = float(np.median(np.linalg.norm(force, axis=1)))
    if not _MIN_FORCE < size < _MAX_FORCE:
        return [_WRONG_FORCE.filled(size=size)]
    if float(np.median(force[:, 2])) > 0.5 * size:
        return [_FORCE_DOWN]
    return []


def bridge(
    time: Array, rates: Array, sampled: Sampling, max_gap_s: float, label: str = "imu", covered: np.ndarray | None = None
) -> Bridged:
    """Interpolate the missing samples.

    time (n,) [s], strictly increasing; rates (n, k), any unit per second; sampled: how; max_gap_s: the longest time
    without samples (step less one interval) that is bridged; covered (n - 1,): steps that are no gaps. Raises InputError for a
    longer gap.
    """
    interval, missing = sampled.interval, sampled.missing(time)
    if sampled.gap_s is not None:
        missing = np.where(np.diff(time) - interval > max_gap_s, np.maximum(missing, 1), missing)
    if covered is not None:
        missing = np.where(covered, 0, missing)
    at = np.flatnonzero(missing)
    if not at.size:
        return Bridged(time, rates, np.ones(time.size, bool), Gaps())
    lengths = time[at + 1] - time[at] - interval
    long = np.flatnonzero(lengths > max_gap_s + 1e-9)
    if long.size:
        i = at[long[0]]
        raise InputError(
            f"{label}: no samples between {time[i]:.6f} s and {time[i + 1]:.6f} s: a gap of {lengths[long[0]]:.6g} s,"
            f" allowed imu.max_gap_s = {max_gap_s:g} s ({long.size} such gap{'s' if long.size > 1 else ''} in the log)"
        )
    total = time.size + int(missing.sum())
    place = np.arange(time.size)
    place[1:] += np.cumsum(missing)
    original = np.zeros(total, bool)
    original[place] = True
    position = np.arange(total)
    full_time = np.interp(position, place, time)
    full = np.column_stack([np.interp(full_time, time, column) for column in rates.T])
    full_time[place] = time
    full[place] = rates
    intervals = tuple((float(time[i]), float(time[i + 1])) for i in at)
    return Bridged(full_time, full, original, Gaps(len(at), int(missing.sum()), float(lengths.max()), intervals))
