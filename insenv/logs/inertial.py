"""Inertial samples of a log: from time-stamped rates or increments to increments without gaps.

Missing samples are interpolated: their stamps at equal distances between the two stamps around the gap, their rates linear
between the rates on both sides.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from insenv.base.errors import InputError
from insenv.logs.sampling import Sampling
from insenv.logs.units import Array

_MIN_FORCE, _MAX_FORCE = 8.8, 10.8
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


def _lengths(stamps: Array, interval: float, stamp: str, sampled: Sampling, covered: np.ndarray | None) -> Array:
    """Length (m,) s of the interval that each increment covers: up to its stamp, or from it; one interval beside a gap."""
    steps = np.diff(stamps)
    if sampled.gap_s is None and covered is not None:
        steps = np.where((sampled.missing(stamps) > 0) & ~covered, interval, steps)
    return np.insert(steps, 0 if stamp == "interval_end" else len(steps), interval)


def implausible(samples: InertialSamples) -> list[str]:
    """Notes on a median specific force that no vehicle on the Earth has: wrong unit, kind or axes."""
    force = samples.delta_velocity / samples.dt[:, None]
    size = float(np.median(np.linalg.norm(force, axis=1)))
    if not _MIN_FORCE < size < _MAX_FORCE:
        return [f"imu: the median specific force is {size:.4g} m/s2, expected about 9.8: check accel_unit, accel_scale, kind"]
    if float(np.median(force[:, 2])) > 0.5 * size:
        return ["imu: the specific force points down (+z of FRD); a vehicle at rest has -9.8 there: check axes, accel_axes"]
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
