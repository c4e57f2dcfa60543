"""Fixed-interval smoothing of a filter's run: one forward pass with a record, one backward pass.

From a start that was far off both are done again (`insenv.runs.second_pass`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv.base.remarks import Remark
from insenv.core import symmetric
from insenv.core.numeric import vectorized
from insenv.core.runner import make_runner
from insenv.core.tables import Array, Table, Vector
from insenv.estimators import Estimator
from insenv.estimators.loosely_coupled import SMOOTHING
from insenv.estimators.parts import rows, strapdown
from insenv.estimators.parts.adjoint import Smoothing
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY, turn_of, turned, with_platform
from insenv.evaluation.health import Health
from insenv.runs.follower import Follower, diverged
from insenv.runs.second_pass import LARGEST, NOT_REACHED, PASSES, astray, told_start
from insenv.runs.smoothing_record import Record, Samples
from insenv.scenario.inputs import input_rows
from insenv.sensors.gnss import COMMON

BLOCK = 2000  # samples filtered at a time: 7 MB


class Smoother:
    """A run of a filter that can be smoothed: `take` samples, then `smoothed`.

    parameters: of the filter, by row name.  smoothing: its two passes.  backend: as for `make_runner`.
    apart: 0, or how far (rad) `smoothed` stayed from the start that the run tells.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | Vector | None = None,
        smoothing: Smoothing = SMOOTHING,
        backend: str | None = None,
    ) -> None:
        self.smoothing = smoothing
        self.forward = make_runner(smoothing.forward, parameters, backend)
        table, going_back = smoothing.forward.parameters, smoothing.backward.parameters
        shared = {row.name: self.forward.p[table.slice(row.name)].reshape(row.shape) for row in going_back}
        self._backward = make_runner(smoothing.backward, shared, backend)
        self.record = Record(smoothing)
        self.apart = 0.0
        self._start = self.forward.x.copy()
        started = self.forward.model.state.unpack(self._start)
        self._samples = None if smoothing.seeking and started[smoothing.seeking] > 0 else Samples()
        self._health_columns = _columns(smoothing.forward.outputs, [row.name for row in smoothing.reported])
        self._health: list[Array] = []

    def take(self, columns: Mapping[str, Array], wanted: Array) -> None:
        """Filter samples. Raises `InsenvError` when the filter's estimate is no longer finite.

        columns: inputs of the filter, (samples, ...) by name. wanted (samples, bool): which samples to smooth.
        """
        inputs = input_rows(self.forward.model, {**columns, "smoothed": wanted.astype(np.float64)}, len(wanted))
        for begin in range(0, len(wanted), BLOCK):
            block = inputs[begin : begin + BLOCK]
            self._filter(block, columns, begin)
            if self._samples is not None:
                self._samples.add(block)

    def _filter(self, inputs: Array, columns: Mapping[str, Array], begin: int) -> None:
        outputs = self.forward.run(len(inputs), inputs)
        if not np.isfinite(outputs[-1]).all():
            first = int(np.argmin(np.isfinite(outputs).all(axis=1)))
            raise diverged("the filter under the smoother", columns, begin + first)
        wanted = inputs[:, self.forward.model.inputs.slice("smoothed").start] != 0
        self.record.add(outputs, wanted)
        self._health.append(outputs[wanted][:, self._health_columns])

    def smoothed(self) -> dict[str, Array]:
        """The smoothed run so far at the wanted samples: rows of `smoother_outputs`, time along the first axis."""
        outputs = smoother_outputs(self.smoothing, *self.error_states())
        better = self._better_start(outputs)
        for _ in range(1, PASSES):
            if better is None or _angle(better[0]) > LARGEST:
                break
            self._filter_again(*better)
            outputs = smoother_outputs(self.smoothing, *self.error_states())
            better = self._better_start(outputs)
        self.apart = 0.0 if better is None else _angle(better[0])
        common = self.forward.model.parameters.unpack(self.forward.p).get(COMMON.name, 0.0)
        return {**outputs, "position_sigma": np.hypot(outputs["position_sigma"], common)}

    def _better_start(self, outputs: Mapping[str, Array]) -> tuple[Array, Array] | None:
        """What `told_start` gives, where that is far from the start; the pass back has just ended there."""
        if self._samples is None:
            return None
        told, x = self.smoothing.backward.state.unpack(self._backward.output()), self.forward.model.state.unpack(self._start)
        P, L = (symmetric.full_array(triangle, self.smoothing.n) for triangle in (x["covariance"], told["information"]))
        error, covariance = told_start(P, told["adjoint"], L)
        speed = np.linalg.norm(outputs["velocity_n"], axis=1)
        led_astray = astray(error[TILT], speed, outputs["attitude_sigma"], outputs["velocity_sigma"])
        return (error, covariance) if led_astray else None

    def _filter_again(self, error: Array, covariance: Array) -> None:
        """Filter the samples once more, from the start without its `error` (n,) and with this covariance (n, n)."""
        rows = self.forward.model.state
        self.forward.start()
        for name, value in _started_again(self.smoothing)(rows.unpack(self._start), error, covariance).items():
            self.forward.x[rows.slice(name)] = value
        self._start = self.forward.x.copy()
        self.record, self._health = Record(self.smoothing), []
        for inputs in self._samples or ():
            self._filter(inputs, {}, 0)

    def health_rows(self) -> dict[str, Array]:
        """The filter's rows of health at the wanted samples, time along the first axis."""
        return self.smoothing.reported.unpack(np.concatenate(self._health))

    def error_states(self) -> tuple[Array, Array, Array]:
        """The filter's states (m, nominal.size), their smoothed errors (m, n), and the covariances of these (m, n, n)."""
        blocks: list[tuple[Array, Array, Array]] = []
        self._backward.start()
        for inputs, instants, nominal in self.record.backward():
            # the state before the pass goes back into an instant holds the measurements after it
            states = np.concatenate([self._backward.output()[None], self._backward.run(len(inputs), inputs[::-1])])[-2::-1]
            later = self.smoothing.backward.state.unpack(states[instants])
            blocks.append((*_smoothed_errors(self.smoothing, nominal, later["adjoint"], later["information"]), nominal))
        blocks.reverse()
        corrections, covariances, nominals = (np.concatenate(part) for part in zip(*blocks, strict=True))
        return nominals, corrections, covariances


