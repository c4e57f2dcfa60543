"""An estimator, or a Python function, that follows a run or a replay, chunk by chunk."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from insenv.base.errors import InputError, InsenvError, nearest
from insenv.base.remarks import Remark, clock, remark
from insenv.core.runner import Runner, make_runner
from insenv.core.tables import Array
from insenv.estimators import Estimator, Knowledge
from insenv.evaluation.errors import checked_estimate
from insenv.evaluation.health import Health, fixes_count_less, health, models_slow_errors, no_fix
from insenv.scenario.inputs import input_rows
from insenv.sensors import Sensor

SHORT = 1e-12
"""Squared norm below which a quaternion is no attitude."""


def diverged(what: str, columns: Mapping[str, Array], sample: int) -> InsenvError:
    """Outputs are not finite after `sample` of the samples in `columns`, with its ``time`` (s) if that known."""
    at = f" at {clock(float(columns['time'][sample]), 9)} s" if "time" in columns else ""
    return InsenvError(f"{what} diverged: its outputs are no longer finite numbers{at}")


@dataclass
class Follower:
    """One estimator in a run: its runner, its outputs so far, the processor time it has used (s), and the standard deviations
    (k, 3) m of the fixes so far."""

    estimator: Estimator
    runner: Runner
    every: int
    outputs: list[Array] = field(default_factory=list)
    seconds: float = 0.0
    fix_sigmas: list[Array] = field(default_factory=list)

    @property
    def first(self) -> int:
        """Number of records before the first estimate: an estimator has one after every sample."""
        return 0

    @classmethod
    def started(cls, estimator: Estimator, parameters: Mapping[str, Any], every: int) -> Follower:
        """The estimator started with `parameters` (SI, by row name); its outputs are recorded every `every` samples."""
        return cls(estimator, make_runner(estimator.model, parameters), every)

    def follow(self, columns: dict[str, Array], count: int) -> None:
        """Process `count` samples (a multiple of `every`).  Raises `InsenvError` if an output is not finite or q_nb has no
        length.
        """
        rows = input_rows(self.estimator.model, columns, count)
        if self.estimator.reports_fixes and "gnss_position_sigma" in columns:
            self.fix_sigmas.append(columns["gnss_position_sigma"][columns["gnss_valid"] > 0])
        begin = time.process_time()
        outputs = self.runner.run(count, rows, self.every)
        self.seconds += time.process_time() - begin
        finite = np.isfinite(outputs).all(axis=1)
        if not finite.all():
            raise diverged(f"estimator {self.estimator.id!r}", columns, (int(np.argmin(finite)) + 1) * self.every - 1)
        if np.any(np.sum(outputs[:, self.estimator.model.outputs.slice("q_nb")] ** 2, axis=1) < SHORT):
            raise InsenvError(f"estimator {self.estimator.id!r} diverged: its output q_nb has length 0")
        self.outputs.append(outputs)

    def named(self) -> dict[str, Array]:
        """All outputs so far by row name, time along the first axis."""
        return self.estimator.model.outputs.unpack(np.concatenate(self.outputs))

    def health_rows(self) -> dict[str, Array]:
        """Outputs so far by row name, those that tell its health among them."""
        return self.named()

    @property
    def parameters(self) -> dict[str, Any]:
        """Its parameters by row name."""
        return self.estimator.model.parameters.unpack(self.runner.p)

    def health(self, outputs: Mapping[str, Array]) -> Health | None:
        """Its health, from what `named` returned; None if it does not report it, or if nothing was measured."""
        return health(outputs) if self.estimator.reports_health else None

    def settled(self, duration_s: float) -> bool:
        """Whether `duration_s` of data are enough for the estimator."""
        return not self.estimator.too_short(self.parameters, duration_s)

    def notes(self, time: Array, duration_s: float, health: Health | None, outputs: Mapping[str, Array]) -> tuple[Remark, ...]:
        """Remarks on the estimate after `duration_s` of data, on its health and on what `named` returned.

        time (records,): of these outputs, s since the start.
        """
        parameters, estimator = self.parameters, self.estimator
        of_fixes = no_fix(health) if estimator.reports_fixes else ()
        of_health = health.notes(models_slow_errors(parameters), estimator.causes) if health else ()
        return (
            *estimator.notes(parameters, duration_s),
            *estimator.shown(parameters, time, outputs),
            *of_fixes,
            *of_health,
            *fixes_count_less(parameters, outputs, np.concatenate([np.zeros((0, 3)), *self.fix_sigmas])),
        )


# A plain Python function as an estimator of a run: it takes one sample at a time and returns an attitude.

EstimateFunction = Callable[["Sample"], Any]
"""``(sample) -> `` q_nb, C_nb, a dict of rows (`insenv.evaluation.errors.checked_estimate`), or None: no estimate yet."""


class Sample:
    """One inertial sample and what arrived with it, as attributes.

    time, dt (s); delta_angle (3, rad), delta_velocity (3, m/s), b; the rows of the other sensors by their names, such as
    ``gnss_valid``, ``gnss_latitude`` (docs/sensors.md, docs/instruments.md); known: the initial `Knowledge`.
    """

    __slots__ = ("_columns", "_row", "known")

    def __init__(self, columns: Mapping[str, Array], row: int, known: Knowledge) -> None:
        self._columns, self._row, self.known = columns, row, known

    def __getattr__(self, name: str) -> Any:
        try:
            return self._columns[name][self._row]
        except KeyError:
            raise AttributeError(f"a sample of this scenario has no {name!r}{nearest(name, self._columns)}") from None

    def __dir__(self) -> list[str]:
        return ["known", *self._columns]

    def __repr__(self) -> str:
        return f"Sample at {clock(float(self.time))} s: {', '.join(self._columns)}"


def sample_names(sensors: Iterable[Sensor]) -> tuple[str, ...]:
    """The columns of a plant that a `Sample` has: what sensors show, and nothing of the truth."""
    return ("time", "dt", *(name for sensor in sensors for name in sensor.outputs))


@dataclass(frozen=True)
class Called:
    """What a run asks of an estimator, of a function: its id, and what follows from its estimates."""

    id: str
    navigates: bool = False
    smooths: str = ""


@dataclass
class FunctionFollower:
    """A function that follows a run: its estimates so far, and the processor time of its calls (s).

    names: columns that it may see.  The estimate recorded at a time is the latest that the function has returned.
    """

    function: EstimateFunction
    id: str
    every: int
    known: Knowledge
    names: tuple[str, ...]
    estimates: list[dict[str, Array] | None] = field(default_factory=list)
    seconds: float = 0.0
    calls: int = 0
    covered_s: float = 0.0

    @property
    def estimator(self) -> Called:
        """Its id, and whether it navigates: its estimates have a position."""
        latest = self._latest
        return Called(self.id, latest is not None and "latitude" in latest)

    @property
    def _latest(self) -> dict[str, Array] | None:
        return self.estimates[-1] if self.estimates else None

    def follow(self, columns: Mapping[str, Array], count: int) -> None:
        """Call the function for `count` samples (a multiple of `every`).

        Raises `InputError` for a wrong estimate, `InsenvError` if the function raises an error.
        """
        visible = {name: columns[name].view() for name in self.names if name in columns}
        for column in visible.values():
            column.flags.writeable = False
        latest = self._latest
        for row in range(count):
            sample = Sample(visible, row, self.known)
            begin = time.process_time()
            try:
                estimate = self.function(sample)
            except Exception as error:
                text = f"{type(error).__name__}: {error}"
                raise InsenvError(f"estimator {self.id!r} failed at {clock(float(sample.time))} s: {text}") from error
            self.seconds += time.process_time() - begin
            if estimate is not None:
                latest = self._checked(estimate, latest, float(sample.time))
            if (row + 1) % self.every == 0:
                self.estimates.append(latest)
        self.calls += count
        self.covered_s += float(np.sum(columns["dt"]))

    def _checked(self, returned: Any, before: dict[str, Array] | None, at: float) -> dict[str, Array]:
        where = f"estimator {self.id!r} at {at:g} s"
        try:
            estimate = checked_estimate(returned)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        if "q_nb" not in estimate:
            raise InputError(f"{where}: the estimate has {', '.join(estimate)}: allowed is one with q_nb")
        if before is not None and before.keys() != estimate.keys():
            rows = ", ".join(before)
            raise InputError(
                f"{where}: the estimate has {', '.join(estimate)}, the one before {rows}: allowed are the same rows"
            )
        return estimate

    @property
    def first(self) -> int:
        """Number of records before the first estimate.  Raises `InputError` if there is no estimate at all."""
        there = next((i for i, estimate in enumerate(self.estimates) if estimate is not None), None)
        if there is None:
            raise InputError(f"estimator {self.id!r} returned no estimate in {self.covered_s:g} s")
        return there

    def named(self) -> dict[str, Array]:
        """The estimates by row name, time along the first axis, from record `first` on."""
        known = [estimate for estimate in self.estimates if estimate is not None]
        _ = self.first
        return {name: np.array([estimate[name] for estimate in known]) for name in known[0]}

    def health(self, outputs: Mapping[str, Array]) -> Health | None:
        """None: a function does not report it."""
        return None

    def settled(self, duration_s: float) -> bool:
        """True: how long a function needs is not known."""
        return True

    @remark(
        "python-function", "a Python function, called {calls} times, {us:.3g} us a call: {pace:.3g} times as fast as real time"
    )
    def notes(self, time: Array, duration_s: float, health: Health | None, outputs: Mapping[str, Any]) -> dict[str, Any]:
        """How slow the function is."""
        pace = self.covered_s / max(self.seconds, 1e-9)
        return {"calls": self.calls, "us": self.seconds / max(self.calls, 1) * 1e6, "pace": pace}


def function_id(function: EstimateFunction) -> str:
    """The id of a function: its name, or that of its class, in the form of the ids of estimators."""
    name = getattr(function, "__name__", type(function).__name__)
    return re.sub(r"[^A-Za-z0-9]+", "-", name).strip("-").lower() or "function"


def parted(estimators: Any) -> tuple[dict[str, EstimateFunction], Any]:
    """The functions among `estimators` by id, and the others.  Raises `InputError` for two functions of one name."""
    if _is_function(estimators):
        return {function_id(estimators): estimators}, []
    if estimators is None or isinstance(estimators, (str, Estimator)) or not isinstance(estimators, Iterable):
        return {}, estimators
    listed = list(estimators)
    functions: dict[str, EstimateFunction] = {}
    for one in listed:
        if _is_function(one) and functions.setdefault(function_id(one), one) is not one:
            raise InputError(f"two functions have the name {function_id(one)!r}: results are kept by name")
    return functions, [one for one in listed if not _is_function(one)]


def _is_function(thing: Any) -> bool:
    return callable(thing) and not isinstance(thing, (Estimator, type))
