"""Fixed-interval smoothing of a filter's run: one forward pass with a record, one backward pass."""

from __future__ import annotations

import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from insenv.core import symmetric
from insenv.core.numeric import vectorized
from insenv.core.runner import make_runner
from insenv.core.tables import Array, Table, Vector
from insenv.estimators import Estimator
from insenv.estimators.loosely_coupled import SMOOTHING
from insenv.estimators.parts import rows, strapdown
from insenv.estimators.parts.adjoint import Smoothing, used_row
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY
from insenv.runs.follower import Follower, diverged
from insenv.scenario.inputs import input_rows

BLOCK = 2000  # samples filtered at a time: 7 MB


class Smoother:
    """A run of a filter that can be smoothed: `take` samples, then `smoothed`.

    parameters: of the filter, by row name.  smoothing: its two passes.  backend: as for `make_runner`.
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
        self._health_columns = _columns(smoothing.forward.outputs, [row.name for row in smoothing.reported])
        self._health: list[Array] = []

    def take(self, columns: Mapping[str, Array], wanted: Array) -> None:
        """Filter samples. Raises `InsenvError` when the filter's estimate is no longer finite.

        columns: inputs of the filter, (samples, ...) by name. wanted (samples, bool): which samples to smooth.
        """
        inputs = input_rows(self.forward.model, {**columns, "smoothed": wanted.astype(np.float64)}, len(wanted))
        for begin in range(0, len(wanted), BLOCK):
            part = slice(begin, begin + BLOCK)
            outputs = self.forward.run(len(inputs[part]), inputs[part])
            if not np.isfinite(outputs[-1]).all():
                first = int(np.argmin(np.isfinite(outputs).all(axis=1)))
                raise diverged("the filter under the smoother", columns, begin + first)
            self.record.add(outputs, wanted[part])
            self._health.append(outputs[wanted[part]][:, self._health_columns])

    def smoothed(self) -> dict[str, Array]:
        """The smoothed run so far at the wanted samples: rows of `smoother_outputs`, time along the first axis."""
        corrections, covariances, nominal = self.error_states()
        return smoother_outputs(self.smoothing, nominal, corrections, covariances)

    def health_rows(self) -> dict[str, Array]:
        """The filter's rows of health at the wanted samples, time along the first axis."""
        return self.smoothing.reported.unpack(np.concatenate(self._health))

    def error_states(self) -> tuple[Array, Array, Array]:
        """Smoothed error states (m, n), their covariances (m, n, n), and the filter's states (m, nominal.size)."""
        blocks: list[tuple[Array, Array, Array]] = []
        self._backward.start()
        for inputs, instants, nominal in self.record.backward():
            # the state before the pass goes back into an instant holds the measurements after it
            states = np.concatenate([self._backward.output()[None], self._backward.run(len(inputs), inputs[::-1])])[-2::-1]
            later = self.smoothing.backward.state.unpack(states[instants])
            blocks.append((*_smoothed_errors(self.smoothing, nominal, later["adjoint"], later["information"]), nominal))
        blocks.reverse()
        corrections, covariances, nominals = (np.concatenate(part) for part in zip(*blocks, strict=True))
        return corrections, covariances, nominals


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


# The record of a forward pass: in memory up to `MEMORY`, beyond that in a temporary file.
#
# A flight of 2 h at 200 Hz, with the covariance propagated 20 times per second, one fix per second and 3000 smoothed
# instants, takes 41 MB: 184 B for each of 144,000 instants, 1.5 kB per fix, 1.1 kB per smoothed instant.


MEMORY = 64 * 2**20  # bytes before the file is used


