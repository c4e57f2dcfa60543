"""The filter inside an environment: the loop of plant and estimator, and the quantities that a task reads from it.

A filter can run inside if it navigates with GNSS, keeps its covariance and its latest innovations as state, and is the same on
every drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import isqrt, log
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv import attitude, estimators, geodesy
from insenv.base.errors import InputError
from insenv.core import elementary, symmetric
from insenv.core.compose import Part
from insenv.core.elementary import clamp, maximum, select
from insenv.core.model import Model, Step, Values
from insenv.core.tables import Row, Table
from insenv.envs.knowledge import KNOWN
from insenv.envs.task import DECISION_LIMIT, DENSE
from insenv.estimators import Estimator
from insenv.evaluation.errors import nees
from insenv.scenario.loop import PREFIX, loop_model

# An estimator whose noise parameters are multiplied by factors that can change while it runs.
#
# The factors are the state row `noise_scale`, 1 at the start, to be set from outside between samples.  They act on the
# steps only, not on the initial covariance: the factor of a bias's standard deviation scales its driving noise.


SCALE = "noise_scale"


@lru_cache(maxsize=32)
def scaled_model(estimator: Model, names: tuple[str, ...]) -> Model:
    """`estimator` with the state row `noise_scale` (k,); the same object for the same arguments.

    Every step uses the parameter or input row ``names[i]`` multiplied by element i.  Raises `InputError` for a name
    that is neither.
    """
    missing = [name for name in names if name not in estimator.parameters and name not in estimator.inputs]
    if missing:
        raise InputError(f"estimator {estimator.id!r} has no parameter or input {', '.join(map(repr, missing))} to scale")
    meaning = f"Factors on {', '.join(names)}"
    return replace(
        estimator,
        id=f"{estimator.id}-scaled",
        state=estimator.state + Table((Row(SCALE, meaning, "1", (len(names),), start=1.0),)),
        steps={name: Step(_scaled(step, names), step.when, step.uniforms) for name, step in estimator.steps.items()},
    )


def _scaled(step: Step, names: tuple[str, ...]) -> Callable[..., Any]:
    def function(p: Values, x: Values, u: Values, *r: Any) -> Any:
        p, u = SimpleNamespace(**vars(p)), SimpleNamespace(**vars(u))
        for i, name in enumerate(names):
            owner = p if hasattr(p, name) else u
            setattr(owner, name, getattr(owner, name) * getattr(x, SCALE)[i])
        return step.function(p, x, u, *r)

    return function


LN10 = log(10.0)
LOG_FLOOR = 1e-15
"""Lower bound of the argument of a logarithm, SI."""
SCALED = PREFIX + SCALE
"""State row of the factors on the filter's noises."""
ERROR = Row("error", "Error of the filter in n: rotation vector (rad), velocity (m/s), position (m)", "1", (9,), "n")
COMMON = KNOWN + Table((DECISION_LIMIT, DENSE))
"""Parameters of every task with a filter inside."""


@dataclass(frozen=True, eq=False)
class Inner:
    """A plant with a filter behind it.

    estimator: the registered filter.  model: plant and filter as one; the filter's rows have the prefix `PREFIX`.
    """

    estimator: Estimator
    model: Model

    @property
    def states(self) -> int:
        """Number of the filter's error states."""
        elements = self.estimator.model.state["covariance"].size
        return (isqrt(8 * elements + 1) - 1) // 2

    def unprefixed(self, p: Values, x: Values) -> tuple[Values, Values]:
        """Return the filter's parameters and state under the row names of its model."""
        model = self.estimator.model
        return tuple(
            SimpleNamespace(**{row.name: getattr(values, PREFIX + row.name) for row in table})
            for values, table in ((p, model.parameters), (x, model.state))
        )  # type: ignore[return-value]

    def outputs(self, p: Values, x: Values) -> Values:
        """Return the filter's outputs by name."""
        return SimpleNamespace(**self.estimator.model.output(*self.unprefixed(p, x)))

    def error(self, p: Values, x: Values) -> Any:
        """Return the value of `ERROR`, estimate minus truth."""
        estimate = self.outputs(p, x)
        places = [(v.latitude, v.longitude, v.height) for v in (estimate, x)]
        return ca.vertcat(
            attitude.error_rotation_vector(estimate.q_nb, x.q_nb),
            estimate.velocity_n - x.velocity_n,
            geodesy.ned_offset(*places[0], *places[1]),
        )

    def without(self, p: Values, x: Values, error: Any) -> dict[str, Any]:
        """Return the filter's state rows after an error, a value of `ERROR`, was taken out of its estimate."""
        assert self.estimator.without is not None
        rows = self.estimator.without(self.unprefixed(p, x)[1], error)
        return {PREFIX + name: value for name, value in rows.items()}

    def nees(self, p: Values, x: Values) -> tuple[Any, int]:
        """Return the normalised estimation error squared (NEES) and its degrees of freedom."""
        return nees(self.estimator, self.unprefixed(p, x)[1], self.outputs(p, x), x)

    def sigma(self, x: Values) -> Any:
        """Return the standard deviations of the filter's error states (`states`,), in the filter's order and units.

        The value is 0 where the variance is not positive.
        """
        variance = getattr(x, f"{PREFIX}covariance")[symmetric.diagonal_places(self.states)]
        return ca.sqrt(select(variance > 0.0, variance, 0.0))


