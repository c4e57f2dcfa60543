"""The referee: what an environment adds to a plant.  It keeps the latest fix, scores estimates, and ends the episode.

A round is: the step ``judge``, which scores the action against the truth as it stands, then the inertial samples until the
next.  Nothing here changes the plant or its noise, whose streams are those of `insenv run`.

Error measure, in units of the limit s of each of the k error components e (a rotation vector in n, and for navigation
velocity and position): ``m = ln(1 + sqrt(sum((e / s)^2) / k))``, at most `WORST`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.core.compose import Part
from insenv.core.elementary import clamp, log, minimum, select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.envs.knowledge import TOLD

WORST = 20.0
"""Largest value of the error measure: that of garbage."""
VELOCITY_RANGE = 1000.0
"""m/s for an action component of 1."""
POSITION_RANGE = 1e6
"""m for an action component of 1."""

FIX = Table((
    Row("fix_new", "1 if the fix came since the last step", lower=0.0, upper=1.0),
    Row("fix_count", "Number of fixes so far", lower=0.0, upper=1e9),
    Row("fix_time", "Time at which the latest fix was delivered", "s", lower=0.0, upper=1e6),
    Row("fix_delay", "Time from its epoch to its delivery", "s", lower=0.0, upper=1e6),
    Row("fix_position", "Antenna from the reference, latest fix", "m", (3,), "n", lower=-1e8, upper=1e8),
    Row("fix_position_sigma", "Its standard deviation, as the receiver reports", "m", (3,), "n", lower=0.0, upper=1e8),
    Row("fix_has_velocity", "1 if the latest fix has a velocity", lower=0.0, upper=1.0),
    Row("fix_velocity_n", "Velocity of the antenna, latest fix", "m/s", (3,), "n", lower=-1e5, upper=1e5),
    Row("fix_velocity_sigma", "Its standard deviation, as the receiver reports", "m/s", (3,), "n", lower=0.0, upper=1e5),
))  # fmt: skip
"""State rows of the latest fix, zeros before the first."""

SCORE = Table((
    Row("reward", "Reward of the latest action"),
    Row("terminated", "1 if the task is over", lower=0.0, upper=1.0),
    Row("truncated", "1 if the time is over", lower=0.0, upper=1.0),
    Row("declared", "1 if the agent has declared itself aligned", lower=0.0, upper=1.0),
    Row("diverged", "1 if the estimate was no estimate", lower=0.0, upper=1.0),
    Row("rounds", "Actions judged so far"),
))  # fmt: skip


def fix_part() -> Part:
    """Keeps the latest fix; reads the plant's gnss rows and `time`, and the parameters of `TOLD`."""

    def keep(p: Any, x: Any, u: Any) -> dict[str, Any]:
        antenna = geodesy.ned_offset(
            x.gnss_latitude, x.gnss_longitude, x.gnss_height, p.told_latitude, p.told_longitude, p.told_height
        )
        return {
            "fix_new": ca.SX(1),
            "fix_count": x.fix_count + 1.0,
            "fix_time": x.time,
            "fix_delay": x.gnss_age,
            "fix_position": antenna,
            "fix_position_sigma": x.gnss_position_sigma,
            "fix_has_velocity": x.gnss_velocity_valid,
            "fix_velocity_n": x.gnss_velocity_n,
            "fix_velocity_sigma": x.gnss_velocity_sigma,
        }

    return Part(state=FIX, steps={"keep_fix": Step(keep, when="gnss_valid")})


