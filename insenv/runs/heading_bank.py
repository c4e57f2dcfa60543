"""The attitude of a recorded log's start from its motion: a bank of filters, one for each heading.

A linearised filter that starts with a heading far from the true one settles on a wrong heading, and its innovations show it:
so do those of all headings but the right one.  `COUNT` filters `loosely-coupled` run side by side, their headings
`SPACING` apart, each with a standard deviation of half of that.  The cost of each is the sum of its squared test ratios over
the fixes, of which one counts `LARGEST` at most: minus twice the logarithm of its likelihood, but for outliers.  The bank has
decided when every filter whose heading is not that of the best one costs `MARGIN` more, the best one fits and knows its heading
to `KNOWN`; it goes on alone for a while.

The best filter's attitude then is carried back to the start: a filter without fixes, from the same start and with the bias
that was found, shows what the gyros turn meanwhile, and what is left is the error of that start.

Whatever moves shows its heading so, forwards or sideways, at rest before or not; a vehicle that stays, or flies straight at a
constant speed, does not.

Source: multiple models, Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001),
section 11.6.2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from insenv import attitude
from insenv.base.errors import InputError
from insenv.base.remarks import Doubt, Remark, declared
from insenv.core.runner import make_runner
from insenv.core.tables import Array
from insenv.estimators import Estimator, Knowledge, get
from insenv.estimators.parts.applicability import LINEAR_HEADING, LINEAR_TILT
from insenv.logs import RecordedLog
from insenv.logs.instruments import sample_columns
from insenv.runs.instrument_start import Heading
from insenv.runs.rest import wrapped
from insenv.scenario.inputs import input_rows

COUNT = 12
SPACING = 2 * np.pi / COUNT
LARGEST = 25.0
"""Largest squared test ratio of a component that counts: five standard deviations."""
MARGIN = 40.0
"""Cost by which another heading must be worse: it is e^20 times less likely."""
PLAUSIBLE = 6.0
"""Mean squared test ratio of the best filter, of 1 if all is as stated, beyond which none of them is right."""
SAME = float(np.radians(20.0))
"""Headings that differ by less are one answer (rad)."""
KNOWN = float(np.radians(5.0))
"""Standard deviation of the heading (rad) with which the bank may decide."""
ENOUGH, FURTHER_S = float(np.radians(1.5)), 30.0
"""The best filter goes on until it knows its heading so well (rad), for this time (s) at most."""
LARGEST_TILT = float(np.radians(6.0))
"""Standard deviation of an unknown level in a filter of the bank (rad)."""
LONGEST_S = 600.0
"""Time after which a bank that has not decided does not."""
WIDENED = 3.0
"""Factor on the sigma that is stated of the start, because the filter that starts from it uses the same fixes once more; up to
what a linearised filter starts from, as those of the bank do."""
CONFLICT = 3.0
"""Standard deviations by which a stated heading and that of the motion may differ."""
LEAST_SIGMA = float(np.radians(1.0))
"""Smallest standard deviation that is stated of a heading (rad): scale factors turn what is carried back."""
BY_BANK = declared(
    "heading-by-bank",
    "the heading at the start, {heading:.4g} deg (1 sigma {sigma:.2g} deg), is that of a filter that fits the "
    "fixes after {time:.3g} s: twelve were started with headings 30 deg apart",
)


@dataclass(frozen=True)
class Answer:
    """Roll, pitch and heading at the start, the standard deviations to start with of tilt and heading, that of the heading by
    itself (rad), and the time it took (s)."""

    roll: float
    pitch: float
    heading: float
    tilt_sigma: float
    heading_sigma: float
    measured_sigma: float
    after_s: float

    def remark(self) -> Remark:
        """What is said of it."""
        heading, sigma = np.degrees(self.heading) % 360.0, np.degrees(self.heading_sigma)
        return BY_BANK.filled(heading=heading, sigma=sigma, time=self.after_s)


def attitude_by_motion(log: RecordedLog, first: int, known: Knowledge) -> Answer | None:
    """The attitude where sample `first` begins, by the fixes after it; None without fixes, or if they do not show the heading.

    known: what is known of the start but the heading.
    """
    return None if log.gnss is None else _by_bank(sample_columns(log, slice(first, None))[0], known)


def _by_bank(columns: Mapping[str, Array], known: Knowledge) -> Answer | None:
    estimator = get("loosely-coupled")
    fixes = np.flatnonzero(columns["gnss_valid"])
    passed = np.cumsum(columns["dt"])
    start = replace(known, heading_sigma=SPACING / 2, tilt_sigma=min(known.tilt_sigma, LARGEST_TILT))
    headings = [float(wrapped(SPACING * k)) for k in range(COUNT)]
    bank = [_filter(estimator, replace(start, heading=heading)) for heading in headings]
    cost, number, begin, decided = np.zeros(COUNT), 0, 0, np.inf
    for fix in fixes[passed[fixes] <= LONGEST_S]:
        part = {name: column[begin : fix + 1] for name, column in columns.items()}
        inputs = input_rows(estimator.model, part, fix + 1 - begin)
        ends = [estimator.model.outputs.unpack(each.run(len(inputs), inputs, len(inputs))[-1]) for each in bank]
        begin = int(fix) + 1
        cost += [_cost(end) for end in ends]
        number += int(np.count_nonzero(ends[0]["test_ratio"]))
        best = int(np.argmin(cost))
        sigma = ends[best]["attitude_sigma"][2]
        plausible = cost[best] <= PLAUSIBLE * number
        if not np.isfinite(decided) and plausible and sigma < KNOWN and _decided(cost, best, ends):
            bank, headings, cost, ends, best = [bank[best]], [headings[best]], cost[[best]], [ends[best]], 0
            decided = passed[fix]
        if (sigma < ENOUGH and np.isfinite(decided)) or passed[fix] > decided + FURTHER_S:
            return _carried_back(estimator, columns, replace(start, heading=headings[best]), ends[best], begin)
    return None


_REPLACED = declared(
    "heading-replaced",
    "the given heading, {heading:.4g} deg, contradicts the motion by {apart:.3g} deg: navigation starts with {chosen:.4g} deg "
    "(1 sigma {sigma:.2g} deg), with which the fixes agree",
)


_BY_INSTRUMENT = declared(
    "heading-by-instrument",
    "the heading at the start, {heading:.4g} deg (1 sigma {sigma:.2g} deg), is that of {called}",
)
_INSTRUMENT_CONTRADICTED = declared(
    "heading-instrument-contradicted",
    "the heading of {called} is {shown:.4g} deg, and that of the motion {heading:.4g} deg: navigation starts with that of the "
    "motion; look at the axes of the instrument, and at iron and currents near it",
    Doubt,
)


def heading_of(
    stated: Mapping[str, Any], sigma: float, answer: Answer | None, shown: Heading | None
) -> tuple[float, float, tuple[Remark, ...]]:
    """Heading at the start and its standard deviation (rad): the stated one, unless the motion contradicts it; or else that of
    the motion or of an instrument at rest, whichever is surer.

    stated: of [initial], by the fields of `Knowledge`; sigma: of its heading.  answer: of the motion.  shown: by an instrument.
    Raises `InputError` if there is no heading.
    """
    if "heading" not in stated:
        if answer is None and shown is None:
            raise InputError(
                "heading at the start: no instrument measures it, and the vehicle does not move, or no heading fits its fixes "
                "within the grade of the unit and their sigmas; give [initial] heading_deg, or heading_sigma_deg = 180 for an "
                "estimator that finds it (aqe-sukf in motion, fusion in place with gyros that find north), or use --start "
                "reference"
            )
        return _shown(answer, shown)
    heading = stated["heading"]
    if answer is None:
        return heading, sigma, ()
    apart = abs(float(wrapped(heading - answer.heading)))
    if apart <= CONFLICT * np.hypot(sigma, answer.measured_sigma):
        return heading, sigma, ()
    answered, answered_sigma = np.degrees(answer.heading) % 360.0, np.degrees(answer.heading_sigma)
    said = _REPLACED.filled(heading=np.degrees(heading), apart=np.degrees(apart), chosen=answered, sigma=answered_sigma)
    return answer.heading, answer.heading_sigma, (said,)


def _shown(answer: Answer | None, shown: Heading | None) -> tuple[float, float, tuple[Remark, ...]]:
    """The surer of both headings, and what is said of it."""
    if shown is None:
        assert answer is not None
        return answer.heading, answer.heading_sigma, (answer.remark(),)
    sigma = started_with(shown)
    heading = np.degrees(shown.heading) % 360.0
    if answer is not None:
        apart = abs(float(wrapped(shown.heading - answer.heading)))
        if apart > CONFLICT * np.hypot(shown.sigma, answer.measured_sigma):
            moving = np.degrees(answer.heading) % 360.0
            said = _INSTRUMENT_CONTRADICTED.filled(called=shown.called, shown=heading, heading=moving)
            return answer.heading, answer.heading_sigma, (answer.remark(), said)
        if answer.heading_sigma <= sigma:
            return answer.heading, answer.heading_sigma, (answer.remark(),)
    return shown.heading, sigma, (shown_remark(shown),)


def started_with(shown: Heading) -> float:
    """The standard deviation (rad) with which a filter starts from a heading of an instrument, whose readings it uses again."""
    return float(np.clip(WIDENED * shown.sigma, LEAST_SIGMA, max(LINEAR_HEADING, shown.sigma)))


def shown_remark(shown: Heading) -> Remark:
    """What is said of a start with a heading of an instrument."""
    heading, sigma = np.degrees(shown.heading) % 360.0, np.degrees(started_with(shown))
    return _BY_INSTRUMENT.filled(heading=heading, sigma=sigma, called=shown.called)


def _cost(end: Mapping[str, Array]) -> float:
    cost = float(np.minimum(end["test_ratio"] ** 2, LARGEST).sum())
    return cost if np.isfinite(cost) else np.inf


def _decided(cost: Array, best: int, ends: list[dict[str, Array]]) -> bool:
    """Whether no filter with another heading is about as good as the best."""
    now = np.array([attitude.numeric.to_euler(end["q_nb"])[2] for end in ends])
    apart = np.abs(wrapped(now - now[best])) > SAME
    return bool(np.all(cost[apart] > cost[best] + MARGIN))


def _filter(estimator: Estimator, known: Knowledge) -> Any:
    return make_runner(estimator.model, estimator.parameters(known))


def _carried_back(
    estimator: Estimator, columns: Mapping[str, Array], start: Knowledge, end: Mapping[str, Array], count: int
) -> Answer:
    """The attitude at the first sample from the outputs `end` of the best filter after `count` samples; `start`: of that."""
    free = {name: column[:count] for name, column in columns.items() if not name.startswith("gnss_")}
    inputs = input_rows(estimator.model, free, count)
    runner = _filter(estimator, replace(start, gyro_bias=end["gyro_bias"], accel_bias=end["accel_bias"]))
    turned = estimator.model.outputs.unpack(runner.run(count, inputs, count)[-1])["q_nb"]
    error = attitude.numeric.to_dcm(end["q_nb"]) @ attitude.numeric.to_dcm(turned).T
    C_nb = error @ attitude.numeric.to_dcm(attitude.numeric.from_euler(start.roll, start.pitch, start.heading))
    roll, pitch = np.arctan2(C_nb[2, 1], C_nb[2, 2]), -np.arcsin(np.clip(C_nb[2, 0], -1.0, 1.0))
    after = float(columns["dt"][:count].sum())
    white, bias = start.sensors.angle_random_walk * np.sqrt(after), float(end["gyro_bias_estimate_sigma"].max()) * after
    drift = float(np.hypot(white, bias))
    tilt, heading = float(end["attitude_sigma"][:2].max()), float(end["attitude_sigma"][2])
    return Answer(
        float(roll),
        float(pitch),
        float(np.arctan2(C_nb[1, 0], C_nb[0, 0])),
        float(min(np.hypot(WIDENED * tilt, drift), start.tilt_sigma, LINEAR_TILT)),
        float(np.clip(np.hypot(WIDENED * heading, drift), LEAST_SIGMA, LINEAR_HEADING)),
        float(np.hypot(heading, drift)),
        after,
    )
