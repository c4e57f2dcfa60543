"""The measurements of a fusion filter.

An `Aid` is one function of the navigation state: what its instrument should show minus what it shows.  Whoever adds one writes
that equation; its derivatives come from differentiation (`insenv.estimators.fusion.navigation`), and gating, counting and
smoothing are shared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from insenv.core.elementary import maximum
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.error_state import LARGEST
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts.rows import REPORTED, reported

Spread = Callable[[str], Any]
"""Variances (k) of the error of a state, by its name or "attitude"; 0 for a state that the filter does not have."""


AWAITED = Row("heading_awaited", "1 while measurements wait for a field that shows the heading")
AWAITED_TIME = Row("heading_awaited_time", "Time for which measurements have waited for a field that shows the heading", "s")
"""Of a filter with aids that are iterated (`insenv.estimators.fusion.awaited`)."""
NEVER = 1e9
"""s: time since the last measurement where there was none."""


@dataclass(frozen=True, eq=False)
class Aid:
    """A measurement of m scalars.

    id: short name, before the names of its rows.  title: what it is, for listings.
    size: m.  what: the components, for the meaning of rows ("position, then velocity").  frame: in which they are, if in one.
    residual: ``(p, seen, u) -> (m)``: predicted minus measured, of the navigation state `seen` (`navigation.Navigation`).
    variance: ``(p, x, u, spread) -> (m)``: of the measurement noise, and of what linearisation leaves out; spread: the
        variances of an error state by name (`Spread`).
    due: ``(p, x, u) -> 0 or 1`` in a sample: whether it measures now.  x is the state before the sample.
    sensors: ids of sensors that it needs; none for a constraint.
    inputs, parameters, state: its rows.  outputs: names of those of its state that are outputs too.
    present: ``(p, x, u) -> (m)``, 1 for the components that are there.  None: all are.
    age: name of the input row of the time from its validity to the end of the sample (s).  Empty: 0.
    gate: name of the parameter row of its innovation gate, in standard deviations.
    correlated: ``(p, x, since) -> (m)``: variance to add because a part of the error is that of the measurement `since` seconds
        before.  None: white.
    widened: ``(p, x) -> ()``: factor on all stated standard deviations, 1 where what the aid assumes holds.  None: 1.
    max_rejections: measurements refused in a row before the gate opens: a filter that refuses one after the other is wrong
        itself.
    restarts: whether measurements that are refused and agree with each other start position and velocity anew, before that
        (`insenv.estimators.fusion.restart`); its components are position and velocity in n.
    iterated: whether it shows so much attitude at once that a first order is not enough: an attitude that is not known well is
        then found first (`measurement.attitude_shown`), and its equation derived there.
    added: name of the constant error that adds to each component: corrections keep the sum
        (`insenv.estimators.fusion.kept_sum`).
    on_sample: ``(p, x, u, delta_angle, delta_velocity, change_w) -> rows`` of its `state` after a sample of corrected
        increments (rad, m/s, b) that changed the velocity by `change_w` (m/s, w).
    steps: further steps between the sample and the propagation of the covariance.
    triggers: name of a row that `on_sample` gives: where it is 1 the covariance is propagated at this sample.
    flag: state row by which its step runs, if a step of its own sets it; empty: one is made.
    groups: the components that are counted apart; empty: all together.
    renamed: names of rows of `reported`, if they are not ID_NAME, by NAME.
    causes: what to look at where its measurements do not fit the filter, for messages.
    holds: what its measurements hold of a navigation: height or vertical velocity, horizontal velocity or position, heading.
    """

    id: str
    title: str
    size: int
    what: str
    residual: Callable[[Any, Navigation, Any], Any]
    variance: Callable[[Any, Any, Any, Spread], Any]
    due: Callable[[Any, Any, Any], Any]
    unit: str = "SI"
    frame: str = ""
    sensors: tuple[str, ...] = ()
    inputs: Table = field(default_factory=Table)
    parameters: Table = field(default_factory=Table)
    state: Table = field(default_factory=Table)
    outputs: tuple[str, ...] = ()
    present: Callable[[Any, Any, Any], Any] | None = None
    age: str = ""
    gate: str = ""
    correlated: Callable[[Any, Any, Any], Any] | None = None
    widened: Callable[[Any, Any], Any] | None = None
    max_rejections: int = 10
    restarts: bool = False
    iterated: bool = False
    added: str = ""
    on_sample: Callable[..., Mapping[str, Any]] | None = None
    steps: Mapping[str, Step] = field(default_factory=dict)
    triggers: str = ""
    flag: str = ""
    groups: tuple[slice, ...] = ()
    renamed: Mapping[str, str] = field(default_factory=dict)
    causes: str = ""
    holds: tuple[str, ...] = ("vertical", "horizontal", "heading")

    @property
    def due_row(self) -> str:
        """The state row by which its step runs."""
        return self.flag or f"{self.id}_due"

    @property
    def wide_row(self) -> str:
        """The state row by which the attitude that it shows is found first, if it is `iterated`."""
        return f"{self.id}_wide"

    @property
    def far_row(self) -> str:
        """The state row by which its heading is found before that, all round."""
        return f"{self.id}_far"

    @property
    def misalignment_row(self) -> str:
        """The state row of that attitude."""
        return f"{self.id}_misalignment"

    @property
    def parts(self) -> tuple[slice, ...]:
        """The components that are counted apart."""
        return self.groups or (slice(0, self.size),)

    def row(self, name: str) -> str:
        """The name of one of the rows that every aid has, such as ``"since"``."""
        return self.renamed.get(name, f"{self.id}_{name}")

    @property
    def reported(self) -> Table:
        """State and output rows: its last innovation, and what the gate did so far (sums over all measurements)."""
        names = [self.row(name) for name in REPORTED]
        rows = reported(names, self.title, self.what, self.unit, self.size, self.frame, len(self.parts))
        return Table((*rows, *self._restarts, *((AWAITED_TIME,) if self.iterated else ())))

    @property
    def _restarts(self) -> tuple[Row, ...]:
        meaning = f"Times that position and velocity started anew, because refused measurements of {self.title} agreed"
        return (Row(self.row("restart_count"), meaning, "1"),) if self.restarts else ()

    @property
    def output_rows(self) -> Table:
        """What it shows: `reported`, and the rows `outputs`."""
        return self.reported + Table(tuple(self.state[name] for name in self.outputs))

    def shown(self, x: Any) -> dict[str, Any]:
        """The output rows, from the state."""
        return {row.name: getattr(x, row.name) for row in self.output_rows}

    @property
    def state_rows(self) -> Table:
        """State rows: those of `reported`, the ages and counts of the gate, and its own."""
        flag = () if self.flag else (Row(self.due_row, f"1 when {self.title} measures at this sample"),)
        iterated = (
            Row(self.wide_row, f"1 when {self.title} is to show an attitude that is not known well"),
            Row(self.far_row, f"1 when {self.title} is to show a heading that is not known"),
            AWAITED,
            Row(
                self.misalignment_row, "Misalignment that it then shows, which the next measurement takes out", "rad", (3,), "w"
            ),
        )
        agreed = Row(self.row("agreed"), "Those of them, the last ones, that agree with each other", "1")
        return (
            self.reported
            + Table((
                *flag,
                Row(self.row("since"), "Time since its last measurement", "s", start=NEVER),
                Row(self.row("refusals"), "Measurements in a row with an innovation beyond the gate", "1"),
                *((agreed,) if self.restarts else ()),
                *(iterated if self.iterated else ()),
            ))
            + self.state
        )  # fmt: skip


def noise_variance(sigma: Any, least: float) -> Any:
    """Variance of the noise of an instrument; of a perfect one that of `least`, which keeps the filter regular."""
    return maximum(sigma, least) ** 2


def beyond_linear(spread: Spread, square: Any) -> Any:
    """Variance of what linearisation leaves out of the component along a vector that the attitude turns; square: of its length.

    psi leaves 1 - cos psi = psi^2 / 2 of it, of which the second moment is 3/4 of the square of the variance of psi.
    """
    variance: Any = ca.sum1(spread("attitude"))
    return 0.75 * variance * variance * square


def waited(since: Any, u: Any, interval: Any) -> Any:
    """Whether a constraint last used `since` seconds before this sample is due again: to half a sample, at its end."""
    return since + u.dt * 1.5 > interval


def gate_row(id: str) -> Row:
    """The parameter row of an aid's innovation gate."""
    meaning = "Innovations beyond this many standard deviations are rejected; 0: none is"
    return Row(f"{id}_gate", meaning, start=5.0, lower=0.0, upper=LARGEST)


def repeated(value: Any, size: int) -> Any:
    """A number as `size` equal ones; a vector as it is."""
    value = ca.SX(value)
    return ca.repmat(value, size, 1) if value.numel() == 1 and size != 1 else value
