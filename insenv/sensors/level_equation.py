"""The measurement equation of an instrument at a known attitude, and what is stated of its errors.

A log shows the level at rest and, of a vehicle that travels along its course, the velocity in body axes: enough to compare what
an instrument reads with what it should read, without a filter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from insenv.core.model import Values
from insenv.core.tables import Array
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors.instrument import Instrument, Term, errors_of


class Level:
    """The motion (`insenv.sensors.instrument.Motion`) of a vehicle that does not turn, at an attitude C_nb and a velocity
    velocity_n (3, m/s); None: it stands."""

    climbed = 0.0

    def __init__(self, C_nb: Any, height: float, velocity_n: Any = None) -> None:
        self._C_nb, self.height, self._velocity_n = C_nb, height, velocity_n
        self.velocity_down = 0.0 if velocity_n is None else velocity_n[2]
        self.speed_squared = 0.0 if velocity_n is None else ca.sumsqr(velocity_n)
        self.specific_force_b = C_nb.T @ ca.vertcat(0, 0, -STANDARD_GRAVITY)
        self.displacement_n = ca.SX.zeros(3)

    def to_body(self, vector_n: Any) -> Any:
        return self._C_nb.T @ vector_n

    def to_navigation(self, vector_b: Any) -> Any:
        return self._C_nb @ vector_b

    def body_velocity(self, arm_b: Any, flow_n: Any = None) -> Any:
        flow = ca.SX.zeros(3) if flow_n is None else -self.to_body(flow_n)
        return flow if self._velocity_n is None else flow + self.to_body(self._velocity_n)


def equation_at(instrument: Instrument, motion: Any, stated: Mapping[str, Any], count: int) -> tuple[Any, Any, Array]:
    """The value (k) that filters compare, its errors (n) as symbols, and their variances (n) in a mean of `count` readings.

    stated: what is stated of the errors, by row name (SI).
    """
    table = instrument.all_parameters
    p = Values(**{**{row.name: row.flat_start().reshape(row.shape) for row in table}, **stated})
    values: dict[str, Any] = {}
    symbols: list[Any] = []
    variances: list[Array] = []
    for term in instrument.terms:
        variance = _variance(term, stated) / (count if term.kind == "white" else 1)
        if variance.any():
            rows, columns = (term.shape + (1, 1))[:2]
            error = ca.SX.sym(term.name, term.size)
            values[term.name] = error if columns == 1 else ca.reshape(error, columns, rows).T  # by rows
            symbols.append(error)
            variances.append(variance)
    value = ca.SX(instrument.measure(motion, errors_of(instrument, values), p)[instrument.compared.name])
    return value, ca.vertcat(*symbols), np.concatenate([np.zeros(0), *variances])


def _variance(term: Term, stated: Mapping[str, Any]) -> Array:
    """Variances of the elements of a term, by rows of a matrix, as they are stated."""
    variance = np.zeros(term.size)
    for row, (_, elements) in zip([each for each in term.stated if each is not term.time], term.parts, strict=False):
        variance[list(elements)] = np.asarray(stated.get(row.name, 0.0), dtype=float) ** 2
    return variance
