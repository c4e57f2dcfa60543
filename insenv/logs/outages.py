"""Outages of GNSS in a recorded log: windows of time whose fixes are withheld from its estimators."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from insenv.base.errors import InputError, nearest
from insenv.core.tables import Array
from insenv.logs.formats.series import rows_of
from insenv.logs.recorded import GnssFixes, RecordedLog

OutagesLike = str | Iterable["str | Sequence[float]"]
"""``"100:160"``, ``"+100:+160"``, ``"every=120,length=60"``, or a list of such texts and of pairs ``(100.0, 160.0)``."""
ALLOWED = (
    "allowed is BEGIN:END in seconds on the clock of the log, as 100:160, with a plus sign both from the start of the replay "
    "on, as +100:+160, or every=S,length=S"
)
KEYS = ("every", "length")
_NUMBER = r"\d+\.?\d*(?:e[+-]?\d+)?"
_ON_CLOCK = re.compile(rf"(-?{_NUMBER}):(-?{_NUMBER})", re.IGNORECASE)
_SINCE_START = re.compile(rf"\+({_NUMBER}):\+({_NUMBER})", re.IGNORECASE)


@dataclass(frozen=True)
class Withheld:
    """The fixes that estimators do not get.

    windows (k, 2): begin and end of each outage, s on the clock of the log; a fix is withheld if it is valid at or after
    the begin and before the end, as in a scenario's `outages_s`.  fixes: the withheld ones, in order of time.
    resumed (k,): when the first fix after each outage arrives, s; infinite if there is none.  empty: number of windows of a
    regular pattern that hold no fix and are left out.
    """

    windows: Array
    fixes: GnssFixes
    resumed: Array
    empty: int = 0


def withheld(log: RecordedLog, outages: Iterable[Any], begin_s: float) -> tuple[RecordedLog, Withheld]:
    """The log without the fixes in the outages, and these.

    outages: as `listed` gives them.  begin_s: start of the replay, s on the clock of the log; a regular pattern has its first
    outage `every` seconds after it.

    Raises `InputError` for a wrong text, for windows outside the replay, that overlap, or in which there is no fix, and for
    a log without fixes.
    """
    gnss, end_s = log.gnss, float(log.imu_time[-1])
    if gnss is None:
        raise InputError("outages withhold fixes of GNSS: the log has none")
    stated: list[tuple[float, float]] = []
    regular: list[tuple[float, float]] = []
    for each in outages:
        if isinstance(each, str) and "=" in each:
            regular += _pattern(each, begin_s, end_s)
        else:
            stated.append(_window(each, begin_s, end_s))
    holding = [window for window in regular if np.any(_inside(gnss, *window))]
    windows = sorted(stated + holding)
    for one, next_one in pairwise(windows):
        if next_one[0] < one[1]:
            raise InputError(f"the outages {shown(*one)} and {shown(*next_one)} overlap: allowed are outages apart")
    for window in stated:
        if not np.any(_inside(gnss, *window)):
            raise InputError(f"outage {shown(*window)}: no fix of the log is in it, so there is nothing to compare with")
    if not windows:
        raise InputError("outages: no fix of the log is in any of them, so there is nothing to compare with")
    lost = np.any([_inside(gnss, *window) for window in windows], axis=0)
    if np.all(lost | (gnss.time < begin_s)):
        raise InputError("outages: they withhold every fix of the replay; allowed are outages that leave some")
    left = rows_of(gnss, ~lost)
    arrival = left.time if left.arrival is None else left.arrival
    resumed = [np.min(arrival[left.time >= end], initial=np.inf) for _, end in windows]
    return replace(log, gnss=left), Withheld(
        np.array(windows), rows_of(gnss, lost), np.array(resumed), len(regular) - len(holding)
    )


def shown(begin: float, end: float) -> str:
    """A window in words."""
    return f"{round(begin, 6):.10g} to {round(end, 6):.10g} s"


def listed(outages: OutagesLike) -> list[Any]:
    """One by one, texts and pairs.  Raises `InputError` for what is no list of them."""
    if isinstance(outages, str):
        return [outages]
    try:
        return list(outages)
    except TypeError:
        raise InputError(f"outages = {outages!r}: {ALLOWED}, or a list of these and of pairs of numbers") from None


def _window(outage: Any, begin_s: float, end_s: float) -> tuple[float, float]:
    """One window on the clock of the log."""
    offset = 0.0
    if isinstance(outage, str):
        match = _ON_CLOCK.fullmatch(outage.strip())
        if match is None:
            match, offset = _SINCE_START.fullmatch(outage.strip()), begin_s
        if match is None:
            raise InputError(f"outage {outage!r}: {ALLOWED}")
        pair = [float(text) + offset for text in match.groups()]
    else:
        try:
            pair = [float(number) for number in outage]
        except (TypeError, ValueError):
            raise InputError(
                f"outage {outage!r}: allowed is a pair of numbers (begin, end) in s, or a text: {ALLOWED}"
            ) from None
    if len(pair) != 2 or not np.isfinite(pair).all() or not pair[0] < pair[1]:
        raise InputError(f"outage {outage!r}: allowed are a begin and an end after it, in s")
    begin, end = pair
    if begin < begin_s - 1e-6 or end > end_s + 1e-6:
        meant = f"; +{begin:g}:+{end:g} counts from its start" if begin >= 0.0 and end <= end_s - begin_s else ""
        raise InputError(
            f"outage {shown(begin, end)}: allowed is a part of the replay, which covers {shown(begin_s, end_s)} on the clock "
            f"of the log{meant}"
        )
    return begin, end


def _pattern(text: str, begin_s: float, end_s: float) -> list[tuple[float, float]]:
    """The windows of a regular pattern: whole ones, the first `every` seconds after the start."""
    values: dict[str, float] = {}
    for part in text.split(","):
        key, _, number = (each.strip() for each in part.partition("="))
        if key not in KEYS:
            raise InputError(f"outages {text!r}: {key!r} is unknown{nearest(key, KEYS)}; allowed is every=S,length=S")
        if key in values or re.fullmatch(_NUMBER, number, re.IGNORECASE) is None or not 0.0 < float(number) < np.inf:
            raise InputError(f"outages {text!r}: allowed is every=S,length=S, each once, with numbers of seconds above 0")
        values[key] = float(number)
    if len(values) < len(KEYS) or values["length"] >= values["every"]:
        raise InputError(f"outages {text!r}: allowed is every=S,length=S with a length below every, so that fixes are left")
    count = int((end_s - begin_s - values["length"]) / values["every"] + 1e-9)
    if count < 1:
        raise InputError(f"outages {text!r}: the replay lasts {end_s - begin_s:.6g} s, which no whole outage fits into")
    begins = [begin_s + (k + 1) * values["every"] for k in range(count)]
    return [(begin, begin + values["length"]) for begin in begins]


def _inside(gnss: GnssFixes, begin: float, end: float) -> Any:
    return (gnss.time >= begin) & (gnss.time < end)
