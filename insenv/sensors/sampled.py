"""An instrument as part of a plant: it measures at its own rate, and delivers after a latency.

A measurement is made at an epoch, on the sample that ends there, and arrives `NAME_latency` later.  Epochs come every
`NAME_interval`, beginning one interval after the start.  Outage windows remove epochs, not deliveries, as those of the GNSS
receiver do.  Between epochs a sample only increments a counter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca

from insenv.attitude import rotate, rotate_inverse
from insenv.base.errors import InputError, naming
from insenv.core.compose import Part
from insenv.core.elementary import exp, normals, select
from insenv.core.model import Step, Values
from insenv.core.tables import Row, Table, check_rows
from insenv.geodesy.magnetic import displacement_n
from insenv.sensors.contract import HUGE, ErrorSource, Instant, Sensor, Stated
from insenv.sensors.instrument import Instrument, Term, errors_of

OUTAGES = 16
"""Number of outage windows in the parameters."""


class TrueMotion:
    """The motion of the plant at an epoch, as instruments see it (`insenv.sensors.instrument.Motion`).

    rate_eb_b: omega_eb^b (3, rad/s).
    """

    def __init__(self, p: Values, x: Values, rate_eb_b: Any) -> None:
        self._p, self._x, self._rate_eb_b = p, x, rate_eb_b

    @property
    def specific_force_b(self) -> Any:
        return self._x.true_delta_velocity / self._p.sample_interval

    @property
    def height(self) -> Any:
        return self._x.height

    @property
    def climbed(self) -> Any:
        return self._x.height - self._p.start_height

    @property
    def speed_squared(self) -> Any:
        return ca.sumsqr(self._x.velocity_n)

    @property
    def displacement_n(self) -> Any:
        x, p = self._x, self._p
        return displacement_n(x.latitude, x.longitude, x.height, p.start_latitude, p.start_longitude, p.start_height)

    def to_body(self, vector_n: Any) -> Any:
        return rotate_inverse(self._x.q_nb, vector_n)

    def to_navigation(self, vector_b: Any) -> Any:
        return rotate(self._x.q_nb, vector_b)

    def body_velocity(self, arm_b: Any, flow_n: Any = None) -> Any:
        velocity_n = self._x.velocity_n if flow_n is None else self._x.velocity_n - flow_n
        return rotate_inverse(self._x.q_nb, velocity_n) + ca.cross(self._rate_eb_b, arm_b)


@dataclass(frozen=True, eq=False)
class Sampled:
    """The plant's equations of an instrument."""

    instrument: Instrument

    @property
    def all_parameters(self) -> Table:
        """Those of the timing, then its own."""
        return timing_rows(self.instrument.id) + self.instrument.all_parameters

    @cached_property
    def all_state(self) -> Table:
        """Rows of the measurement and its exact values, of the pending ones, of the timing, then its errors."""
        this, id = self.instrument, self.instrument.id
        arriving = (*this.values, *this.exact_rows)
        return (
            this.measurement
            + Table(this.exact_rows)
            + Table(tuple(replace(row, name=self._pending(row.name), meaning=f"{row.meaning}; pending") for row in arriving))
            + timing_state(id)
            + Table(tuple(row for row, _ in this.totals))
            + Table(tuple(term.value for term in this.terms if term.value is not None))
            + (Table() if this.lag is None else this.lag.state)
        )  # fmt: skip

    @property
    def truth(self) -> tuple[str, ...]:
        """Rows of the state that are true values of errors: their names end with ``_true``."""
        errors = (*(row for row, _ in self.instrument.totals), *(term.value for term in self.instrument.terms))
        return tuple(row.name for row in errors if row is not None and row.name.endswith("_true"))

    def sensor(self) -> Sensor:
        """The sensor of these equations."""
        this, id = self.instrument, self.instrument.id
        return Sensor(
            id,
            self._part,
            outputs=this.measurement.names,
            truth=(*(row.name for row in this.exact_rows), *self.truth),
            stated_errors=this.stated_values,
            errors=(*this.error_sources, *timing_sources(id, id)),
            stated=None if this.accuracy is None else Stated(this.new, self._accuracy),
        )

    def _accuracy(self, p: Values, x: Values) -> dict[str, Any]:
        assert self.instrument.accuracy is not None
        return self.instrument.accuracy(p, {row.name: getattr(x, row.name) for row in self.instrument.values})

    def _part(self, instant: Instant) -> Part:
        id = self.instrument.id

        def measure(p: Values, x: Values, u: Values, r: Any) -> dict[str, Any]:
            return self._measured(p, x, r, TrueMotion(p, x, instant(p, x)[0]))

        return Part(
            parameters=self.all_parameters,
            state=self.all_state,
            steps={
                "sample": Step(self._counted),
                id: Step(measure, when=f"{id}_due", uniforms=self._epoch_normals + self._further_uniforms),
                f"{id}_delivery": Step(self._delivered, when=self.instrument.new),
            },
            start=self._start,
            start_uniforms=_even(self._last(self._normals["start"])),
        )

    # --- the errors -----------------------------------------------------------------------------------

    @cached_property
    def _normals(self) -> dict[str, dict[str, slice]]:
        """Which of the standard normals of the start, and of an epoch, the terms take, by name."""
        draws = {"constant": ("start",), "drift": ("start", "epoch"), "white": ("epoch",)}
        places: dict[str, dict[str, slice]] = {"start": {}, "epoch": {}}
        for term in self.instrument.terms:
            drawn = draws[term.kind] if term.value is not None or term.kind == "white" else ()
            for number, when in enumerate(drawn):
                first = term.normals[number] if term.normals else self._last(places[when])
                places[when][term.name] = slice(first, first + term.size)
        return places

    @staticmethod
    def _last(places: Mapping[str, slice]) -> int:
        return max((place.stop for place in places.values()), default=0)

    @property
    def _epoch_normals(self) -> int:
        return _even(self._last(self._normals["epoch"]))

    @property
    def _further_uniforms(self) -> int:
        return 0 if self.instrument.outlier is None else self.instrument.outlier.uniforms

    def _start(self, p: Values, r: Any = None) -> dict[str, Any]:
        this, places = self.instrument, self._normals["start"]
        n = normals(r) if places else ca.SX()
        values = {
            term.name: _with_fixed(term, p, _scaled(term, p, n[places[term.name]]))
            for term in this.terms
            if term.name in places
        }
        rows = {term.value.name: values[term.name] for term in this.terms if term.value is not None}
        return {**rows, **self._totals(p, values), **({} if this.lag is None else this.lag.start(p))}

    def _totals(self, p: Values, values: Mapping[str, Any]) -> dict[str, Any]:
        errors = errors_of(self.instrument, {**_fixed(self.instrument, p), **values})
        return {row.name: total(errors, p) for row, total in self.instrument.totals}

    def _at_epoch(self, p: Values, x: Values, r: Any) -> dict[str, Any]:
        """The errors of a measurement by name."""
        this, count = self.instrument, self._epoch_normals
        n, values, places = normals(r[0:count]), _fixed(this, p), self._normals["epoch"]
        interval = getattr(p, f"{this.id}_interval")
        for term in this.terms:
            if term.value is not None:
                values[term.name] = getattr(x, term.value.name)
            if term.kind == "drift":
                assert term.sigma is not None and term.time is not None
                sigma, time = getattr(p, term.sigma.name), getattr(p, term.time.name)
                values[term.name] = gauss_markov(values[term.name], sigma, time, interval, n[places[term.name]])
            elif term.kind == "white":
                values[term.name] = _scaled(term, p, n[places[term.name]])
        if this.lag is not None:
            values[this.lag.name] = this.lag.value(x)
        if this.outlier is not None:
            values[this.outlier.name] = this.outlier.draw(p, r[count:])
        return values

    # --- the steps ------------------------------------------------------------------------------------

    def _counted(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        this = self.instrument
        lagging = {} if this.lag is None else this.lag.sample(p, x)
        return {**counted(this.id, this.new, p, x, getattr(p, f"{this.id}_latency")), **lagging}

    def _measured(self, p: Values, x: Values, r: Any, motion: TrueMotion) -> dict[str, Any]:
        this, id, dt = self.instrument, self.instrument.id, p.sample_interval
        values = self._at_epoch(p, x, r)
        errors = errors_of(this, values, p)
        with naming(f"sensor {id!r}, measure"):
            rows = dict(check_rows(this.measure(motion, errors, p), this.measurement))
        if this.quantum is not None:
            rows = {name: rounded(value, getattr(p, this.quantum.name)) for name, value in rows.items()}
        lost: Any = 0.0 if this.lost is None else this.lost(p, rows)
        rows |= {} if this.accuracy is None else this.accuracy(p, rows)
        rows |= this.exact(motion, errors, p)
        drifts = {term.value.name: values[term.name] for term in this.terms if term.kind == "drift" and term.value is not None}
        epochs = getattr(x, f"{id}_epochs") + 1.0
        there = lost_epoch(id, p, epochs * getattr(p, f"{id}_interval"), lost) == 0.0
        return {
            **{self._pending(name): value for name, value in rows.items()},
            **drifts,
            **(self._totals(p, values) if drifts else {}),
            f"{id}_pending": there,
            f"{id}_epochs": epochs,
            f"{id}_counter": 0.0,
            this.new: there * (getattr(p, f"{id}_latency") < 0.5 * dt),
        }

    def _delivered(self, p: Values, x: Values, u: Values) -> dict[str, Any]:
        this, id = self.instrument, self.instrument.id
        late = select(getattr(p, f"{id}_latency") < 0.5 * p.sample_interval, 0.0, getattr(x, f"{id}_counter"))
        return {
            **{row.name: getattr(x, self._pending(row.name)) for row in (*this.values, *this.exact_rows)},
            this.age: late * p.sample_interval,
        }

    def _pending(self, name: str) -> str:
        id = self.instrument.id
        return f"{id}_pending_{name.removeprefix(f'{id}_')}"


def _even(count: int) -> int:
    return count + count % 2


def _fixed(instrument: Instrument, p: Values) -> dict[str, Any]:
    """The errors that are not drawn, by name."""
    fixed = (term for term in instrument.terms if term.fixed is not None and term.value is None)
    return {term.name: getattr(p, term.fixed.name) for term in fixed}  # type: ignore[union-attr]


def _scaled(term: Term, p: Values, n: Any) -> Any:
    """Standard normals times the standard deviations of a term, in its shape."""
    assert term.sigma is not None
    if term.coupling is None:
        return getattr(p, term.sigma.name) * n
    rows, columns = term.shape
    sigma = [[getattr(p, (term.sigma if i == j else term.coupling).name) for j in range(columns)] for i in range(rows)]
    return ca.vertcat(*[ca.horzcat(*[sigma[i][j] * n[columns * i + j] for j in range(columns)]) for i in range(rows)])


def _with_fixed(term: Term, p: Values, drawn: Any) -> Any:
    return drawn if term.fixed is None else getattr(p, term.fixed.name) + drawn


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


def timing_state(id: str) -> Table:
    """State of an instrument's timing."""
    return Table((
        Row(f"{id}_pending", "1 if the latest epoch gave a measurement", lower=0.0, upper=1.0),
        Row(f"{id}_epochs", "Number of epochs so far"),
        Row(f"{id}_counter", "Samples since the latest epoch"),
        Row(f"{id}_due", "1 on a sample that ends with a measurement", lower=0.0, upper=1.0),
    ))  # fmt: skip


def counted(id: str, new: str, p: Values, x: Values, latency: Any) -> dict[str, Any]:
    """Count a sample: whether a pending measurement is delivered with it (row `new`), and whether another is due."""
    dt = p.sample_interval
    counter = getattr(x, f"{id}_counter") + 1.0
    arrives = ca.fabs(counter * dt - latency) < 0.5 * dt
    return {
        f"{id}_counter": counter,
        f"{id}_due": (counter + 0.5) * dt > getattr(p, f"{id}_interval"),
        new: arrives * getattr(x, f"{id}_pending"),
    }


def timing_sources(id: str, called: str) -> tuple[ErrorSource, ErrorSource]:
    """Latency and outages as sources of errors."""
    return (
        ErrorSource(f"{called} latency", (f"{id}_latency",)),
        ErrorSource(f"{called} outages", (f"{id}_outage_start", f"{id}_outage_end")),
    )


def lost_epoch(id: str, p: Values, time: Any, lost: Any = 0.0) -> Any:
    """`lost`, and 1 more for each outage window of the instrument in which an epoch lies; time: of it since the start, s."""
    # a microsecond decides ties, which rounding would otherwise decide arbitrarily
    time = time + 1e-6
    begin, end = getattr(p, f"{id}_outage_start"), getattr(p, f"{id}_outage_end")
    for i in range(OUTAGES):
        lost = lost + (time >= begin[i]) * (time < end[i])
    return lost


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
