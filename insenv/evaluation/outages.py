"""What an estimate is worth in outages of GNSS: fixes that were withheld from it are the reference.

A fix is the position of the antenna, so the estimate is taken there too: at the time at which the fix is valid, by its
position and velocity, and from the inertial unit to the antenna by its attitude.  What an estimator finds of the lever arm and
of the delay of the fixes counts.  The standard deviation of the difference is that of both, taken as independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from insenv import attitude, geodesy
from insenv.base.remarks import Doubt, remark
from insenv.core.tables import Array
from insenv.sensors.gnss import ARM, COMMON, DELAY, LEVER_ARM, GnssFixes

BEYOND = 3.0
"""Standard deviations that one error in 370 exceeds if these are true.  An rms of them beyond it contradicts what is stated."""
COMPONENTS = ("north_m", "east_m", "down_m")
SHOWN = ("horizontal_m", "down_m")
KINDS = ("end", "rms", "max", "stated", "ratio")
_LEVER_ARM, _DELAY = (term.states[0].name for term in (LEVER_ARM, DELAY))
"""Outputs of an estimator that finds them."""


@dataclass(frozen=True)
class Outage:
    """One outage, from `begin` to `end` (s): at each withheld fix in it the time (k,) s, the error (k, 3) of the estimated
    antenna, estimate minus fix, m, north, east, down, and the standard deviation (k, 3) of both together, m; NaN of an estimate
    that states none.
    """

    begin: float
    end: float
    time: Array
    error: Array
    sigma: Array

    def statistics(self) -> dict[str, dict[str, float]]:
        """By kind and component, also horizontal: the error at the last fix, rms and largest size over the outage, the standard
        deviation stated at the last fix, and the ratio of the error there to it."""
        errors, sigmas = (_with_horizontal(values) for values in (self.error, self.sigma))
        return {
            "end": {name: float(e[-1]) for name, e in errors.items()},
            "rms": {name: float(np.sqrt(np.mean(e**2))) for name, e in errors.items()},
            "max": {name: float(np.max(np.abs(e))) for name, e in errors.items()},
            "stated": {name: float(s[-1]) for name, s in sigmas.items()},
            "ratio": {name: float(abs(e[-1]) / sigmas[name][-1]) for name, e in errors.items()},
        }


@dataclass(frozen=True)
class Outages:
    """The outages of a replay, at least one."""

    each: tuple[Outage, ...]

    def summary(self) -> dict[str, dict[str, float]]:
        """By kind and component as of one outage: the rms over the outages, and of `max` the largest."""
        statistics = [one.statistics() for one in self.each]
        names = tuple(statistics[0]["end"])
        over = {name: lambda values: float(np.sqrt(np.mean(np.square(values)))) for name in KINDS} | {"max": max}
        return {kind: {name: over[kind]([one[kind][name] for one in statistics]) for name in names} for kind in KINDS}

    @property
    def ratios(self) -> Array:
        """Errors at all withheld fixes over their standard deviations (m, 3), north, east, down; empty if none are stated."""
        ratios = np.concatenate([one.error / one.sigma for one in self.each])
        return ratios[np.isfinite(ratios).all(axis=1)]

    @property
    def beyond(self) -> int:
        """The number of `ratios` beyond `BEYOND`."""
        return int(np.count_nonzero(np.abs(self.ratios) > BEYOND))

    def as_json(self) -> dict[str, Any]:
        """The documented JSON form."""
        return {
            "each": [{"begin_s": one.begin, "end_s": one.end, "fixes": len(one.time), **one.statistics()} for one in self.each],
            "all": self.summary(),
            "beyond_3_sigma": self.beyond / self.ratios.size if self.ratios.size else None,
        }

    @remark(
        "outages-too-sure",
        "where fixes were withheld, the errors {where} are {ratio:.3g} times as large as stated, rms",
        Doubt,
    )
    def too_sure(self) -> dict[str, Any] | None:
        """The rms of the ratios is beyond `BEYOND`, at the ends of the outages, as of a filter, or over all of them."""
        ends = np.array([one.error[-1] / one.sigma[-1] for one in self.each])
        of = {"at the ends of the outages": ends, "in the outages": self.ratios}
        rms = {where: float(np.sqrt(np.mean(ratios**2))) for where, ratios in of.items() if np.isfinite(ratios).any()}
        where = max(rms, key=rms.__getitem__, default="")
        return {"ratio": rms[where], "where": where} if rms and rms[where] > BEYOND else None


def _with_horizontal(values: Array) -> dict[str, Array]:
    named = dict(zip(COMPONENTS, values.T, strict=True))
    return {**named, "horizontal_m": np.hypot(values[:, 0], values[:, 1])}


def outages_of(
    time: Array, outputs: Mapping[str, Array], fixes: GnssFixes, windows: Array, resumed: Array, stated: Mapping[str, Any]
) -> Outages | None:
    """The outages of a navigation with the outputs (n, ...) by row name at the times (n,) s of its records.

    fixes: those that were withheld.  windows (k, 2): begin and end of the outages, s.  resumed (k,): when fixes are used again,
    s: an error counts only if the records on both sides of it are before that.  stated: of the receiver, by row of
    `GNSS_STATED`.

    None of an estimate whose records cover none of the fixes.
    """
    valid = fixes.time
    if _DELAY in outputs:
        valid = valid - np.interp(valid, time, np.ravel(outputs[_DELAY]))
    later = np.searchsorted(time, valid)
    outages = []
    for (begin, end), again in zip(windows, resumed, strict=True):
        inside = (fixes.time >= begin) & (fixes.time < end) & (later > 0) & (later < len(time))
        rows = np.flatnonzero(inside)
        rows = rows[time[later[rows]] < again]
        if len(rows):
            error, sigma = _differences(time, outputs, fixes, rows, valid[rows], later[rows], stated)
            outages.append(Outage(float(begin), float(end), fixes.time[rows], error, sigma))
    return Outages(tuple(outages)) if outages else None


def _differences(
    time: Array, outputs: Mapping[str, Array], fixes: GnssFixes, rows: Any, valid: Array, later: Any, stated: Mapping[str, Any]
) -> tuple[Array, Array]:
    """Error and standard deviation (k, 3) of the estimated antenna at the fixes `rows`.

    valid (k,): when these are valid, as far as the estimate knows, s; later (k,): the records after that.
    """
    ends = (later - 1, later)
    interval = (time[ends[1]] - time[ends[0]])[:, None]
    share = (valid - time[ends[0]])[:, None] / interval

    def between(values: Array) -> Array:
        early, late = (values[end].reshape(len(rows), -1) for end in ends)
        return np.asarray(early + share * (late - early))

    def estimated(row: str, otherwise: Any, size: int) -> Array:
        return between(outputs[row]) if row in outputs else np.broadcast_to(otherwise, (len(rows), size))

    place = tuple(getattr(fixes, name)[rows] for name in ("latitude", "longitude", "height"))
    early, late = (
        geodesy.numeric.position_error(*(outputs[name][end] for name in ("latitude", "longitude", "height")), *place)
        for end in ends
    )
    velocity_early, velocity_late = (outputs["velocity_n"][end] for end in ends)
    # the cubic with these positions and velocities at the records
    s = share
    position = (
        (1 + 2 * s) * (1 - s) ** 2 * early
        + s**2 * (3 - 2 * s) * late
        + interval * s * (1 - s) * ((1 - s) * velocity_early - s * velocity_late)
    )
    velocity = between(outputs["velocity_n"])
    C_nb = attitude.numeric.to_dcm(attitude_between(outputs["q_nb"][ends[0]], outputs["q_nb"][ends[1]], share))
    arm_n = np.einsum("kij,kj->ki", C_nb, estimated(_LEVER_ARM, stated[ARM.name], 3))

    arm_sigma, delay_sigma = (
        estimated(f"{term.states[0].name}_estimate_sigma", stated.get(term.stated[0].name, 0.0), term.size)
        for term in (LEVER_ARM, DELAY)
    )
    shared = np.square(stated.get(COMMON.name, 0.0))  # in both sigmas, once in the difference at most
    own = np.maximum(estimated("position_sigma", np.nan, 3) ** 2 - shared, 0.0)
    variance = own + fixes.position_sigma[rows] ** 2
    variance = variance + np.einsum("kij,kj->ki", C_nb**2, arm_sigma**2) + (velocity * delay_sigma) ** 2
    if "attitude_sigma" in outputs:
        north, east, down = (between(outputs["attitude_sigma"]) ** 2).T
        n, e, d = (arm_n**2).T
        variance = variance + np.stack([east * d + down * e, north * d + down * n, north * e + east * n], axis=1)
    return position + arm_n, np.sqrt(variance)


def attitude_between(early: Array, late: Array, share: Array) -> Array:
    """Quaternions (k, 4) at the shares (k, 1) of the way from `early` to `late` (k, 4), which are near each other."""
    late = np.where(np.sum(early * late, axis=1, keepdims=True) < 0.0, -late, late)
    mixed = early + share * (late - early)
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))
