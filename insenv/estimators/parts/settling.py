"""Whether an alignment has settled: the change of its answer since earlier answers is a part of its stated accuracy.

An alignment in place on a swaying base converges steeply, and the size of the sway is not known in advance. Answers are
therefore stored at times that grow by the factor `GROWTH`, and the present one is compared with the last `ANSWERS`. The
difference of two efficient estimates has the difference of their variances as its variance, so a change of up to `EXPECTED`
standard deviations is noise, which is stated already; the rest is motion that has not averaged out. What motion of bounded
size leaves in an answer falls with time, of level as 1 / time and of heading faster, so a change since an earlier answer counts
in the proportion of its time to now.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.elementary import maximum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.parts import frozen_frame
from insenv.estimators.parts.inertial_vectors import LARGEST_HEADING_SIGMA

ANSWERS = 6  # stored: few of them may agree with the present one by chance, as a slow motion swings
GROWTH = 1.25  # of the time from one stored answer to the next
FIRST = 1.0  # s: time of the first stored answer
EXPECTED = 1.0  # standard deviations
SETTLED = 1.6  # an answer counts from this multiple of the time that the windows lose
UNSETTLED_TILT = 0.05  # rad: level before that, from the mean force of a base that sways

STATE = Table((
    Row("answers", "The last answers kept, youngest first: take b components at the start to n at the start", "1",
        (ANSWERS, 4)),
    Row("answer_times", "Their times", "s", (ANSWERS,)),
    Row("answer_due", "1 when the answer is to be kept", "1"),
))  # fmt: skip


def due(x: Any, time: Any) -> Any:
    """1 if the answer at `time` (s) is to be kept."""
    return time >= maximum(GROWTH * x.answer_times[0], FIRST)


def keeping(answer: Callable[[Any], Any]) -> Step:
    """The step that keeps an answer; answer: ``x -> (4)``, a unit quaternion."""

    def keep(p: Any, x: Any, u: Any) -> dict[str, Any]:
        return {
            "answers": ca.vertcat(answer(x).T, x.answers[:-1, :]),
            "answer_times": ca.vertcat(x.time, x.answer_times[:-1]),
            "answer_due": 0,
        }

    return Step(keep, when="answer_due")


def stated(x: Any, answer: Any, lost: Any, sigma: Callable[[Any], Any]) -> Any:
    """Stated standard deviations of attitude about n (3, rad).

    answer: that of now (4). lost: time that the windows leave out of the run, s. sigma: standard deviations (3, rad)
    that sensor errors set after a time (s).
    """
    now, back = sigma(x.time), frozen_frame.q_n0n(x.half_turn, x.axis_n)
    excess = ca.SX.zeros(3)
    for i in range(ANSWERS):
        moved = attitude.rotate_inverse(back, attitude.error_rotation_vector(answer, x.answers[i, :].T))
        expected = EXPECTED**2 * maximum(sigma(x.answer_times[i]) ** 2 - now**2, 0.0)
        aged = select(x.answer_times[i] > 0, x.answer_times[i] / maximum(x.time, FIRST), 1.0)  # 1: not stored yet
        excess = maximum(excess, aged**2 * (moved**2 - expected))
    unsettled = ca.logic_and(lost > 0, x.time < SETTLED * lost)
    rough = ca.vertcat(UNSETTLED_TILT, UNSETTLED_TILT, LARGEST_HEADING_SIGMA)
    return select(unsettled, maximum(rough, now), ca.sqrt(now**2 + excess))
