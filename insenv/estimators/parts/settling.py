"""Whether an alignment has settled: the change of its answer since earlier answers is a part of its stated accuracy.

An alignment in place on a swaying base converges steeply, and the size of the sway is not known in advance. Answers are
therefore stored at times that grow by the factor `GROWTH`, and the present one is compared with the last `ANSWERS`. The
difference of two efficient estimates has the difference of their variances as its variance, so a change of up to `EXPECTED`
standard deviations is noise, which is stated already; the rest is motion that has not averaged out. What motion of bounded
size leaves in an answer falls with time, of level as 1 / time and of heading faster, so a change since an earlier answer counts
in the proportion of the time in that answer to the time in this one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.base.remarks import declared
from insenv.core.elementary import maximum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.parts import frozen_frame
from insenv.estimators.parts.finding import Finding
from insenv.estimators.parts.inertial_vectors import LARGEST_HEADING_SIGMA

ANSWERS = 6  # stored: few of them may agree with the present one by chance, as a slow motion swings
GROWTH = 1.25  # of the time from one stored answer to the next
FIRST = 1.0  # s: time of the first stored answer
EXPECTED = 1.0  # standard deviations
SETTLED = 1.6  # an answer counts from this multiple of the time that the windows lose
STATED = 2.0  # an answer is stated from this multiple: there is an earlier one that counts
SAID, SAID_IN_PART = 2.0, 1.5  # times what the sensors make; chance alone makes up to 1.8 in a calm sea
LEAST_VARIANCE = 1e-16  # rad^2
UNSETTLED_TILT = 0.05  # rad: level before that, from the mean force of a base that sways

STATE = Table((
    Row("answers", "The last answers kept, youngest first: take b components at the start to n at the start", "1",
        (ANSWERS, 4)),
    Row("answer_times", "Their times", "s", (ANSWERS,)),
    Row("answer_variances", "Variances about n that errors of the sensors set then", "rad^2", (ANSWERS, 3), "n"),
    Row("answer_due", "1 when the answer is to be kept", "1"),
))  # fmt: skip


RATIO = Row("motion_ratio", "Standard deviation of the heading by slow motion of the base, over that by the sensors", "1")


def due(x: Any, time: Any) -> Any:
    """1 if the answer at `time` (s) is to be kept."""
    return time >= maximum(GROWTH * x.answer_times[0], FIRST)


def keeping(answer: Callable[[Any], Any], variance: Callable[[Any, Any], Any]) -> Step:
    """The step that keeps an answer.

    answer: ``x -> (4)``, a unit quaternion.  variance: ``p, x -> (3)``, what its errors have without motion, rad^2.
    """

    def keep(p: Any, x: Any, u: Any) -> dict[str, Any]:
        return {
            "answers": ca.vertcat(answer(x).T, x.answers[:-1, :]),
            "answer_times": ca.vertcat(x.time, x.answer_times[:-1]),
            "answer_variances": ca.vertcat(variance(p, x).T, x.answer_variances[:-1, :]),
            "answer_due": 0,
        }

    return Step(keep, when="answer_due")


def moved(x: Any, answer: Any, lost: Any, variance: Any) -> Any:
    """Variance of attitude about n (3, rad^2) by which the answer has moved beyond what errors of the sensors explain.

    answer: that of now (4).  lost: time that the windows leave out of the run, s.  variance: that of the answer's errors
    without motion (3, rad^2).
    """
    back = frozen_frame.q_n0n(x.half_turn, x.axis_n)
    excess = ca.SX.zeros(3)
    for i in range(ANSWERS):
        change = attitude.rotate_inverse(back, attitude.error_rotation_vector(answer, x.answers[i, :].T))
        expected = EXPECTED**2 * maximum(x.answer_variances[i, :].T - variance, 0.0)
        counts = x.answer_times[i] >= SETTLED * lost
        share = counts * (x.answer_times[i] - lost) / maximum(x.time - lost, FIRST)  # 0: not kept yet
        excess = maximum(excess, share**2 * (change**2 - expected))
    return excess


def stated(x: Any, lost: Any, variance: Any, motion: Any) -> Any:
    """Stated standard deviations of attitude about n (3, rad).

    lost, variance: as of `moved`; motion: what it gives for them (3, rad^2).
    """
    early = ca.logic_and(lost > 0, x.time < STATED * lost)
    rough = ca.vertcat(UNSETTLED_TILT, UNSETTLED_TILT, LARGEST_HEADING_SIGMA)
    return select(early, maximum(rough, ca.sqrt(variance)), ca.sqrt(variance + motion))


def motion_ratio(variance: Any, motion: Any) -> Any:
    """The output `RATIO`; variance, motion: as of `stated`."""
    return ca.sqrt(motion[2] / maximum(variance[2], LEAST_VARIANCE))


_MOVES = (
    "the answer still moves, as on a base that moves slowly: this makes the heading {ratio} times as uncertain as the errors "
    "of the sensors do, which its stated sigma counts"
)
_COUNTED = declared("answer-moves", _MOVES + "; fusion models such motion")
_COUNTED_IN_PART = declared(
    "answer-moves-much", _MOVES + " only in part, so that errors exceed 3 sigma too often; q-method counts it, fusion models it"
)


def findings(parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """Whether slow motion of the base makes the heading worse than the sensors do, for an alignment that counts it."""
    return (Finding(RATIO.name, _COUNTED, 1.0, limit=SAID),)


def findings_in_part(parameters: Mapping[str, Any]) -> tuple[Finding, ...]:
    """The same for one whose stated sigma does not count it whole."""
    return (Finding(RATIO.name, _COUNTED_IN_PART, 1.0, limit=SAID_IN_PART),)
