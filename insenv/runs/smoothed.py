"""Fixed-interval smoothing of a `loosely-coupled` run: one forward pass with a record, one backward pass."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv.core import symmetric
from insenv.core.numeric import vectorized
from insenv.core.runner import make_runner
from insenv.core.tables import Vector
from insenv.errors import InsenvError
from insenv.estimators import Estimator, loosely_coupled, smoother
from insenv.estimators.parts import rows, strapdown
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY, N
from insenv.plant.feeding import input_rows
from insenv.runs.follower import Follower
from insenv.runs.smoother_record import Record

Array = NDArray[np.float64]

_HEALTH = np.concatenate(
    [np.arange(smoother.MODEL.outputs.size)[smoother.MODEL.outputs.slice(n)] for n in rows.FIX_HEALTH.names]
)
"""Columns of the rows of health in the outputs of the forward pass."""
BLOCK = 2000  # samples filtered at a time: 7 MB


class Smoother:
    """A run of the filter that can be smoothed: `take` samples, then `smoothed`.

    parameters: of `loosely-coupled`, by row name. backend: as for `make_runner`.
    """

    def __init__(self, parameters: Mapping[str, Any] | Vector | None = None, backend: str | None = None) -> None:
        self.forward = make_runner(smoother.MODEL, parameters, backend)
        table = smoother.MODEL.parameters
        shared = {name: self.forward.p[table.slice(name)][0] for name in smoother.BACKWARD.parameters.names}
        self._backward = make_runner(smoother.BACKWARD, shared, backend)
        self.record = Record()
        self._health: list[Array] = []

    def take(self, columns: Mapping[str, Array], wanted: Array) -> None:
        """Filter samples. Raises `InsenvError` when the filter's estimate is no longer finite.

        columns: inputs of `loosely-coupled`, (samples, ...) by name. wanted (samples, bool): which samples to smooth.
        """
        inputs = input_rows(smoother.MODEL, {**columns, "smoothed": wanted.astype(np.float64)}, len(wanted))
        for begin in range(0, len(wanted), BLOCK):
            part = slice(begin, begin + BLOCK)
            outputs = self.forward.run(len(inputs[part]), inputs[part])
            if not np.isfinite(outputs[-1]).all():
                raise InsenvError("the filter under the smoother diverged: its outputs are no longer finite numbers")
            self.record.add(outputs, wanted[part])
            self._health.append(outputs[wanted[part]][:, _HEALTH])

    def smoothed(self) -> dict[str, Array]:
        """The smoothed run so far at the wanted samples: rows of `smoother_outputs`, time along the first axis."""
        corrections, covariances, nominal = self.error_states()
        return smoother_outputs(nominal, corrections, covariances)

    def health_rows(self) -> dict[str, Array]:
        """Rows of `rows.FIX_HEALTH` of the filter at the wanted samples, time along the first axis."""
        return rows.FIX_HEALTH.unpack(np.concatenate(self._health))

    def error_states(self) -> tuple[Array, Array, Array]:
        """Smoothed error states (n, 15), their covariances (n, 15, 15), and the filter's states (n, NOMINAL.size)."""
        found: list[tuple[Array, Array, Array]] = []
        self._backward.start()
        for inputs, instants, nominal in self.record.backward():
            # the state before the pass goes back into an instant holds the measurements after it
            states = np.concatenate([self._backward.output()[None], self._backward.run(len(inputs), inputs[::-1])])[-2::-1]
            later = smoother.BACKWARD_STATE.unpack(states[instants])
            found.append((*_smoothed_errors(nominal, later["adjoint"], later["information"]), nominal))
        found.reverse()
        corrections, covariances, nominals = (np.concatenate(part) for part in zip(*found, strict=True))
        return corrections, covariances, nominals


class SmoothingFollower(Follower):
    """The smoother along a run or a replay: its filter follows the samples, `named` smooths."""

    smoother: Smoother

    @classmethod
    def started(cls, estimator: Estimator, parameters: Mapping[str, Any], every: int) -> SmoothingFollower:
        """The smoother started with `parameters` (SI, by row name); outputs every `every` samples."""
        smoother = Smoother(parameters)
        follower = cls(estimator, smoother.forward, every)
        follower.smoother = smoother
        return follower

    def follow(self, columns: dict[str, Array], count: int) -> None:
        """Filter `count` samples (a multiple of `every`). Raises `InsenvError` if the estimate is no longer finite."""
        begin = time.process_time()
        self.smoother.take(columns, (np.arange(count) + 1) % self.every == 0)
        self.seconds += time.process_time() - begin

    def named(self) -> dict[str, Array]:
        """All outputs so far by row name, time along the first axis, smoothed; the rows of health are the filter's."""
        begin = time.process_time()
        outputs = {**self.smoother.smoothed(), **self.smoother.health_rows()}
        self.seconds += time.process_time() - begin
        return outputs


def smooth(
    parameters: Mapping[str, Any] | Vector, columns: Mapping[str, Array], every: int = 1, backend: str | None = None
) -> dict[str, Array]:
    """The smoothed run of `loosely-coupled` over the samples in `columns`, at every `every`-th of them.

    Rows by name as `smoother_outputs` gives them, time along the first axis.
    """
    run = Smoother(parameters, backend)
    run.take(columns, (np.arange(len(columns["dt"])) + 1) % every == 0)
    return run.smoothed()


def smoother_outputs(nominal: Array, corrections: Array, covariances: Array) -> dict[str, Array]:
    """Navigation and its standard deviations from the filter's states (n, NOMINAL.size) and smoothed error states.

    Rows by name: q_nb, velocity_n, latitude, longitude, height, gyro_bias, accel_bias, position_sigma, velocity_sigma
    (n), attitude_sigma (rad about n).  Where rounding leaves no positive variance (P - P L P of a filter that has diverged)
    the filter's own, which is larger, is stated.
    """
    values = smoother.NOMINAL.unpack(nominal)
    states = [values[name] for name in _NAVIGATION]
    *shown, C_nw = _corrected_outputs(*states, corrections)
    named = dict(zip((*rows.NAVIGATION.names, "gyro_bias", "accel_bias"), shown, strict=True))
    filtered = symmetric.full_array(values["covariance"], N)
    for name, part in (("position_sigma", POSITION), ("velocity_sigma", VELOCITY), ("attitude_sigma", TILT)):
        found, own = (np.einsum("nij,njk,nik->ni", C_nw, P[:, part, part], C_nw) for P in (covariances, filtered))
        named[name] = np.sqrt(np.where(found > 0.0, found, own))
    return named


def _smoothed_errors(nominal: Array, adjoint: Array, information: Array) -> tuple[Array, Array]:
    P = symmetric.full_array(smoother.NOMINAL.unpack(nominal)["covariance"], N)
    L = symmetric.full_array(information, N)
    return np.einsum("nij,nj->ni", P, adjoint), P - P @ L @ P


_NAVIGATION = tuple(name for name in smoother.NOMINAL.names if name != "covariance")


def _corrected(*arguments: Any) -> tuple[Any, ...]:
    *states, correction = arguments
    x = SimpleNamespace(**dict(zip(_NAVIGATION, states, strict=True)))
    changed = SimpleNamespace(**loosely_coupled.corrected(x, correction))
    outputs = strapdown.navigation_outputs(changed)
    shown = [outputs[name] for name in rows.NAVIGATION.names]
    return (*shown, changed.gyro_bias, changed.accel_bias, ca.SX(strapdown.C_nw(changed.q_ew)))


_corrected_outputs = vectorized(_corrected, *[smoother.NOMINAL[name].shape for name in _NAVIGATION], N)
