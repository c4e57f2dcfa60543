"""`allan`: what is my unit?  The noise of gyros and accelerometers from a log at rest, by its Allan deviation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from insenv.base.output import as_path
from insenv.core.runner import Progress, check_progress
from insenv.logs import RecordedLog, load
from insenv.logs.assumed_unit import assumed_unit
from insenv.sensors import units
from insenv.sensors.grades import ImuGrade
from insenv.studies.allan_deviation import Curve, allantools, curve
from insenv.studies.noise_terms import FLICKER, MARKOV, QUANTIZATION, TIME, WALK, WHITE, Figure, Terms, fit
from insenv.studies.rest import Part, part_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Picture

Array = NDArray[np.float64]

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
_ARW, _VRW = float(units.deg_sqrt_h_to_rad_sqrt_s(1.0)), float(units.ug_sqrt_hz_to_m_s_sqrt_s(1.0))
_DEG_H, _UG = float(units.deg_h_to_rad_s(1.0)), float(units.ug_to_m_s2(1.0))
SCALES: Mapping[str, Mapping[str, tuple[str, float]]] = {
    "gyro": {
        WHITE: ("gyro_arw_deg_sqrt_h", _ARW),
        QUANTIZATION: ("gyro_quantum_arcsec", float(units.arcsec_to_rad(1.0)) / 12**0.5),
        FLICKER: ("gyro_flicker_deg_h", _DEG_H),
        WALK: ("gyro_rrw_deg_h_sqrt_h", float(units.deg_h_sqrt_h_to_rad_s_sqrt_s(1.0))),
        MARKOV: ("gyro_instability_deg_h", _DEG_H),
        TIME: ("gyro_instability_time_s", 1.0),
    },
    "accel": {
        WHITE: ("accel_vrw_ug_sqrt_hz", _VRW),
        QUANTIZATION: ("accel_quantum_m_s", 1.0 / 12**0.5),
        FLICKER: ("accel_flicker_ug", _UG),
        WALK: ("accel_rrw_ug_sqrt_h", float(units.ug_sqrt_h_to_m_s2_sqrt_s(1.0))),
        MARKOV: ("accel_instability_ug", _UG),
        TIME: ("accel_instability_time_s", 1.0),
    },
}
"""Data-sheet figure of each term, and its unit in SI; the figure of quantization is the size of a count, sqrt(12) Q."""


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """The noise of one axis, or of the three axes of a triad together.

    name: "gyro x" ... "accel z", "gyro", "accel"; curve: its Allan deviation; terms: None for an axis without noise;
    warnings: what spoils the curve; distrust: why the figures are not those of the unit, empty if they are.
    """

    name: str
    curve: Curve
    terms: Terms | None
    warnings: tuple[str, ...]
    distrust: str = ""

    @property
    def kind(self) -> str:
        """ "gyro" or "accel"."""
        return self.name.split()[0]

    @property
    def white_key(self) -> str:
        """Data-sheet key of the white noise."""
        return SCALES[self.kind][WHITE][0]

    @property
    def unit(self) -> str:
        """Unit of the deviation in tables, figures and documents."""
        return "deg/h" if self.kind == "gyro" else "ug"

    @property
    def scale(self) -> float:
        """That unit in SI."""
        return _DEG_H if self.kind == "gyro" else _UG

    def figures(self) -> dict[str, Figure]:
        """The fitted figures by data-sheet key."""
        found = {} if self.terms is None else self.terms.figures
        return {SCALES[self.kind][name][0]: _scaled(each, SCALES[self.kind][name][1]) for name, each in found.items()}

    def upper(self) -> dict[str, float]:
        """Upper bounds (95 %) of the terms that were not seen, by data-sheet key."""
        found = {} if self.terms is None else self.terms.upper
        return {SCALES[self.kind][name][0]: bound / SCALES[self.kind][name][1] for name, bound in found.items()}

    def floor(self) -> Figure | None:
        """The bias instability of a data sheet, the lowest Allan deviation [deg/h or ug]; None while it still falls."""
        if self.terms is None or not self.terms.slow:
            return None
        fitted = self.terms.variance(self.curve.tau)
        at = int(np.nanargmin(np.where(np.isfinite(self.terms.freedom), fitted, np.nan)))
        freedom, value = float(self.terms.freedom[at]), float(np.sqrt(fitted[at])) / self.scale
        low, high = (value * (freedom / float(chi2.ppf(level, freedom))) ** 0.5 for level in (0.975, 0.025))
        return Figure(value, low, high)


def _scaled(figure: Figure, unit: float) -> Figure:
    return Figure(figure.value / unit, figure.low / unit, figure.high / unit)


@dataclass(frozen=True, eq=False)
class UnitNoise:
    """What a log shows of its inertial unit.

    log: its name; part: the samples used; axes: the six axes; triads: gyros and accelerometers, three axes together;
    assumed: the class of unit that everything else is taken from, and the sentence that says so.
    """

    log: str
    part: Part
    axes: tuple[SensorNoise, ...]
    triads: tuple[SensorNoise, SensorNoise]
    assumed: ImuGrade
    assumption: str

    @property
    def warnings(self) -> tuple[str, ...]:
        """All warnings: of the samples, and of the axes."""
        grouped: dict[str, list[str]] = {}
        for axis in self.axes:
            for text in axis.warnings:
                grouped.setdefault(text, []).append(axis.name)
        return (*self.part.warnings, *(f"{', '.join(names)}: {text}" for text, names in grouped.items()))

    def grade(self) -> ImuGrade:
        """The grade: noise as measured, of the three axes together; all else is that of the assumed class.

        So is the noise of gyros or accelerometers whose figures are not trusted.
        """
        trusted = [triad for triad in self.triads if not triad.distrust]
        measured = {key: each.value for triad in trusted for key, each in triad.figures().items()}
        noise = {key: 0.0 for triad in trusted for key, _ in SCALES[triad.kind].values() if not key.endswith("_time_s")}
        also = {"gyro": ("gyro_white_deg_h",), "accel": ("accel_white_ug", "accel_vrw_m_s_sqrt_h")}
        others = {key: 0.0 for triad in trusted for key in also[triad.kind]}
        unlimited = ImuGrade("", "")
        ranges = {name: getattr(unlimited, name) for name in ("gyro_range_deg_s", "accel_range_g")}
        times = {name: getattr(unlimited, name) for name in (f"{triad.kind}_instability_time_s" for triad in trusted)}
        sources = {"": self.assumption}
        sources |= dict.fromkeys(measured, f"insenv allan, {self.part.end_s - self.part.begin_s:.6g} s of {self.log}")
        title = f"Unit of {self.log}"[:120]
        return replace(self.assumed, title=title, sources=sources, **{**others, **noise, **ranges, **times, **measured})

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form (docs/json.md)."""
        from insenv.studies.allan_report import document

        return document(self)

    def figure(self) -> Picture:
        """The Allan deviations with the fitted terms.  Raises `InputError` if matplotlib is not installed."""
        from insenv.report.notebook import require_matplotlib
        from insenv.studies.allan_report import draw

        require_matplotlib()
        return draw(self)

    def write_grade(self, path: str | Path) -> Path:
        """Write the grade file, for ``grade = "FILE.toml"``; return its path.  Raises `InputError`."""
        from insenv.studies.allan_report import write_grade

        return write_grade(self, as_path("path", path))


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
    found: list[SensorNoise] = []

    def keep(noise: SensorNoise) -> None:
        found.append(noise)
        if progress is not None:
            progress(len(found), len(AXES) + 2)

    for place, axis in enumerate(AXES):
        keep(sensor_noise(axis, part.rates[:, place], part.interval))
    for kind in ("gyro", "accel"):
        keep(_triad(kind, [axis for axis in found if axis.kind == kind]))
    assumed = assumed_unit(log, (part.begin_s, part.end_s))
    gyro_bias, accel_bias = assumed.grade.gyro_bias_sigma_deg_h, assumed.grade.accel_bias_sigma_ug
    assumption = (
        f"assumed as for a log without a grade, by class {assumed.name!r}: biases {gyro_bias:g} deg/h and "
        f"{accel_bias / 1000:g} mg, 1 sigma"
    )
    if part.moves:
        found = [replace(each, distrust=MOVES) for each in found]
    return UnitNoise(name, part, tuple(found[:-2]), (found[-2], found[-1]), assumed.grade, assumption)