class SmoothingFollower(Follower):
    """The smoother along a run or a replay: its filter follows the samples, `named` smooths."""

    smoother: Smoother

    @classmethod
    def started(cls, estimator: Estimator, parameters: Mapping[str, Any], every: int) -> SmoothingFollower:
        """The smoother started with `parameters` (SI, by row name); outputs every `every` samples."""
        assert estimator.smoothing is not None
        smoother = Smoother(parameters, estimator.smoothing)
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
        outputs = {**self.smoother.smoothed(), **self.health_rows()}
        self.seconds += time.process_time() - begin
        return outputs

    def health_rows(self) -> dict[str, Array]:
        """Those of its filter, which need no smoothing."""
        return self.smoother.health_rows()

    def notes(self, time: Array, duration_s: float, health: Health | None, outputs: Mapping[str, Array]) -> tuple[Remark, ...]:
        """Those of its filter, and that no start was reached which the run does not contradict."""
        apart = self.smoother.apart
        said = (NOT_REACHED.filled(angle=np.degrees(apart)),) if apart else ()
        return (*super().notes(time, duration_s, health, outputs), *said)


def _angle(error: Array) -> float:
    """Of the attitude in error states (n,), rad."""
    return float(np.linalg.norm(error[TILT]))


def smooth(
    parameters: Mapping[str, Any] | Vector, columns: Mapping[str, Array], every: int = 1, backend: str | None = None
) -> dict[str, Array]:
    """The smoothed run of `loosely-coupled` over the samples in `columns`, at every `every`-th of them.

    Rows by name as `smoother_outputs` gives them, time along the first axis.
    """
    run = Smoother(parameters, backend=backend)
    run.take(columns, (np.arange(len(columns["dt"])) + 1) % every == 0)
    return run.smoothed()


def smoother_outputs(smoothing: Smoothing, nominal: Array, corrections: Array, covariances: Array) -> dict[str, Array]:
    """Navigation and its standard deviations from the filter's states (m, nominal.size) and smoothed error states.

    Rows by name: q_nb, velocity_n, latitude, longitude, height, the estimated errors, position_sigma, velocity_sigma
    (n), attitude_sigma (rad about n).  Where rounding leaves no positive variance (P - P L P of a filter that has diverged)
    the filter's variance_of_filter, which is larger, is stated.
    """
    values = smoothing.nominal.unpack(nominal)
    states = [values[name] for name in _state_names(smoothing)]
    *navigation, C_nw = _corrected_outputs(smoothing)(*states, corrections)
    named = dict(zip((*rows.NAVIGATION.names, *smoothing.estimates), navigation, strict=True))
    filtered = symmetric.full_array(values["covariance"], smoothing.n)
    for name, part in (("position_sigma", POSITION), ("velocity_sigma", VELOCITY), ("attitude_sigma", TILT)):
        variance, variance_of_filter = (
            np.einsum("nij,njk,nik->ni", C_nw, P[:, part, part], C_nw) for P in (covariances, filtered)
        )
        named[name] = np.sqrt(np.where(variance > 0.0, variance, variance_of_filter))
    return named