@dataclass(frozen=True)
class Referee:
    """What is scored: attitude alone (alignment) or also velocity and position (navigation).

    navigates: whether velocity and position are part of the action.  With it there is no declaring: the episode lasts its time.
    """

    navigates: bool

    @property
    def actions(self) -> Table:
        """The action's rows, each component in [-1, 1]."""
        quaternion = Row("estimate_q_nb", "Estimate of q_nb; any length but 0", "1", (4,), "n", (1, 0, 0, 0), -1.0, 1.0)
        if not self.navigates:
            return Table((quaternion, Row("declare", "Above 0: aligned, end the episode", start=-1.0, lower=-1.0, upper=1.0)))
        velocity = f"Estimate of velocity_n, in {VELOCITY_RANGE:g} m/s"
        position = f"Estimate of the position from the reference, in {POSITION_RANGE:g} m"
        return Table((
            quaternion,
            Row("estimate_velocity", velocity, "1", (3,), "n", 0.0, -1.0, 1.0),
            Row("estimate_position", position, "1", (3,), "n", 0.0, -1.0, 1.0),
        ))  # fmt: skip

    @property
    def components(self) -> int:
        """Number of error components."""
        return 9 if self.navigates else 3

    @property
    def error(self) -> Row:
        """State row of the errors, estimate minus truth."""
        what = "rotation vector (rad)" + (", velocity (m/s), position (m)" if self.navigates else "")
        return Row("error", f"Error of the latest estimate in n: {what}", "1", (self.components,), "n")

    @property
    def limit(self) -> Row:
        """Parameter row of the limits that errors are measured in."""
        meaning = "1-sigma limit of each component of the error"
        return Row("limit", meaning, "1", (self.components,), "n", 1.0, lower=1e-15, upper=1e9)

    def part(self) -> Part:
        """The scoring as a part of a model; its step ``judge`` runs only when it is called."""
        parameters = TOLD + Table((
            self.limit,
            Row("round_limit", "Actions in an episode", start=1.0, lower=1.0, upper=1e9),
            Row("time_weight", "Reward lost by using all the time before declaring", start=1.0, lower=0.0, upper=1e6),
        ))  # fmt: skip
        state = SCORE + Table((self.error, Row("never", "Always 0: what it is the condition of runs only when called")))
        return Part(parameters=parameters, state=state, inputs=self.actions, steps={"judge": Step(self._judge, when="never")})

    def _judge(self, p: Any, x: Any, u: Any) -> dict[str, Any]:
        given = ca.vertcat(*(getattr(u, row.name) for row in self.actions))
        outside = ca.sumsqr(select(ca.fabs(given) > 1.0 + 1e-9, 1.0, 0.0)) > 0.0
        # what is outside must not overflow in what follows
        action = self.actions.symbols(clamp(given, -1.0, 1.0))
        square = ca.dot(action.estimate_q_nb, action.estimate_q_nb)
        garbage = ca.logic_or(square < SHORT, outside)
        q_nb = select(square < SHORT, ca.SX([1, 0, 0, 0]), action.estimate_q_nb)
        error = attitude.error_rotation_vector(q_nb / ca.sqrt(select(square < SHORT, 1.0, square)), x.q_nb)
        if self.navigates:
            velocity = action.estimate_velocity * VELOCITY_RANGE - x.velocity_n
            error = ca.vertcat(error, velocity, action.estimate_position * POSITION_RANGE - true_position(p, x))
        ratio = error / p.limit
        measure = minimum(log(1.0 + ca.sqrt(ca.sumsqr(ratio) / self.components)), WORST)

        rounds = x.rounds + 1.0
        last = rounds >= p.round_limit
        share = 1.0 / p.round_limit
        left = 1.0 - x.rounds * share  # of the time, with this round
        if self.navigates:
            declared = ca.SX(0)
            paid, forfeit = share * measure, left * WORST
        else:
            declared = ca.logic_and(action.declare > 0.0, ca.logic_not(garbage))
            over = ca.logic_or(declared, last)
            paid = share * (p.time_weight + measure) + select(over, measure, 0.0)
            forfeit = left * (p.time_weight + WORST) + WORST
        terminated = ca.logic_or(declared, garbage)
        return {
            "reward": -select(garbage, forfeit, paid),
            "terminated": terminated,
            "truncated": ca.logic_and(last, ca.logic_not(terminated)),
            "declared": declared,
            "diverged": garbage,
            "rounds": rounds,
            "error": error,
            **({"fix_new": ca.SX(0)} if hasattr(x, "fix_new") else {}),
        }


SHORT = 1e-12
"""Square of a quaternion's length below which it tells no attitude."""


def true_position(p: Any, x: Any) -> Any:
    """Position of the inertial unit from the reference (m, n)."""
    return geodesy.ned_offset(x.latitude, x.longitude, x.height, p.told_latitude, p.told_longitude, p.told_height)
