"""`allan`: what is my unit?  The noise of gyros and accelerometers from a log at rest, by its Allan deviation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from insenv.base.output import as_path
from insenv.base.remarks import Remark, declared, remark
from insenv.core.runner import Progress, check_progress
from insenv.core.tables import Array
from insenv.logs import RecordedLog, load
from insenv.logs.noise import assumed_unit
from insenv.studies.allan_result import SensorNoise, UnitNoise
from insenv.studies.noise_terms import Curve, Terms, allantools, curve, fit
from insenv.studies.rest import part_of

SILENT = 1e-12
"""Noise below this part of a rate is the rounding of its numbers."""
IMPULSES = 1.05, 8 * 0.7
"""A mean square over that of Gaussian noise of the same mean size, above the first plus the second over the root of the number
of differences, is not that of noise: 8 standard deviations."""
RARE = 1000
"""Of so many differences or fewer a handful are knocks; what is frequent, as jumps of a coarse quantum, is Gaussian by then."""
APART, FACTOR = 4.0, 1.15
"""Standard deviations, and ratio of observed and fitted deviation, from which on a fit does not explain a curve; and ratio
by which knocks make it larger from which on its figures are not those of the unit."""
MOVES = "the vehicle moves"
"""Why no figure of a part in motion is trusted."""
FILTER_S, FILTER_RISE = 1.0, 1.05
"""Up to this averaging time, and above this rise of the white noise in an octave, a low-pass filter is looked for."""

AXES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")


def allan(
    log: str | Path | RecordedLog,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Progress | None = None,
) -> UnitNoise:
    """The noise of the inertial unit of a log, by its Allan deviation.

    log: as in `insenv.replay`; from_s, to_s: the part to use, s, on the log's clock; the longest time at rest if neither is
    given. progress: called with the numbers of curves done and in all. Raises `InputError` for a wrong log, one without a
    rest, or a part that is too short.
    """
    allantools()
    check_progress(progress)
    name = log.description.title if isinstance(log, RecordedLog) else Path(log).name
    log = log if isinstance(log, RecordedLog) else load(as_path("log", log))
    part = part_of(log, from_s, to_s)
    noises: list[SensorNoise] = []

    def keep(noise: SensorNoise) -> None:
        noises.append(noise)
        if progress is not None:
            progress(len(noises), len(AXES) + 2)

    for place, axis in enumerate(AXES):
        keep(sensor_noise(axis, part.rates[:, place], part.interval))
    for kind in ("gyro", "accel"):
        keep(_triad(kind, [axis for axis in noises if axis.kind == kind]))
    assumed = assumed_unit(log, (part.begin_s, part.end_s))
    gyro_bias, accel_bias = assumed.grade.gyro_bias_sigma_deg_h, assumed.grade.accel_bias_sigma_ug
    assumption = (
        f"assumed as for a log without a grade, by class {assumed.name!r}: biases {gyro_bias:g} deg/h and "
        f"{accel_bias / 1000:g} mg, 1 sigma"
    )
    if part.moves:
        noises = [replace(each, distrust=MOVES) for each in noises]
    return UnitNoise(name, part, tuple(noises[:-2]), (noises[-2], noises[-1]), assumed.grade, assumption)


_CONSTANT = declared("samples-constant", "the samples are constant: no noise can be seen")
_KNOCKS = declared(
    "noise-knocks",
    "knocks, steps or motion from averaging times of {time:.3g} s on: differences are {ratio:.2g} times as large as their "
    "typical size suggests",
)


def sensor_noise(name: str, rate: Array, interval: float) -> SensorNoise:
    """The noise of one axis.  rate (n,): rad/s or m/s^2, samples of `interval` (s); name: one of `AXES`."""
    if float(np.std(rate)) <= SILENT * float(np.max(np.abs(rate))):
        silent = Curve(len(rate), interval, np.array([interval]), np.zeros(1), np.ones(1))
        return SensorNoise(name, silent, None, (_CONSTANT,))
    measured = curve(rate, interval)
    use = _unfiltered(measured)
    terms = fit(measured, use)
    (knocks, growth), unexplained = _knocks(measured), _unexplained(measured, terms)
    distrust = next(iter((*unexplained, *(knocks if growth > FACTOR else ()))), "")
    return SensorNoise(name, measured, terms, (*_filtered(measured, use), *knocks, *unexplained), distrust)


def _triad(kind: str, axes: list[SensorNoise]) -> SensorNoise:
    """The three axes together: the mean of their variances has three times the degrees of freedom."""
    live = [axis.curve for axis in axes if axis.terms is not None]
    if not live:
        return replace(axes[0], name=kind, distrust=axes[0].warnings[0])
    variance = np.mean([each.variance for each in live], axis=0)
    impulses = np.max([each.impulses for each in live], axis=0)
    together = replace(live[0], deviation=np.sqrt(variance), impulses=impulses, axes=len(live))
    terms = fit(together, _unfiltered(together))
    of_axes = (f"{axis.name}: {axis.distrust}" for axis in axes if axis.distrust)
    distrust = next(iter((*of_axes, *_unexplained(together, terms))), "")
    return SensorNoise(kind, together, terms, (), distrust)


def _unfiltered(measured: Curve) -> NDArray[np.bool_]:
    """The averaging times (k,) at which no low-pass filter hides the white noise.

    Behind a filter the white noise, deviation times sqrt(tau), rises from the first averaging time on until the filter is
    passed; slow noise makes it rise later, and without an end.
    """
    white = measured.deviation * np.sqrt(measured.tau)
    settled = np.flatnonzero(white[1:] < FILTER_RISE * white[:-1])
    use = np.ones(len(measured.tau), bool)
    if settled.size and settled[0] > 0 and measured.tau[settled[0]] <= FILTER_S and len(use) - settled[0] >= 6:
        use[: settled[0]] = False
    return use


@remark("noise-filtered", "a low-pass filter reduces the noise at averaging times below {time:.3g} s, which are left out")
def _filtered(measured: Curve, use: NDArray[np.bool_]) -> dict[str, float] | None:
    """Some averaging times are not in `use`."""
    return None if use.all() else {"time": measured.tau[use][0]}


def _knocks(measured: Curve) -> tuple[tuple[Remark, ...], float]:
    """The remark that a curve has knocks, none if it has none; and the factor by which rare ones make it larger."""
    number = measured.samples * measured.interval / measured.tau
    wild = (measured.impulses > IMPULSES[0] + IMPULSES[1] / np.sqrt(number)) & (number > 30)
    if not wild.any():
        return (), 1.0
    said = _KNOCKS.filled(time=measured.tau[wild][0], ratio=np.sqrt(measured.impulses[wild].max()))
    return (said,), float(np.sqrt(np.max(measured.impulses, where=wild & (number <= RARE), initial=1.0)))


@remark(
    "noise-unexplained",
    "the noise terms do not explain the curve: at {time:.3g} s it is {ratio:.2f} times the fit, as by vibration, swaying or a "
    "filter",
)
def _unexplained(measured: Curve, terms: Terms) -> dict[str, float] | None:
    """The terms do not explain a curve."""
    ratio = np.sqrt(measured.variance / terms.variance(measured.tau))
    worst = np.where(np.isfinite(terms.residual), np.abs(terms.residual), 0.0)
    far = (worst > APART) & (np.abs(np.log(ratio)) > np.log(FACTOR))
    if not far.any():
        return None
    at = int(np.argmax(np.where(far, worst, 0.0)))
    return {"time": measured.tau[at], "ratio": ratio[at]}