def _smoothed_errors(smoothing: Smoothing, nominal: Array, adjoint: Array, information: Array) -> tuple[Array, Array]:
    values = smoothing.nominal.unpack(nominal)
    P = symmetric.full_array(values["covariance"], smoothing.n)
    L = symmetric.full_array(information, smoothing.n)
    if smoothing.seeking:
        before = values[smoothing.seeking][:, None] != 0
        adjoint, L = np.where(before, 0.0, adjoint), np.where(before[:, None], 0.0, L)
    explained = P @ L @ P  # covariance of the correction P s
    left = P - explained
    if smoothing.seeking:
        for part in (POSITION, VELOCITY, TILT):
            left[:, part, part] += _of_products(P[:, TILT, TILT], explained[:, part, part])
    return np.einsum("nij,nj->ni", P, adjoint), left


def _of_products(A: Array, B: Array) -> Array:
    """Covariance (m, 3, 3) of psi x e: what a correction e leaves out to second order while the attitude error psi is large.

    A, B: covariances (m, 3, 3) of psi and e, which count as independent.  To turn by two corrections one after the other, and
    not by their sum, is half that product; what the specific force of the interval after it does is about as much.
    """
    a, b, both = (np.trace(part, axis1=1, axis2=2)[:, None, None] for part in (A, B, A @ B))
    return (a * b - both) * np.eye(3) - a * B - b * A + A @ B + B @ A


def _state_names(smoothing: Smoothing) -> tuple[str, ...]:
    return tuple(name for name in smoothing.nominal.names if name != smoothing.seeking)


@lru_cache(maxsize=8)
def _started_again(smoothing: Smoothing) -> Callable[[Mapping[str, Array], Array, Array], dict[str, Array]]:
    """State rows of the filter from those of a start, an error (n) of it, and the covariance (n, n) without it."""
    names, n = tuple(smoothing.nominal.names), smoothing.n
    changed_names: list[str] = []

    def rows_of(*arguments: Any) -> tuple[Any, ...]:
        *states, error, covariance = arguments
        changed = smoothing.corrected(SimpleNamespace(**dict(zip(names, states, strict=True))), error)
        changed_names[:] = changed
        turn = with_platform(turn_of(error[TILT]))
        return (*changed.values(), symmetric.triangle(turned(covariance, turn)))

    function = vectorized(rows_of, *[smoothing.nominal[name].shape for name in names], n, (n, n))

    def started(x: Mapping[str, Array], error: Array, covariance: Array) -> dict[str, Array]:
        values = function(*(x[name] for name in names), error, covariance)
        return dict(zip((*changed_names, "covariance"), values, strict=True))

    return started


@lru_cache(maxsize=8)
def _corrected_outputs(smoothing: Smoothing) -> Callable[..., tuple[Array, ...]]:
    """Outputs by the names of `smoother_outputs`, and C_nw, of many states and error states at once."""
    names = _state_names(smoothing)

    def outputs_of(*arguments: Any) -> tuple[Any, ...]:
        *states, correction = arguments
        x = SimpleNamespace(**dict(zip(names, states, strict=True)))
        changed = SimpleNamespace(**smoothing.corrected(x, correction))
        outputs = strapdown.navigation_outputs(changed)
        navigation = [outputs[name] for name in rows.NAVIGATION.names]
        estimates = [getattr(changed, name) for name in smoothing.estimates]
        return (*navigation, *estimates, ca.SX(strapdown.C_nw(changed.q_ew)))

    return vectorized(outputs_of, *[smoothing.nominal[name].shape for name in names], smoothing.n)


def _columns(table: Table, names: Sequence[str]) -> NDArray[np.int64]:
    """Places of rows in the flat vector of a table."""
    places = np.arange(table.size)
    return np.concatenate([places[table.slice(name)] for name in names] or [np.zeros(0, dtype=np.int64)])
