"""An instrument that measures at its own rate and delivers after a latency: the part that all aiding instruments share.

A measurement is made at an epoch, on the sample that ends there, and arrives `NAME_latency` later.  Epochs come every
`NAME_interval`, beginning one interval after the start.  Outage windows remove epochs, not deliveries, as those of the GNSS
receiver do.  Between epochs a sample only increments a counter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from insenv.base.errors import InputError
from insenv.core.compose import Part
from insenv.core.elementary import exp, select
from insenv.core.model import Step, Values
from insenv.core.tables import Row, Table
from insenv.sensors.contract import ErrorSource, Instant, Sensor, Stated
from insenv.sensors.imu_tables import HUGE
from insenv.sensors.instruments import Instrument

OUTAGES = 16
"""Number of outage windows in the parameters."""
LOST = "lost"
"""Key of what `Sampled.measure` returns: 1 if the instrument shows nothing at this epoch."""


@dataclass(frozen=True)
class Motion:
    """The motion at an epoch, at the inertial unit: omega_eb^b (3, rad/s), its derivative, d(velocity_n)/dt (3, m/s^2)."""

    rate_eb_b: Any
    rate_change_b: Any
    acceleration_n: Any


@dataclass(frozen=True, eq=False)
class Sampled:
    """The equations of an instrument.

    instrument: its rows.  parameters, state: further rows than those of the timing and the measurement.  exact: true values of
    what it measures, which arrive with the measurement.  measure: ``(p, x, r, motion) -> {row: value}`` of all measured values,
    of `exact` and of rows of `state`, r being `uniforms` uniforms; and `LOST` if it may show nothing.  truth: rows of `state`
    that are outputs of the plant, as `exact` is.  start: ``(p, r) -> {row: value}``.  sample: ``(p, x, u) -> {row: value}``,
    what it does on every sample.  told, errors, stated: as of `Sensor`; the outages are a source of errors as well.
    """

    instrument: Instrument
    parameters: Table
    state: Table
    exact: Table
    measure: Callable[[Values, Values, Any, Motion], dict[str, Any]]
    uniforms: int
    truth: tuple[str, ...]
    told: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    errors: tuple[ErrorSource, ...]
    start: Callable[[Values, Any], dict[str, Any]] | None = None
    start_uniforms: int = 0
    sample: Callable[[Values, Values, Values], dict[str, Any]] | None = field(default=None)
    stated: Stated | None = None

    @property
    def all_parameters(self) -> Table:
        """Those of the timing, then its own."""
        return timing_rows(self.instrument.id) + self.parameters

    @property
    def all_state(self) -> Table:
        """Rows of the measurement and its exact values, of the pending ones, of the timing, then its own."""
        given, id = self.instrument, self.instrument.id
        arriving = (*(given.measurement[name] for name in given.values), *self.exact)
        return (
            given.measurement
            + self.exact
            + Table(tuple(replace(row, name=self._pending(row.name), meaning=f"{row.meaning}; pending") for row in arriving))
            + Table((
                Row(f"{id}_pending", "1 if the latest epoch gave a measurement", lower=0.0, upper=1.0),
                Row(f"{id}_epochs", "Number of epochs so far"),
                Row(f"{id}_counter", "Samples since the latest epoch"),
                Row(f"{id}_due", "1 on a sample that ends with a measurement", lower=0.0, upper=1.0),
            ))
            + self.state
        )  # fmt: skip

    def sensor(self) -> Sensor:
        """The sensor of these equations."""
        given, id = self.instrument, self.instrument.id
        missing = (
            ErrorSource(f"{id} latency", (f"{id}_latency",)),
            ErrorSource(f"{id} outages", (f"{id}_outage_start", f"{id}_outage_end")),
        )
        return Sensor(
            id,
            self._part,
            outputs=given.measurement.names,
            truth=(*self.exact.names, *self.truth),
            told=self.told,
            errors=self.errors + missing,
            stated=self.stated,
        )

    def _part(self, instant: Instant) -> Part:
        id = self.instrument.id

        def measure(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
            return self._measured(p, x, r, Motion(*instant(p, x)))

        return Part(
            parameters=self.all_parameters,
            state=self.all_state,
            steps={
                "sample": Step(self._counted),
                id: Step(measure, when=f"{id}_due", uniforms=self.uniforms),
                f"{id}_delivery": Step(self._delivered, when=self.instrument.new),
            },
            start=self.start,
            start_uniforms=self.start_uniforms,
        )

    def _counted(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        id, dt = self.instrument.id, p.sample_interval
        counter = getattr(x, f"{id}_counter") + 1.0
        arrives = ca.fabs(counter * dt - getattr(p, f"{id}_latency")) < 0.5 * dt
        own = {} if self.sample is None else self.sample(p, x, u)
        return {
            f"{id}_counter": counter,
            f"{id}_due": (counter + 0.5) * dt > getattr(p, f"{id}_interval"),
            self.instrument.new: arrives * getattr(x, f"{id}_pending"),
            **own,
        }

    def _measured(self, p: Values, x: Values, r: Any, motion: Motion) -> dict[str, Any]:
        id, dt = self.instrument.id, p.sample_interval
        rows = self.measure(p, x, r, motion)
        epochs = getattr(x, f"{id}_epochs") + 1.0
        # a microsecond decides ties, which rounding would otherwise decide arbitrarily
        time = epochs * getattr(p, f"{id}_interval") + 1e-6
        lost: Any = rows.pop(LOST, 0.0)
        begin, end = getattr(p, f"{id}_outage_start"), getattr(p, f"{id}_outage_end")
        for i in range(OUTAGES):
            lost = lost + (time >= begin[i]) * (time < end[i])
        there = lost == 0.0
        return {
            **{self._pending(name) if self._waits(name) else name: value for name, value in rows.items()},
            f"{id}_pending": there,
            f"{id}_epochs": epochs,
            f"{id}_counter": 0.0,
            self.instrument.new: there * (getattr(p, f"{id}_latency") < 0.5 * dt),
        }

    def _delivered(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        id = self.instrument.id
        names = (*self.instrument.values, *self.exact.names)
        late = select(getattr(p, f"{id}_latency") < 0.5 * p.sample_interval, 0.0, getattr(x, f"{id}_counter"))
        return {
            **{name: getattr(x, self._pending(name)) for name in names},
            self.instrument.age: late * p.sample_interval,
        }

    def _waits(self, name: str) -> bool:
        """Whether the value of a row waits for the delivery of the measurement."""
        return name in self.instrument.measurement or name in self.exact

    def _pending(self, name: str) -> str:
        id = self.instrument.id
        return f"{id}_pending_{name.removeprefix(f'{id}_')}"


def timing_rows(id: str) -> Table:
    """Parameters of an instrument's timing."""
    return Table((
        Row(f"{id}_interval", "Time between measurements, a whole number of samples; the first ends the first interval", "s",
            start=1.0, lower=1e-4, upper=HUGE),
        Row(f"{id}_latency", "Time from an epoch to delivery, a whole number of samples, below the interval", "s",
            lower=0.0, upper=3600.0),
        Row(f"{id}_outage_start", "Outage windows: first epoch lost, time since the start", "s", (OUTAGES,)),
        Row(f"{id}_outage_end", "Outage windows: first epoch no longer lost; a window that ends as it starts is empty", "s",
            (OUTAGES,)),
    ))  # fmt: skip


