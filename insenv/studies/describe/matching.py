"""Which units, order and signs of the inertial columns agree with the fixes (`agreement.py`), and the delay and the lever arm
with them.

Every plausible choice of columns and units is tried with all 48 orders and signs of the gyros' axes among those of the
accelerometers, and with accelerometers that show minus the force.  The best are refined, with constant errors, lever arm, delay
and drift of the clock.  A choice is taken if the next one is `SURE` worse in log-likelihood; of the axes those that names or
places say are taken if they fit as well as any.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations, product

import numpy as np

from insenv.core.tables import Array
from insenv.studies.describe.agreement import (
    DELAY,
    DRIFT,
    Fit,
    Pairs,
    Track,
    Turned,
    Windows,
    changes,
    fitted,
    independent,
    log_ratio,
    pairs_of,
    refined,
    turned,
    windows_of,
)
from insenv.studies.describe.finding import UnclearError
from insenv.studies.describe.inertial import Choice
from insenv.studies.describe.tables import LogTable

SURE, ALIKE = 20.0, 5.0
"""Logarithm of the likelihood ratio from which one assumption is taken for right, and up to which two fit alike."""
EXPLAINED = 0.35
"""Part of the squared changes of velocity that may be left: beyond it samples and fixes do not belong together."""
WINDOW_S = {True: 20.0, False: 40.0}
"""Length (s) of windows where fixes have a velocity and where they have none."""
FINALISTS = 8
"""Assumptions that are refined."""


def signed_orders() -> Array:
    """The 48 matrices (48, 3, 3) that permute three axes and change their signs; the first changes nothing."""
    made = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            made.append(matrix)
    return np.array(made)


@dataclass(frozen=True, eq=False)
class Agreed:
    """The assumption that fits, and how well.

    margin, unit_margin, sign_margin: log-likelihood ratios to the next order of axes, to the next unit or columns, and, for
    accelerometers that show minus the force, to those that do not; left: part of the squared changes of velocity that it
    leaves; delay (s) of the fixes, and its change from the middle of the log to its end, with their sigmas.
    """

    choice: Choice
    windows: Windows
    done: Turned
    pairs: Pairs
    fit: Fit
    margin: float
    unit_margin: float
    left: float
    delay: float
    delay_sigma: float
    drift: float
    drift_sigma: float
    sign_margin: float = np.inf

    @cached_property
    def independent(self) -> float:
        """Number of independent components of the residuals."""
        return independent(self.fit.residual, self.pairs)


def agreed(table: LogTable, choices: Sequence[Choice], track: Track, delays: Sequence[float]) -> Agreed:
    """The one of the choices, orders of axes and signs with which samples and fixes agree best, sought from `delays` (s) of the
    fixes.  Raises `UnclearError` if they share too little."""
    length = WINDOW_S[track.velocity is not None]
    tried: list[_Tried] = []
    for choice in choices:
        motion, at_rest = choice.motion(table, track)
        # a vehicle that is never at rest shows the bias by its mean rate, unless it turns one way
        biases = [np.zeros(3), motion.rate.mean(axis=0)] if at_rest is None else [at_rest]
        screened = []
        for bias in biases:
            windows = windows_of(replace(motion, rate=motion.rate - bias), track, length)
            if len(windows.begin) < 2:
                raise UnclearError(
                    f"{table.file}: samples and fixes share less than {2 * length:g} s in which the fixes move: nothing shows "
                    "units and axes; allowed is a log of a drive"
                )
            screened.append(_screened(choice, windows, track))
        tried += min(screened, key=lambda each: min(one.mean for one in each))
    return _best(tried, track, delays)


def explained(agreed: Agreed, track: Track) -> bool:
    """Whether samples and fixes agree: what is only as small as the noise of the fixes shows no disagreement."""
    return agreed.left <= EXPLAINED or float(agreed.fit.mean) <= _noise(track)


def check_sure(agreed: Agreed, table: LogTable, track: Track) -> None:
    """Raise `UnclearError` if samples and fixes do not agree, or if another assumption fits about as well."""
    if not explained(agreed, track):
        raise UnclearError(
            f"{table.file}: whatever unit, order and sign its columns have, {100 * agreed.left:.3g} % of the changes of "
            f"velocity that the fixes show remain unexplained (allowed {100 * EXPLAINED:g} %): are both of one drive and one "
            "clock?"
        )
    if agreed.unit_margin < SURE:
        raise UnclearError(
            f"{table.file}: two units or choices of columns fit about alike ({agreed.choice.gyro_unit}, "
            f"{agreed.choice.accel_unit} is only {agreed.unit_margin:.3g} better in log-likelihood, {SURE:g} are needed)"
        )
    if agreed.sign_margin < SURE or (not agreed.choice.same_axes and agreed.margin < SURE):
        raise UnclearError(
            f"{table.file}: gyros and accelerometers do not have the same axes, and two orders fit about alike (only "
            f"{agreed.margin:.3g} apart in log-likelihood, {SURE:g} are needed): no turns and accelerations tell them apart"
        )


NOISY = 1.5
"""Factor on the noise of the fixes up to which they are explained, however small their motion."""


def _noise(track: Track) -> float:
    """Mean square (m^2/s^2) of a component of the changes of velocity that is the noise of the fixes, by third differences."""
    if track.velocity is None:
        return 0.0
    third = np.diff(track.velocity[:, :2], n=3, axis=0) / np.sqrt(20.0)
    return float(2.0 * (NOISY * np.median(np.abs(third)) / 0.6745) ** 2)


START_DELAYS = (0.0, -0.5, 0.5)
OTHER_DELAYS = tuple(sign * each for each in (1.2, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 17.0, 18.0, 19.0) for sign in (1.0, -1.0))
"""Delays (s) of the fixes from which the right one is sought: up to 1 s, and, if nothing fits, up to 5 s and leap seconds."""


@dataclass(frozen=True, eq=False)
class _Tried:
    """One assumption with the mean square that it leaves before constant errors are estimated."""

    choice: Choice
    windows: Windows
    mean: float


def _screened(choice: Choice, windows: Windows, track: Track) -> list[_Tried]:
    """All orders and signs of one choice of columns and units, with fixes at their stamps."""
    orders = signed_orders()
    pairs = pairs_of(windows, track)
    tried = []
    for sign in (1.0, -1.0):
        signed = replace(windows, pushed=sign * windows.pushed)
        means = fitted(changes(turned(signed, orders).integral, pairs), pairs, signed).mean
        tried += [
            _Tried(replace(choice, order=order, sign=sign), signed, float(mean))
            for mean, order in zip(means, orders, strict=True)
        ]
    return tried


def _best(tried: Sequence[_Tried], track: Track, delays: Sequence[float]) -> Agreed:
    """The best of the assumptions, refined; gyros and accelerometers with the same axes, if they fit about as well.

    Of each choice of columns and units the best orders of axes are refined; the others are compared before refinement.
    """
    groups: dict[tuple[object, ...], list[_Tried]] = {}
    for each in sorted(tried, key=lambda one: one.mean):
        groups.setdefault(each.choice.units, []).append(each)
    ends: dict[tuple[object, ...], list[tuple[Agreed, float]]] = {}
    leading = min(each.mean for each in tried)
    for units, group in groups.items():
        few = group[: FINALISTS if group[0].mean == leading else 2]
        few += [each for each in group[len(few) :] if each.choice.same_axes]
        ends[units] = sorted(
            ((_refined(each, track, delays), each.mean) for each in few), key=lambda end: float(end[0].fit.mean)
        )
    units = min(ends, key=lambda each: float(ends[each][0][0].fit.mean))
    if len(ends[units]) < FINALISTS:
        ends[units] = sorted(
            ((_refined(each, track, delays), each.mean) for each in groups[units][:FINALISTS]),
            key=lambda end: float(end[0].fit.mean),
        )
    best = ends[units][0]
    alike = [end for end in ends[units] if end[0].choice.same_axes and _ratio(end[0], best[0]) < ALIKE]
    chosen, raw = next((end for end in alike if end[0].choice.plain), alike[0] if alike else best)
    margins = [_ratio(end, chosen) for end, _ in ends[units] if end is not chosen]
    margins += [
        log_ratio(each.mean, raw, chosen.independent)
        for each in groups[units]
        if each.mean > max(end[1] for end in ends[units])
    ]
    unit_margin = min((_ratio(group[0][0], chosen) for each, group in ends.items() if each != units), default=np.inf)
    sign_margin = min(
        (_ratio(end, chosen) for end, _ in ends[units] if end.choice.sign > 0 > chosen.choice.sign), default=np.inf
    )
    return replace(chosen, margin=min(margins), unit_margin=unit_margin, sign_margin=sign_margin)


def _ratio(worse: Agreed, better: Agreed) -> float:
    return log_ratio(float(worse.fit.mean), float(better.fit.mean), better.independent)


def _refined(tried: _Tried, track: Track, delays: Sequence[float]) -> Agreed:
    done = turned(tried.windows, tried.choice.order, errors=True)
    fits = []
    for delay in delays:
        pairs = pairs_of(tried.windows, track, delay)
        fits.append((refined(done, pairs, 2), pairs, delay))
    fit, pairs, delay = min(fits, key=lambda each: float(each[0].mean))
    drift = 0.0
    for _ in range(4):
        delay += float(np.clip(fit.errors[DELAY], -0.5, 0.5))
        drift += float(np.clip(fit.errors[DRIFT], -0.2, 0.2))
        pairs = pairs_of(tried.windows, track, delay, drift)
        fit = refined(done, pairs, 2)
    took = (pairs.last - pairs.first)[..., None] * tried.windows.step
    change = (pairs.y + took * np.array([0.0, 0.0, track.gravity]))[pairs.valid]
    change = change - np.median(change, axis=0)
    left = float(fit.mean / max(np.mean(change**2), 1e-12))
    sigma, drift_sigma = (float(np.sqrt(fit.covariance[at, at])) for at in (DELAY, DRIFT))
    return Agreed(tried.choice, tried.windows, done, pairs, fit, np.inf, np.inf, left, delay, sigma, drift, drift_sigma)
