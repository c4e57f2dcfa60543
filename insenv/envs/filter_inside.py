"""The filter that runs inside an environment: the loop of plant and estimator, and what is read of it.

A filter can run inside if it navigates with GNSS and keeps a covariance and its latest innovations as state.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import isqrt, log
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv import attitude, estimators, geodesy
from insenv.core import elementary, symmetric
from insenv.core.elementary import maximum, select
from insenv.core.model import Model, Values
from insenv.core.tables import Row, Table
from insenv.envs.knowledge import TOLD
from insenv.envs.referee import true_position
from insenv.errors import InputError
from insenv.estimators import Estimator
from insenv.evaluation.consistency import nees
from insenv.plant import loop_model
from insenv.plant.loop import PREFIX
from insenv.plant.scaled import SCALE, scaled_model
from insenv.vehicles import TRUTH_STATE

LN10 = log(10.0)
SMALLEST = 1e-15
"""What logarithms are taken of is at least that, SI."""
SCALED = PREFIX + SCALE
"""State row of the factors on the filter's noises."""

TRUTH = Table((
    *(TRUTH_STATE[name] for name in ("q_nb", "velocity_n")),
    Row("position", "True position of the inertial unit from the start as told", "m", (3,), "n"),
))  # fmt: skip
"""Rows that infos have of the truth."""
ERROR = Row("error", "Error of the filter in n: rotation vector (rad), velocity (m/s), position (m)", "1", (9,), "n")


@dataclass(frozen=True, eq=False)
class Inner:
    """A plant with a filter behind it.

    estimator: as registered.  model: of plant and filter; the filter's rows have the prefix `PREFIX`.
    """

    estimator: Estimator
    model: Model

    @property
    def states(self) -> int:
        """Number of the filter's error states."""
        elements = self.estimator.model.state["covariance"].size
        return (isqrt(8 * elements + 1) - 1) // 2

    def own(self, p: Values, x: Values) -> tuple[Values, Values]:
        """The filter's parameters and state by its own names."""
        model = self.estimator.model
        return tuple(
            SimpleNamespace(**{row.name: getattr(values, PREFIX + row.name) for row in table})
            for values, table in ((p, model.parameters), (x, model.state))
        )  # type: ignore[return-value]

    def found(self, p: Values, x: Values) -> Values:
        """The filter's outputs by name."""
        return SimpleNamespace(**self.estimator.model.output(*self.own(p, x)))

    def error(self, p: Values, x: Values) -> Any:
        """The row `ERROR`: estimate minus truth."""
        found = self.found(p, x)
        places = [(v.latitude, v.longitude, v.height) for v in (found, x)]
        return ca.vertcat(
            attitude.error_rotation_vector(found.q_nb, x.q_nb),
            found.velocity_n - x.velocity_n,
            geodesy.ned_offset(*places[0], *places[1]),
        )

    def nees(self, p: Values, x: Values) -> tuple[Any, int]:
        """Normalised estimation error squared, and its degrees of freedom."""
        return nees(self.estimator, self.own(p, x)[1], self.found(p, x), x)

    def sigma(self, x: Values) -> Any:
        """Standard deviations of the filter's error states (`states`), in its own order and units; 0 where a variance is not
        positive."""
        variance = getattr(x, f"{PREFIX}covariance")[symmetric.diagonal_places(self.states)]
        return ca.sqrt(select(variance > 0.0, variance, 0.0))


@lru_cache(maxsize=32)
def inner_loop(plant: Model, id: str, scaled: tuple[str, ...] = ()) -> Inner:
    """The loop of a plant and the filter `id`, with factors on its rows `scaled`.  Raises `InputError` for a filter that cannot
    run inside, and for a plant without GNSS.
    """
    estimator = estimators.get(id)
    if not fits(estimator, scaled):
        able = [name for name, other in estimators.registered().items() if fits(other, scaled)]
        raise InputError(f"estimator = {id!r}: allowed are filters that can run inside this environment: {', '.join(able)}")
    if "gnss_valid" not in plant.state:
        raise InputError(f"estimator {id!r} needs GNSS fixes: the scenario has no [gnss]")
    model = scaled_model(estimator.model, scaled) if scaled else estimator.model
    return Inner(estimator, loop_model(plant, model))


def fits(estimator: Estimator, scaled: tuple[str, ...] = ()) -> bool:
    """Whether an estimator can run inside, with those of its rows scaled."""
    model = estimator.model
    return (
        estimator.navigates
        and estimator.aided
        and not estimator.smooths
        and all(name in model.state for name in ("covariance", "innovation", "test_ratio"))
        and all(name in model.parameters or name in model.inputs for name in scaled)
    )


def truth(p: Values, x: Values) -> dict[str, Any]:
    """Values of `TRUTH`."""
    return {"q_nb": x.q_nb, "velocity_n": x.velocity_n, "position": true_position(p, x)}


def bounded(value: Any, row: Row) -> Any:
    """The value within the row's bounds; what is no number becomes the lower one."""
    value = select(value >= row.lower, value, row.lower)
    return select(value <= row.upper, value, row.upper)


def within(table: Table, values: dict[str, Any]) -> dict[str, Any]:
    """Those of `values` that the table has, each within its row's bounds."""
    return {row.name: bounded(values[row.name], row) for row in table}


def log10(value: Any) -> Any:
    """Decimal logarithm, element by element; of `SMALLEST` for what is smaller or no number."""
    value = ca.SX(value)
    safe = select(value >= SMALLEST, value, SMALLEST)
    return ca.vertcat(*(elementary.log(maximum(safe[i], SMALLEST)) for i in range(safe.numel()))) * (1.0 / LN10)


def power10(value: Any) -> Any:
    """10 to the power of each element."""
    return ca.vertcat(*(elementary.exp(value[i] * LN10) for i in range(value.numel())))


COMMON = TOLD + Table((Row("round_limit", "Actions in an episode", start=1.0, lower=1.0, upper=1e9),))
"""Parameters of all environments with a filter inside."""