def sensor_noise(name: str, rate: Array, interval: float) -> SensorNoise:
    """The noise of one axis.  rate (n,): rad/s or m/s^2, samples of `interval` (s); name: one of `AXES`."""
    if float(np.std(rate)) <= SILENT * float(np.max(np.abs(rate))):
        silent = Curve(len(rate), interval, np.array([interval]), np.zeros(1), np.ones(1))
        return SensorNoise(name, silent, None, ("the samples are constant: no noise can be seen",))
    found = curve(rate, interval)
    use = _unfiltered(found)
    terms = fit(found, use)
    (knocks, growth), unexplained = _knocks(found), _unexplained(found, terms)
    distrust = unexplained or (knocks if growth > FACTOR else "")
    return SensorNoise(name, found, terms, tuple(filter(None, (_filtered(found, use), knocks, unexplained))), distrust)


def _triad(kind: str, axes: list[SensorNoise]) -> SensorNoise:
    """The three axes together: the mean of their variances has three times the degrees of freedom."""
    live = [axis.curve for axis in axes if axis.terms is not None]
    if not live:
        return replace(axes[0], name=kind, distrust=axes[0].warnings[0])
    variance = np.mean([each.variance for each in live], axis=0)
    impulses = np.max([each.impulses for each in live], axis=0)
    together = replace(live[0], deviation=np.sqrt(variance), impulses=impulses, axes=len(live))
    terms = fit(together, _unfiltered(together))
    distrust = next((f"{axis.name}: {axis.distrust}" for axis in axes if axis.distrust), _unexplained(together, terms))
    return SensorNoise(kind, together, terms, (), distrust)