@lru_cache(maxsize=32)
def inner_loop(plant: Model, id: str, scaled: tuple[str, ...] = (), *, correctable: bool = False) -> Inner:
    """Return the loop of a plant and the filter `id`, with adjustable factors on its rows `scaled`.

    correctable: whether errors are taken out of its estimate from outside.

    Raises `InputError` for a filter that cannot run inside.
    """

    def able_to(estimator: Estimator) -> bool:
        return fits(estimator, scaled) and (estimator.without is not None or not correctable)

    registered = estimators.registered()
    if id not in registered or not able_to(registered[id]):
        able = [name for name, other in registered.items() if able_to(other)]
        raise InputError(f"estimator = {id!r}: allowed are filters that can run inside this environment: {', '.join(able)}")
    estimator = registered[id]
    model = scaled_model(estimator.model, scaled) if scaled else estimator.model
    return Inner(estimator, loop_model(plant, model))


def fits(estimator: Estimator, scaled: tuple[str, ...] = ()) -> bool:
    """Return whether an estimator can run inside an environment with these rows scaled."""
    model = estimator.model
    return (
        estimator.navigates
        and estimator.aided
        and not estimator.smooths
        and estimator.adapt is None
        and all(name in model.state for name in ("covariance", "innovation", "test_ratio"))
        and all(name in model.parameters or name in model.inputs for name in scaled)
    )


def bounded(value: Any, row: Row) -> Any:
    """Return the value clipped to the row's bounds; NaN becomes the lower bound."""
    value = select(value >= row.lower, value, row.lower)
    return select(value <= row.upper, value, row.upper)


