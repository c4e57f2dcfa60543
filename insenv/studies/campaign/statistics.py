"""The statistics of a campaign: of the errors over the runs, along time and at the end, with the theoretical limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from insenv.base.remarks import Remark, as_json
from insenv.core.tables import Array
from insenv.evaluation.health import CONTRADICTED, VERDICTS, AidHealth, Health
from insenv.evaluation.limits import ratio_bounds
from insenv.studies.campaign.plan import Plan
from insenv.studies.campaign.run_remarks import Said, Share, shares
from insenv.studies.campaign.sensitivity import Sensitivity, no_indices

# Confidence intervals, 95 %, of the statistics of independent runs.

OUTSIDE = 0.025
"""Probability outside each end of an interval."""


@dataclass(frozen=True)
class Estimate:
    """A statistic of runs and its 95 % interval; NaN where so few runs give no end."""

    value: float
    low: float
    high: float

    def as_json(self) -> dict[str, float]:
        """The documented JSON form."""
        return {"value": self.value, "low": self.low, "high": self.high}


def percentile(values: Array, percent: float) -> Estimate:
    """A percentile of values (n,): the interval of order statistics (David and Nagaraja 2003, section 7.1).

    The number of values below the true percentile is binomial, whatever their distribution is.
    """
    from scipy.special import bdtr

    ordered, n, p = np.sort(values), len(values), percent / 100.0
    if not n:
        return Estimate(float("nan"), float("nan"), float("nan"))
    below = bdtr(np.arange(n + 1), n, p)  # P(at most k values below)
    first = int(np.searchsorted(below, OUTSIDE, side="right"))  # P(fewer than `first` below) is at most 2.5 %
    last = int(np.searchsorted(below, 1.0 - OUTSIDE, side="left"))  # P(more than `last` below) is at most 2.5 %
    low = float(ordered[first - 1]) if first >= 1 else float("nan")
    high = float(ordered[last]) if last < n else float("nan")
    return Estimate(float(np.percentile(ordered, percent)), low, high)


def root_mean_square(squares: Array) -> Estimate:
    """Root mean square over runs of which each has the mean square `squares` (n,), with the interval of `mean_ends`."""
    mean = float(np.mean(squares)) if len(squares) else float("nan")
    if len(squares) < 2 or not mean > 0.0:
        return Estimate(float(np.sqrt(mean)), float("nan"), float("nan"))
    low, high = mean_ends(squares)
    return Estimate(float(np.sqrt(mean)), float(np.sqrt(low)), float(np.sqrt(high)))


LEAST_SPREAD = 1e-6
"""Standard deviation over mean of squares below which they count as equal."""


def mean_ends(squares: Array) -> tuple[Array, Array]:
    """The interval (...) of the mean of independent mean squares (..., n), n > 1, of positive mean.

    The lower end is Student's of the logarithm.  Squares are skewed, which makes Student's upper end too low; the upper end is
    the highest of three: Student's, the one corrected for the skewness, and that of a multiple of a chi-square variable with as
    many degrees of freedom as fit.  From 4 runs on it covers 93 to 97 % if the squares are chi-square of at least 1 degree of
    freedom, or log-normal of a spread up to 0.8 (of the rms: 0.4); 92 % at a spread of 1.
    """
    from scipy.special import gammaincinv

    n, mean, deviation = squares.shape[-1], np.mean(squares, axis=-1), np.std(squares, axis=-1, ddof=1)
    t, differ = student(n - 1) / np.sqrt(n), deviation > LEAST_SPREAD * mean
    reach = np.exp(t * deviation / mean)
    if n < 3 or not differ.any():
        return mean / reach, mean * reach
    whole = differ & np.all(squares > 0.0, axis=-1)  # an error of exactly 0 fits no chi-square
    some = np.where(whole[..., None], squares, np.arange(1.0, n + 1.0))
    shape = np.where(whole, n * _shape(some), 1e9)
    centred = (squares - mean[..., None]) / np.where(differ, deviation, 1.0)[..., None]
    upper = (
        mean * reach,
        mean + _skewed(np.mean(centred**3, axis=-1), n, t) * deviation,
        mean * shape / gammaincinv(shape, OUTSIDE),
    )
    return mean / reach, np.where(differ, np.max(upper, axis=0), mean * reach)


def _skewed(third: Array, n: int, t: float) -> Array:
    """Upper end of a mean, in standard deviations above it: Student's `t`, transformed and solved for the mean.

    third: third central moment of the n values over the cube of their standard deviation.  Hall (1992, J. R. Stat. Soc. B 54,
    221-228).
    """
    skewness = third * np.sqrt(n * (n - 1.0)) / (n - 2.0)
    skewness = np.where(np.abs(skewness) < LEAST_SPREAD, LEAST_SPREAD, skewness)
    return 3.0 / skewness * (1.0 - np.cbrt(1.0 - skewness * (t + skewness / (6.0 * n))))


def _shape(squares: Array) -> Array:
    """Half the degrees of freedom (...) of a multiple of a chi-square variable, from its values (..., n).

    Closed form of Ye and Chen (2017, The American Statistician 71, 177-181), from 4 values on without its bias (Louzada, Ramos
    and Ramos 2019, ibid. 73, 369-370).
    """
    n, mean = squares.shape[-1], np.mean(squares, axis=-1)
    k = mean / np.mean((squares - mean[..., None]) * np.log(squares), axis=-1)
    return k if n < 4 else k - (3.0 * k - 2.0 / 3.0 * k / (1.0 + k) - 0.8 * k / (1.0 + k) ** 2) / n


def jackknifed(value: float, without: Array) -> Estimate:
    """A smooth statistic of n runs and Student's interval with the jackknife's standard deviation (Efron and Stein 1981).

    value: of all runs; without (n,): of all runs but one.
    """
    n = len(without)
    if n < 2 or not np.isfinite(without).all():
        return Estimate(value, float("nan"), float("nan"))
    reach = student(n - 1) * float(np.std(without)) * float(np.sqrt(n - 1.0))
    return Estimate(value, value - reach, value + reach)


def student(degrees: int) -> float:
    """Student's t that is exceeded with the probability `OUTSIDE`."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, 1.0 - OUTSIDE))