def check_times(id: str, sample_interval: float, interval: float, latency: float) -> None:
    """Raise `InputError` unless an instrument with these times (s) can run on samples of `sample_interval` (s)."""
    for name, value, least in (("interval_s", interval, 1), ("latency_s", latency, 0)):
        samples = value / sample_interval
        if round(samples) < least or abs(samples - round(samples)) > 1e-6 * max(1.0, samples):
            raise InputError(
                f"{id}.{name} = {value:g} s: allowed is a whole number of samples of {sample_interval:g} s, {least} or more"
            )
    if latency > interval - 0.5 * sample_interval:
        raise InputError(f"{id}.latency_s = {latency:g} s: allowed is less than {id}.interval_s = {interval:g} s")


def gauss_markov(value: Any, sigma: Any, time: Any, interval: Any, normals: Any) -> Any:
    """A stationary first-order Gauss-Markov process after `interval` (s), stepped exactly (Gelb 1974, chapter 3)."""
    decay = exp(-interval / time)
    return decay * value + sigma * ca.sqrt((1.0 - decay) * (1.0 + decay)) * normals


def rounded(value: Any, quantum: Any) -> Any:
    """A value rounded to whole quanta; itself if the quantum is 0."""
    per_count = 1.0 / (quantum + (quantum == 0.0))
    return quantum * ca.floor(value * per_count + 0.5) + (quantum == 0.0) * value


def root_sum(*parts: Any) -> float:
    """Root of the sum of the squares of the largest elements of each part: fixed and drawn parts of an error as one sigma."""
    return float(np.sqrt(sum(float(np.max(np.abs(part))) ** 2 for part in parts)))


QUANTUM_SIGMA = 12.0**-0.5
"""Standard deviation of the rounding error over the quantum."""