def within(table: Table, values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the table's rows, each clipped to its bounds."""
    return {row.name: bounded(values[row.name], row) for row in table}


def log10(value: Any) -> Any:
    """Return the decimal logarithm of each element; NaN and elements below `LOG_FLOOR` count as `LOG_FLOOR`."""
    value = ca.SX(value)
    safe = select(value >= LOG_FLOOR, value, LOG_FLOOR)
    return ca.vertcat(*(elementary.log(maximum(safe[i], LOG_FLOOR)) for i in range(safe.numel()))) * (1.0 / LN10)


def power10(value: Any) -> Any:
    """Return 10 to the power of each element."""
    return ca.vertcat(*(elementary.exp(value[i] * LN10) for i in range(value.numel())))


# Statistics of the inertial samples and fixes since the last decision, as a part of a model.

LARGEST_RATIO = 100.0
"""Bound on the magnitude of a test ratio."""

_SUMS = Table((
    Row("window_samples", "Samples received since the last step"),
    Row("window_delta_angle", "Their gyro increments, summed", "rad", (3,), "b"),
    Row("window_delta_velocity", "Their accelerometer increments, summed", "m/s", (3,), "b"),
    Row("window_delta_angle_square", "Squares of their gyro increments, summed", "rad^2", (3,), "b"),
    Row("window_delta_velocity_square", "Squares of their accelerometer increments, summed", "m^2/s^2", (3,), "b"),
    Row("window_fixes", "Fixes since the last step"),
    Row("window_ratio", "Their test ratios, summed", "1", (6,), "n"),
    Row("window_ratio_square", "Squares of their test ratios, summed", "1", (6,), "n"),
    Row("window_innovation_square", "Squares of their innovations, summed", "m^2, m^2/s^2", (6,), "n"),
))  # fmt: skip
_FIX_TIME = Row("fix_time", "Time at which the latest fix was delivered", "s")

STATISTICS = Table((
    Row("fixes", "Fixes since the last step", lower=0.0, upper=1e6),
    Row("fix_age", "Time since the epoch of the latest fix", "s", lower=0.0, upper=1e6),
    Row("innovation_rms", "Root mean square of the fixes' innovations: position (m), velocity (m/s)", "m, m/s", (6,), "n",
        lower=0.0, upper=1e6),
    Row("test_ratio_mean", "Mean of the test ratios: innovations over their standard deviations", "1", (6,), "n",
        lower=-LARGEST_RATIO, upper=LARGEST_RATIO),
    Row("test_ratio_level", "Decimal logarithm of their root mean square; 0 for a consistent filter, and without fixes", "1",
        (6,), "n", lower=-6.0, upper=2.0),
    Row("rate_mean", "Mean of the gyros", "rad/s", (3,), "b", lower=-1e3, upper=1e3),
    Row("rate_deviation", "Standard deviation of a gyro sample", "rad/s", (3,), "b", lower=0.0, upper=1e3),
    Row("force_mean", "Mean of the accelerometers", "m/s^2", (3,), "b", lower=-1e5, upper=1e5),
    Row("force_deviation", "Standard deviation of an accelerometer sample", "m/s^2", (3,), "b", lower=0.0, upper=1e5),
))  # fmt: skip
"""Observation rows of the window."""


def window_part() -> Part:
    """Return the part that sums after the filter's steps; the rows of `empty_window` set the sums to zero."""
    return Part(
        state=_SUMS + Table((_FIX_TIME,)),
        steps={"window": Step(_sample), "window_fix": Step(_fix, when="gnss_valid")},
    )


def empty_window() -> dict[str, Any]:
    """Return the state rows of an empty window."""
    return {row.name: ca.SX.zeros(row.size) for row in _SUMS}


def _sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    angle, velocity = x.imu_valid * x.delta_angle, x.imu_valid * x.delta_velocity
    squares = {"delta_angle_square": angle * angle, "delta_velocity_square": velocity * velocity}
    return _added(x, samples=x.imu_valid, delta_angle=angle, delta_velocity=velocity, **squares)


def _fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    ratio = clamp(getattr(x, f"{PREFIX}test_ratio"), -LARGEST_RATIO, LARGEST_RATIO)
    innovation = getattr(x, f"{PREFIX}innovation")
    sums = _added(x, fixes=1.0, ratio=ratio, ratio_square=ratio * ratio, innovation_square=innovation * innovation)
    return {**sums, "fix_time": x.time}


def _added(x: Any, **terms: Any) -> dict[str, Any]:
    """Return the sums of the window with a term added to each that is named."""
    return {f"window_{name}": getattr(x, f"window_{name}") + term for name, term in terms.items()}


def statistics(p: Any, x: Any) -> dict[str, Any]:
    """Return the values of `STATISTICS`, not yet clipped to their bounds."""
    count, fixes = maximum(x.window_samples, 1.0), maximum(x.window_fixes, 1.0)
    rate = 1.0 / p.sample_interval
    some = x.window_fixes > 0.0
    return {
        "fixes": x.window_fixes,
        "fix_age": (x.time - x.fix_time) + select(x.fix_time > 0.0, x.gnss_age, 0.0),
        "innovation_rms": ca.sqrt(x.window_innovation_square / fixes),
        "test_ratio_mean": x.window_ratio / fixes,
        "test_ratio_level": select(some, 0.5 * log10(x.window_ratio_square / fixes), 0.0),
        "rate_mean": x.window_delta_angle * (rate / count),
        "rate_deviation": rate * _deviation(x.window_delta_angle, x.window_delta_angle_square, count),
        "force_mean": x.window_delta_velocity * (rate / count),
        "force_deviation": rate * _deviation(x.window_delta_velocity, x.window_delta_velocity_square, count),
    }


def _deviation(total: Any, squares: Any, count: Any) -> Any:
    mean = total / count
    return ca.sqrt(maximum(squares / count - mean * mean, 0.0))