def horizontal(north: Array, east: Array) -> dict[str, Estimate]:
    """Horizontal errors of runs (n,): "cep", the radius that holds half of them, "r95"; "2drms", twice the rms distance."""
    radius = np.hypot(north, east)
    rms = root_mean_square(radius**2)
    return {
        "cep": percentile(radius, 50.0),
        "r95": percentile(radius, 95.0),
        "2drms": Estimate(2.0 * rms.value, 2.0 * rms.low, 2.0 * rms.high),
    }


PERCENTILES = (2.5, 16.0, 50.0, 84.0, 97.5)
FAR_OFF = 10.0
"""A run whose error is at least this many times that of the median run is listed as far off."""
BOUNDS = (0.025, 0.975)
"""Probabilities that bound the mean NEES of a consistent estimator."""


@dataclass(frozen=True)
class Course:
    """Statistics of one channel at the recorded times (records,), over the runs whose errors are finite there.

    mean: mean error.
    rms: root mean square of all evaluations since the previous record.
    percentiles: (5, records), of the errors.
    limit: root mean square of the limit since the previous record and over the runs, or None.
    stated: root mean square of the standard deviations that the estimator states, of the same evaluations, or None.
    """

    mean: Array
    rms: Array
    percentiles: Array
    limit: Array | None
    stated: Array | None


@dataclass(frozen=True)
class NeesCourse:
    """NEES at the recorded times: its mean over the runs (records,), degrees of freedom, 95 % bounds of the mean."""

    mean: Array
    degrees: int
    low: float
    high: float