def _unfiltered(found: Curve) -> NDArray[np.bool_]:
    """The averaging times (k,) at which no low-pass filter hides the white noise.

    Behind a filter the white noise, deviation times sqrt(tau), rises from the first averaging time on until the filter is
    passed; slow noise makes it rise later, and without an end.
    """
    white = found.deviation * np.sqrt(found.tau)
    settled = np.flatnonzero(white[1:] < FILTER_RISE * white[:-1])
    use = np.ones(len(found.tau), bool)
    if settled.size and settled[0] > 0 and found.tau[settled[0]] <= FILTER_S and len(use) - settled[0] >= 6:
        use[: settled[0]] = False
    return use


def _filtered(found: Curve, use: NDArray[np.bool_]) -> str:
    """The sentence on averaging times that are not in `use`; empty if all are."""
    return "" if use.all() else f"filtered: noise at averaging times below {found.tau[use][0]:.3g} s is too low and is left out"


def _knocks(found: Curve) -> tuple[str, float]:
    """The sentence that a curve has knocks, empty if it has none; and the factor by which rare ones make it larger."""
    number = found.samples * found.interval / found.tau
    wild = (found.impulses > IMPULSES[0] + IMPULSES[1] / np.sqrt(number)) & (number > 30)
    if not wild.any():
        return "", 1.0
    said = (
        f"knocks, steps or motion from averaging times of {found.tau[wild][0]:.3g} s on: differences are "
        f"{np.sqrt(found.impulses[wild].max()):.2g} times as large as their typical size suggests"
    )
    return said, float(np.sqrt(np.max(found.impulses, where=wild & (number <= RARE), initial=1.0)))


def _unexplained(found: Curve, terms: Terms) -> str:
    """The sentence that the terms do not explain a curve; empty if they do."""
    ratio = np.sqrt(found.variance / terms.variance(found.tau))
    worst = np.where(np.isfinite(terms.residual), np.abs(terms.residual), 0.0)
    far = (worst > APART) & (np.abs(np.log(ratio)) > np.log(FACTOR))
    if not far.any():
        return ""
    at = int(np.argmax(np.where(far, worst, 0.0)))
    return (
        f"the noise terms do not explain the curve: at {found.tau[at]:.3g} s it is {ratio[at]:.2f} times the fit, as by "
        "vibration, swaying or a filter"
    )