class Record:
    """Blocks of recorded instants of a smoother's forward pass, written forward and read backward."""

    def __init__(self, smoothing: Smoothing) -> None:
        self._smoothing = smoothing
        self._file = tempfile.SpooledTemporaryFile(max_size=MEMORY)  # noqa: SIM115 (it lives as long as the record)
        weakref.finalize(self, self._file.close)
        self._blocks: list[list[tuple[int, int]]] = []

    def add(self, outputs: Array, wanted: Array) -> None:
        """Add outputs of the forward pass (one row per sample); `wanted` (bool): the samples to be smoothed."""
        smoothing = self._smoothing
        due, *used = (self._rows(outputs, Table((row,)))[:, 0] != 0 for row in smoothing.events)
        parts = (
            np.column_stack([self._rows(outputs[due], smoothing.events + smoothing.interval), wanted[due]]),
            *(self._rows(outputs[flag], group.rows) for flag, group in zip(used, smoothing.groups, strict=True)),
            self._rows(outputs[wanted], smoothing.nominal),
        )
        self._blocks.append([(len(part), part.shape[1]) for part in parts])
        for part in parts:
            self._file.write(np.ascontiguousarray(part).tobytes())

    @property
    def size(self) -> int:
        """Bytes recorded."""
        return 8 * sum(rows * columns for block in self._blocks for rows, columns in block)

    def backward(self) -> Iterator[tuple[Array, NDArray[np.intp], Array]]:
        """Blocks from the last to the first, each in order of time.

        Yields the input rows of the backward pass (rows, its inputs.size), the index of the row with which the pass
        goes back into each instant that is to be smoothed, and the filter's states at those instants (instants,
        nominal.size).
        """
        end = self.size
        for shapes in reversed(self._blocks):
            begin = end - 8 * sum(rows * columns for rows, columns in shapes)
            self._file.seek(begin)
            parts = [np.frombuffer(self._file.read(8 * rows * columns)).reshape(rows, columns) for rows, columns in shapes]
            events, *groups, nominal = parts
            rows, last = self._instants(events, groups)
            yield rows, last[events[:, -1] != 0], nominal
            end = begin
        self._file.seek(self.size)

    def _instants(self, events: Array, groups: Sequence[Array]) -> tuple[Array, NDArray[np.intp]]:
        """Input rows of the backward pass in order of time, and the last row of each instant.

        An instant has one row for each scalar measurement, or one if it has none; the transition to it belongs to the first
        row.
        """
        smoothing = self._smoothing
        flags = [events[:, 1 + k] != 0 for k in range(len(smoothing.groups))]
        scalars = [_scalars(group.rows, rows) for group, rows in zip(smoothing.groups, groups, strict=True)]
        count = np.zeros(len(events), dtype=np.int64)
        before = []
        for flag, group in zip(flags, smoothing.groups, strict=True):
            before.append(count.copy())
            count += flag * group.count
        length = np.maximum(count, 1)
        first = np.cumsum(length) - length

        inputs = smoothing.backward.inputs
        rows = np.zeros((length.sum(), inputs.size))
        rows[first, inputs.slice("carried").start] = 1
        interval = events[:, smoothing.events.size : smoothing.events.size + smoothing.interval.size]
        rows[:, inputs.slice("carried").stop :] = np.repeat(interval, length, axis=0)
        scalar = slice(inputs.slice("H").start, inputs.slice("left").stop)
        for k, (flag, earlier, (values, turn)) in enumerate(zip(flags, before, scalars, strict=True)):
            places = (first + earlier)[flag][:, None] + np.arange(values.shape[1])
            rows[places, scalar] = values
            rows[places, inputs.slice(used_row(k)).start] = 1
            rows[places[:, -1], inputs.slice("turned").start] = 1
            rows[places[:, -1], inputs.slice("turn")] = turn
        return rows, first + length - 1

    def _rows(self, outputs: Array, table: Table) -> Array:
        """The columns of the outputs of the forward pass that `table` names, in its order."""
        table_of_outputs = self._smoothing.forward.outputs
        return np.concatenate([outputs[:, table_of_outputs.slice(name)] for name in table.names], axis=1)


def _scalars(table: Table, rows: Array) -> tuple[Array, Array]:
    """Rows of a group: H, gain, weight and left of each scalar (instants, scalars, 2 n + 2), and turns (instants, 3)."""
    H, gain, weight, left, turn = table.unpack(rows).values()
    return np.concatenate([H, gain, weight[..., None], left[..., None]], axis=-1), turn
