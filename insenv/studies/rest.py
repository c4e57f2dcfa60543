"""The part of a log that shows the noise of its inertial unit: the longest time at rest, and the rates of the samples in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.remarks import Remark, clock, declared
from insenv.core.tables import Array
from insenv.logs import RecordedLog
from insenv.logs.declared_units import rest_hint
from insenv.logs.inertial import at_instants
from insenv.logs.rest import REST_WINDOW_S, rest_until

LEAST_S, LEAST_SAMPLES = 10.0, 1000
"""The shortest part that tells something of a unit."""
_PART = declared("longest-rest", "only {begin} to {end} s is used: the longest time without motion in a log of {whole:.6g} s")
_MOVES = declared("moves-in-part", "the vehicle moves in this part, and its motion hides the noise of the unit")
_MISSING = declared(
    "samples-missing",
    "{share:.2g} % of the samples are missing and interpolated, which hides noise at averaging times up to {time:.2g} s",
)
_REPEAT = declared(
    "samples-repeat",
    "{share:.2g} % of the samples repeat the one before: the log has more samples than the unit, and its noise at short "
    "averaging times is too low",
)
_UNEVEN = declared(
    "samples-uneven", "the time between samples varies by {share:.2g} %, and the Allan deviation takes it as constant"
)


@dataclass(frozen=True)
class Part:
    """Consecutive samples of a log.

    begin_s, end_s: s, on the log's clock; interval: mean time between samples, s; rates (n, 6): gyros, rad/s, and
    accelerometers, m/s^2, in body axes; moves: whether the vehicle moves in it; warnings: what in the samples spoils their
    Allan deviation.
    """

    begin_s: float
    end_s: float
    interval: float
    rates: Array
    moves: bool
    warnings: tuple[Remark, ...]


def part_of(log: RecordedLog, from_s: float | None = None, to_s: float | None = None) -> Part:
    """The part from `from_s` to `to_s` (s), or the longest time at rest if neither is given.

    Raises `InputError` if there is no rest, or if the part is short.
    """
    end = log.imu_time
    if from_s is None and to_s is None:
        begin, until = _longest_rest(log)
        chosen = (end > begin) & (end <= until + 1e-9)
    else:
        begin = float(end[0] - log.dt[0]) if from_s is None else from_s
        until = float(end[-1]) if to_s is None else to_s
        if not begin < until:
            raise InputError(f"from {clock(begin)} s to {clock(until)} s: allowed is a part that ends after it begins")
        chosen = (end > begin + 1e-9) & (end <= until + 1e-9)
    first, last = _bounds(chosen)
    count, lasts = last - first, float(log.dt[first:last].sum())
    if count < LEAST_SAMPLES or lasts < LEAST_S:
        raise InputError(
            f"{_label(log)}: {count} samples in {lasts:.3g} s from {clock(begin)} s to {clock(until)} s: allowed is "
            f"{LEAST_SAMPLES} samples and {LEAST_S:g} s or more"
        )
    samples = slice(first, last)
    start = round(float(end[first] - log.dt[first]), 9)
    interval = lasts / count
    length = log.dt[samples, None] if log.description.imu.kind == "rate" else interval
    rates = np.hstack([log.delta_angle[samples] / length, log.delta_velocity[samples] / length])
    if log.description.imu.stamp == "instant":
        rates = at_instants(rates)
    warnings = _faults(log, samples, rates, interval)
    end_s, moves = float(end[last - 1]), False
    if from_s is None and to_s is None:
        whole = float(end[-1] - end[0] + log.dt[0])
        if whole - lasts > REST_WINDOW_S:
            warnings.insert(0, _PART.filled(begin=clock(start), end=clock(end_s), whole=whole))
    elif moves := not _is_rest(log, start, end_s):
        warnings.insert(0, _MOVES)
    return Part(start, end_s, interval, rates, moves, tuple(warnings))


def _label(log: RecordedLog) -> str:
    return log.description.title or "the log"


def _bounds(chosen: NDArray[np.bool_]) -> tuple[int, int]:
    at = np.flatnonzero(chosen)
    return (int(at[0]), int(at[-1]) + 1) if at.size else (0, 0)


def _rest(log: RecordedLog, begin: float) -> float | None:
    """End (s) of the rest that begins with the first sample after `begin` (s)."""
    dt = log.dt[:, None]
    return rest_until(log.imu_time, log.delta_angle / dt, log.delta_velocity / dt, log.gnss, begin)


def _longest_rest(log: RecordedLog) -> tuple[float, float]:
    """Begin and end (s) of the longest time without motion.  Raises `InputError` if there is none."""
    initial, last = log.description.initial, float(log.imu_time[-1])
    begin = float(log.imu_time[0] - log.dt[0])
    best = (0.0, 0.0)
    if initial.static_until_s is not None:
        first = begin if initial.static_from_s is None else initial.static_from_s
        best = (first, min(initial.static_until_s, last))
        begin = best[1] + REST_WINDOW_S
    while last - begin > max(best[1] - best[0], LEAST_S):
        until = _rest(log, begin)
        if until is not None and until - begin > best[1] - best[0]:
            best = (begin, until)
        begin = REST_WINDOW_S + (begin if until is None else max(begin, until))
    if best[1] - best[0] < LEAST_S:
        raise InputError(
            f"{_label(log)}: no {LEAST_S:g} s without motion: gyros and accelerometers then show the motion, not their noise;"
            " allowed is a log with the unit at rest, or a part that from_s and to_s (--from, --to) name"
            f"{rest_hint(log)}"
        )
    return best


def _is_rest(log: RecordedLog, begin: float, end: float) -> bool:
    until = _rest(log, begin)
    return until is not None and until >= end - REST_WINDOW_S


REPEATED, BRIDGED, IRREGULAR = 0.01, 0.001, 0.1
"""Shares of repeated and missing samples, and of the interval by which its length varies, that are worth a warning."""
ROUNDING = 1e-12
"""Part of the largest rate by which samples that repeat may differ: means by the trapezoidal rule are rounded."""


def _faults(log: RecordedLog, samples: slice, rates: Array, interval: float) -> list[Remark]:
    """Sentences on the sampling."""
    faults = []
    missing = float(np.mean(log.bridged[samples]))
    if missing > BRIDGED:
        faults.append(_MISSING.filled(share=100 * missing, time=log.gaps.longest_s + interval))
    rounding = ROUNDING * np.abs(rates).max(axis=0)
    repeated = float(np.mean(np.all(np.abs(np.diff(rates, axis=0)) <= rounding, axis=1)))
    if repeated > REPEATED and np.any(np.abs(rates - rates[0]) > rounding):
        faults.append(_REPEAT.filled(share=100 * repeated))
    uneven = float(np.std(log.dt[samples])) / interval
    if uneven > IRREGULAR:
        faults.append(_UNEVEN.filled(share=100 * uneven))
    return faults
