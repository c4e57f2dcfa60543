"""Fixed-interval smoothing of a Kalman filter with feedback: Bryson and Frazier's adjoint filter, for any number n of states.

The backward pass carries the vector s (n) and the symmetric matrix L (n x n) of what the later measurements say about the error
state,

    smoothed error state = P s,   its covariance = P - P L P     (P of the filter at that instant, after correction)

from s = 0, L = 0 at the end:

    scalar measurement of sensitivity H, gain K, innovation e of variance S:
        s <- (I - K H)^T s + H^T e / S,   L <- (I - K H)^T L (I - K H) + H^T H / S
    turn T of the errors with the correction of the attitude, after the last scalar (`insenv.estimators.parts.error_model`),
    and a shear after it (`insenv.estimators.fusion.kept_sum`):
        s <- T^T s,   L <- T^T L T
    transition to the instant:
        s <- Phi^T s,   L <- Phi^T L Phi

No covariance is inverted, and process noise does not appear (it is in P).  The filter feeds its estimate back at each
measurement, so its state jumps by what it has just learnt.  s and L do not: they refer to innovations only, which are
the same with and without feedback, and P s is the error of the state as corrected at that instant.

Sources: Bryson and Frazier (1963) as modified for scalar measurements by Bierman (1973), "Fixed interval smoothing with
discrete measurements", Int. J. Control 18, 65-75.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca

from insenv.core import symmetric
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators.parts.error_model import TILT, adjoint_before, turn_of, turned, with_platform
from insenv.estimators.parts.kalman import Update


@dataclass(frozen=True)
class Shear:
    """A part T of a correction: the errors `rows` change with the errors `columns`, none of which is among them.

    Both are places in the error state (n); T = 1 but for the block of these rows and columns, which a record has.
    """

    rows: tuple[int, ...]
    columns: tuple[int, ...]


@dataclass(frozen=True)
class Group:
    """The scalar measurements that come at one event.

    flag: output row of the forward pass that is 1 at a sample with them.  rows: their record (`scalar_rows`).
    support: gives the states that their sensitivities can differ from 0 for; asked when the way back is built.
    """

    flag: Row
    rows: Table
    support: Callable[[], tuple[int, ...]]

    @property
    def count(self) -> int:
        """Number of scalars."""
        return self.rows.rows[0].shape[0]


@dataclass(frozen=True, eq=False)
class Smoothing:
    """A filter that records, and the way back.

    forward: the filter with the outputs below.  due: output row that is 1 where the covariance was propagated.
    groups: its measurements in the order in which they are used at a sample.  interval: output rows with the arguments of the
    transition.  nominal: output rows of the filter's state and covariance.  backward: the model that goes back.
    corrected: ``(state by name, error (n)) -> state rows``.  estimates: names of the estimated errors in `nominal`.
    reported: output rows that count what the measurements were worth, shown as the filter has them.
    seeking: row of `nominal` that is 1 until the filter has started for the last time, or empty: it starts once.  No later
    measurement tells of the state before that, which is not smoothed.
    """

    forward: Model
    backward: Model
    due: str
    groups: tuple[Group, ...]
    interval: Table
    nominal: Table
    n: int
    corrected: Callable[[Any, Any], Mapping[str, Any]]
    estimates: tuple[str, ...]
    reported: Table
    seeking: str = ""

    @property
    def events(self) -> Table:
        """The rows of events: `due`, then the flags of the groups."""
        return Table((self.forward.outputs[self.due], *(group.flag for group in self.groups)))


def scalar_rows(prefix: str, count: int, n: int, what: str, shear: Shear | None = None) -> Table:
    """The record of `count` scalar measurements of n states, after which a correction turns the errors, or shears them too."""
    return Table((
        Row(f"{prefix}_H", f"{what}: sensitivity to the error state", "SI", (count, n)),
        Row(f"{prefix}_gain", f"{what}: gain, 0 where it was not used", "SI", (count, n)),
        Row(f"{prefix}_weight", f"{what}: inverse variance of the innovation, 0 where it was not used", "SI", (count,)),
        Row(f"{prefix}_left", f"{what}: innovation minus what the ones before it explained", "SI", (count,)),
        Row(f"{prefix}_turn", f"{what}: rotation vector by which the correction turned the attitude", "rad", (3,), "w"),
        *((_shear_row(f"{prefix}_shear", f"{what}: block by which it sheared the errors", shear),) if shear else ()),
    ))  # fmt: skip


def _shear_row(name: str, meaning: str, shear: Shear) -> Row:
    return Row(name, meaning, "SI", (len(shear.rows), len(shear.columns)))


def recorded(prefix: str, update: Update, sheared: Any = None) -> dict[str, Any]:
    """The rows `scalar_rows` of an update; sheared: the block of its `Shear`, if it has one."""
    scalars = update.scalars
    return {
        f"{prefix}_H": ca.vertcat(*[s.H for s in scalars]),
        f"{prefix}_gain": ca.vertcat(*[s.gain.T for s in scalars]),
        f"{prefix}_weight": ca.vertcat(*[s.weight for s in scalars]),
        f"{prefix}_left": ca.vertcat(*[s.left for s in scalars]),
        f"{prefix}_turn": update.correction[TILT],
        **({} if sheared is None else {f"{prefix}_shear": sheared}),
    }


def used_row(group: int) -> str:
    """The input row that is 1 to go back over a scalar of a group, by its number."""
    return f"scalar_{group}_used"


def backward_model(
    id: str,
    n: int,
    parameters: Table,
    groups: Sequence[Group],
    interval: Table,
    transition: Callable[[Any, Any], Any],
    shear: Shear | None = None,
) -> Model:
    """The backward pass.  transition: ``(p, interval rows) -> A (n x n)``, that of `kalman.propagate`."""
    state = Table((
        Row("adjoint", "Adjoint s of the error state, from the later measurements", "1/SI", (n,)),
        Row("information", "Their information L on the error state, upper triangle by columns", "1/SI^2",
            (symmetric.triangle_size(n),)),
    ))  # fmt: skip
    inputs = Table((
        *(Row(used_row(k), "1 to go back over a scalar of that group", lower=0, upper=1) for k in range(len(groups))),
        Row("H", "Its sensitivity to the error state", "SI", (n,)),
        Row("gain", "Its gain, 0 where it was not used", "SI", (n,)),
        Row("weight", "Inverse variance of its innovation, 0 where it was not used", "SI"),
        Row("left", "Its innovation minus what the ones before it explained", "SI"),
        Row("turned", "1 to go back over a turn of the errors before it", lower=0, upper=1),
        Row("turn", "Rotation vector of that turn", "rad", (3,), "w"),
        *((_shear_row("shear", "Block of the shear after it", shear),) if shear else ()),
        Row("carried", "1 to go back over an interval after that", lower=0, upper=1),
    ))  # fmt: skip
    return Model(
        id=id,
        title="backward pass of the smoother",
        parameters=parameters,
        state=state,
        inputs=inputs + interval,
        outputs=state,
        # in the reverse order of the forward pass
        steps={
            **({"shear": Step(partial(_back_over_shear, n, shear), when="turned")} if shear else {}),
            "turn": Step(lambda p, x, u: _back_over_turn(n, x, u.turn), when="turned"),
            **{f"scalar_{k}": Step(_back_over(n, group.support), when=used_row(k)) for k, group in enumerate(groups)},
            "carry": Step(lambda p, x, u: back_over_interval(transition(p, u), x), when="carried"),
        },
        output=lambda p, x: vars(x),
    )


def _back_over_turn(n: int, x: Any, turn: Any) -> dict[str, Any]:
    """Go back over the turn of the errors with the attitude."""
    return {
        "adjoint": adjoint_before(x.adjoint, turn),
        "information": symmetric.triangle(turned(symmetric.full(x.information, n), with_platform(turn_of(turn).T))),
    }


def _back_over_shear(n: int, shear: Shear, p: Any, x: Any, u: Any) -> dict[str, Any]:
    """Go back over the shear of the errors after that turn."""
    rows, columns, block = list(shear.rows), list(shear.columns), u.shear
    s, L = ca.SX(x.adjoint), symmetric.full(x.information, n)
    s[columns] = s[columns] + block.T @ s[rows]
    L[columns, :] = L[columns, :] + block.T @ L[rows, :]
    L[:, columns] = L[:, columns] + L[:, rows] @ block
    return {"adjoint": s, "information": symmetric.triangle(L)}


def _back_over(n: int, support: Callable[[], tuple[int, ...]]) -> Callable[[Any, Any, Any], dict[str, Any]]:
    """Go back over a scalar measurement; a weight of 0 with a gain of 0 changes nothing."""

    def step(p: Any, x: Any, u: Any) -> dict[str, Any]:
        places = list(support())
        seen = ca.SX(n, 1)
        seen[places] = u.H[places]
        # (I - K H)^T L (I - K H) + H^T H / S, one side after the other: what is left of L after a precise fix is the small
        # difference of large numbers, and both sides at once would lose it
        L = symmetric.full(x.information, n)
        L = L - (L @ u.gain) @ seen.T
        L = L - seen @ (u.gain.T @ L) + seen @ seen.T * u.weight
        return {
            "adjoint": x.adjoint + seen * (u.weight * u.left - u.gain.T @ x.adjoint),
            "information": symmetric.triangle(L),
        }

    return step


def back_over_interval(A: Any, x: Any) -> dict[str, Any]:
    """Go back over an interval by the elementary matrices of `kalman.propagate`, transposed, the last one first."""
    n = A.shape[0]
    s = ca.vertsplit(x.adjoint)
    L = [[x.information[symmetric.place(i, j)] for j in range(n)] for i in range(n)]
    for i in reversed(range(n)):
        # x_i <- (1 + A_ii) (x_i + sum A_ij x_j); transposed, the component i is added to the components j
        if not A[i, i].is_zero():
            decay = 1 + A[i, i]
            s[i] = decay * s[i]
            square = decay * (decay * L[i][i])
            for k in range(n):
                L[i][k] = L[k][i] = decay * L[i][k]
            L[i][i] = square
        sources = [j for j in range(n) if j != i and not A[i, j].is_zero()]
        row = list(L[i])
        for j in sources:
            s[j] = s[j] + A[i, j] * s[i]
        for j in range(n):
            for k in range(j + 1):
                added: Any = 0
                if j in sources:
                    added = added + A[i, j] * row[k]
                if k in sources:
                    added = added + A[i, k] * (row[j] + (A[i, j] * row[i] if j in sources else 0))
                L[j][k] = L[k][j] = L[j][k] + added
    return {"adjoint": ca.vertcat(*s), "information": ca.vertcat(*[L[i][j] for j in range(n) for i in range(j + 1)])}