@dataclass(frozen=True, repr=False)
class Statistics:
    """The statistics of a campaign.

    time (records,) s; courses by channel; nees or None; from_s: time from which the statistics of a whole run are
    taken.
    Run by run: seeds; values (runs, variations); final, rms, stated, limit (runs, channels; NaN where nothing is stated, or
    where there is no limit).
    limit_notes: what must be said of the limit.
    diverged: seeds of runs with a number that is not finite.
    far: seeds of runs whose rms is `FAR_OFF` times the median.
    whole: runs (runs,) whose numbers are all finite.  sensitivity: of the rms of the runs to the varied keys.
    health: of every run of a filter that reports it (`insenv.evaluation.health`), None where there is none; else empty.
    said: of every run, what `insenv.run` says of it.
    """

    plan: Plan
    time: Array
    courses: dict[str, Course]
    nees: NeesCourse | None
    from_s: float
    seeds: Array
    values: Array
    final: Array
    rms: Array
    stated: Array
    limit: Array
    diverged: tuple[int, ...]
    far: tuple[int, ...]
    limit_notes: tuple[Remark, ...] = ()
    health: tuple[Health | None, ...] = ()
    said: tuple[tuple[Said, ...], ...] = ()
    whole: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    sensitivity: tuple[Sensitivity, ...] = ()
    percentile_levels: ClassVar[tuple[float, ...]] = PERCENTILES

    @property
    def notes(self) -> tuple[Remark, ...]:
        """What must be said of the campaign."""
        return (*self.plan.notes, *(one.remark for one in self.shares), *self.limit_notes, *no_indices(self.plan))

    @property
    def shares(self) -> tuple[Share, ...]:
        """What `insenv.run` says of the runs, each sentence with those of which it holds."""
        return shares([int(seed) for seed in self.seeds], self.said) if self.said else ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the errors."""
        return tuple(self.courses)

    def figures(self) -> dict[str, dict[str, Any]]:
        """By channel: "mean" and "percentiles" of the errors at the end, "rms", "limit" and "stated" from `from_s` on, with
        intervals, of which an end is None where so few runs do not give it.

        The intervals are those of independent runs; a saltelli design has none.
        """
        finite, independent = self.whole, self.plan.design != "saltelli"
        rows = {}
        for place, (name, course) in enumerate(self.courses.items()):
            rms = root_mean_square(self.rms[finite, place] ** 2)
            ends = {f"{p:g}": percentile(self.final[finite, place], p) for p in PERCENTILES}
            rows[name] = {
                "mean": float(course.mean[-1]),
                "rms": float(rms_of(self.rms[finite, place])) if finite.any() else float("nan"),
                "percentiles": {f"{p:g}": float(v) for p, v in zip(PERCENTILES, course.percentiles[:, -1], strict=True)},
                "limit": _known_rms(self.limit[finite, place]),
                "stated": _known_rms(self.stated[finite, place]),
                "rms_95": _interval(rms) if independent else None,
                "percentiles_95": {level: _interval(end) for level, end in ends.items()} if independent else None,
            }
        return rows

    def horizontal(self) -> dict[str, Estimate] | None:
        """Horizontal errors at the end: "cep", "r95" and "2drms", m; None without a position, or without independent runs."""
        if "north_m" not in self.channels or self.plan.design == "saltelli" or not self.whole.any():
            return None
        north, east = (self.final[self.whole, self.channels.index(name)] for name in ("north_m", "east_m"))
        return horizontal(north, east)

    def verdicts(self) -> dict[str, Any] | None:
        """Share of the runs with a health by verdict, their mean NIS and share of fixes refused; None if no run has one.

        aids: the same of every other aid by id, if there is one.
        """
        known = [one for one in self.health if one is not None]
        if not known:
            return None
        aids = dict.fromkeys(id for one in known for id in one.aids)
        fixes = [(one.fixes, one.refused, one.nis.mean) for one in known if one.fixes]
        return {
            **_shares([one.verdict for one in known], fixes),
            "aids": {id: _of_aid([one.aids[id] for one in known if id in one.aids]) for id in aids},
        }

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        plan, nees = self.plan, None
        if self.nees is not None:
            late = self.time >= self.from_s - 1e-9
            nees = {
                "mean": float(np.mean(self.nees.mean[late])),
                "degrees_of_freedom": self.nees.degrees,
                "low": self.nees.low,
                "high": self.nees.high,
                "share_inside": float(
                    np.mean((self.nees.mean[late] >= self.nees.low) & (self.nees.mean[late] <= self.nees.high))
                ),
            }
        return {
            "scenario": plan.name,
            "estimator": plan.estimator,
            "runs": plan.runs,
            "first_seed": plan.first_seed,
            "duration_s": plan.duration_s,
            "imu_samples": plan.runs * plan.samples,
            "varied": [{"key": v.key, **v.distribution.as_json()} for v in plan.variations],
            "statistics_from_s": self.from_s,
            "errors": self.figures(),
            "horizontal": None if (h := self.horizontal()) is None else {name: e.as_json() for name, e in h.items()},
            "design": plan.design,
            "sensitivity": [one.as_json() for one in self.sensitivity],
            "limit_ratio_95": list(ratio_bounds(plan.runs - len(self.diverged))) if plan.runs > len(self.diverged) else None,
            "nees": nees,
            "health": self.verdicts(),
            "diverged": list(self.diverged),
            "far": list(self.far),
            "of_runs": [one.as_json() for one in self.shares],
            **as_json(self.notes),
        }


def _of_aid(healths: list[AidHealth]) -> dict[str, Any]:
    return _shares([one.verdict for one in healths], [(one.measurements, one.refused, one.nis.mean) for one in healths])


def _shares(verdicts: Sequence[str], measured: list[tuple[int, int, float]]) -> dict[str, Any]:
    """Share of the runs by verdict; mean NIS and share refused of the runs that measured (measurements, refused, NIS)."""
    shares: dict[str, Any] = {verdict: verdicts.count(verdict) / len(verdicts) for verdict in (*VERDICTS, CONTRADICTED)}
    count = sum(number for number, _, _ in measured)
    means = [nis for _, _, nis in measured if np.isfinite(nis)]  # a run that used none has none
    return {
        "runs": len(verdicts),
        **shares,
        "nis": float(np.mean(means)) if means else None,
        "refused": sum(refused for _, refused, _ in measured) / count if count else None,
    }


def rms_of(values: Array) -> Array:
    """Root mean square along the first axis."""
    return np.sqrt(np.mean(values**2, axis=0))


def _known_rms(values: Array) -> float | None:
    """Root mean square of those that are not NaN; None if all are."""
    known = values[np.isfinite(values)]
    return float(rms_of(known)) if known.size else None


def _interval(estimate: Estimate) -> list[float | None]:
    return [end if np.isfinite(end) else None for end in (estimate.low, estimate.high)]
