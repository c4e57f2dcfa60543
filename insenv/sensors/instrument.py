"""An aiding instrument, declared once: its errors, one measurement equation, the columns and keys that it has in files.

The plant evaluates the equation at the truth, with the errors that it has drawn (`insenv.sensors.sampled`).  A fusion filter
evaluates it at its estimate, with the errors that it estimates (`insenv.estimators.fusion.instruments`).  The limit
differentiates it along the truth (`insenv.evaluation.limits.states`).  The errors stated to an estimator, the sections of
scenarios and logs, the columns of exported logs and the sources of error of a budget follow from the same declaration.

Every measurement has the rows ``ID_new``, 1 on the one sample with which it arrives, and ``ID_age``, the time from its epoch
to the end of that sample.  The other rows keep their values until the next measurement.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Protocol

import casadi as ca
import numpy as np

from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.sensors.contract import HUGE, ErrorSource, Place

QUANTUM_SIGMA = 12.0**-0.5
"""Standard deviation of the rounding error over the quantum."""


class Motion(Protocol):
    """The motion of the inertial unit at the epoch of a measurement: true, estimated, or true with a small error.

    specific_force_b (3, m/s^2): mean over the sample.  height (m): above the ellipsoid.  climbed (m): height gained since the
    start.  speed_squared (m^2/s^2): of the velocity over the Earth.  displacement_n (3, m, n): from the start.
    """

    @property
    def specific_force_b(self) -> Any: ...

    @property
    def height(self) -> Any: ...

    @property
    def climbed(self) -> Any: ...

    @property
    def speed_squared(self) -> Any: ...

    @property
    def displacement_n(self) -> Any: ...

    def to_body(self, vector_n: Any) -> Any:
        """C_bn u_n (3)."""

    def to_navigation(self, vector_b: Any) -> Any:
        """C_nb u_b (3)."""

    def body_velocity(self, arm_b: Any, flow_n: Any = None) -> Any:
        """Velocity (3, m/s, b) of a point of the body at `arm_b` (3, m) over the Earth, or through a medium that flows."""


@dataclass(frozen=True)
class Estimated:
    """How a fusion filter estimates an error.

    name: of the state row.  meaning: of it, after "Estimated".  elements: those of the error that it estimates; empty: all.
    sigma, time: names of the stated rows of its standard deviation and correlation time, if they are not those of the error.
    start: name of the stated row that the estimate starts from; empty: from 0.  start_sigma: ``p -> ()``, the standard
    deviation at the start, if it is not the row sigma.  assumed: the standard deviation where nothing states it, 0: none.
    """

    name: str
    meaning: str
    elements: tuple[int, ...] = ()
    sigma: str = ""
    time: str = ""
    start: str = ""
    start_sigma: Callable[[Any], Any] | None = None
    assumed: float = 0.0


@dataclass(frozen=True)
class Term:
    """An error of an instrument.

    name: under which the measurement equation has it.  source: its name in budgets; terms of one name are one source.
    kind: "constant" over a run, "drift" (first-order Gauss-Markov), or "white" noise of each measurement.
    shape, unit, frame: of its value.
    fixed: parameter row of the same value in all runs.  sigma: parameter row of the standard deviation of what is drawn; of a
    matrix that of its diagonal, and coupling that of its other elements.  time: of a drift, the correlation time.
    value: state row of the value of a run; none for what is not drawn.
    stated: rows that tell an estimator of it; of a matrix those of the diagonal and of the other elements.
    states: how a filter estimates it; of a matrix the diagonal and the other elements.
    flag: parameter row without which it has no effect.
    normals: place of its first standard normal among those of the start (constant), or of each epoch (white), or both (drift);
    empty: after those of the terms before.
    """

    name: str
    source: str
    kind: Literal["constant", "drift", "white"]
    shape: tuple[int, ...] = ()
    unit: str = "1"
    frame: str = ""
    fixed: Row | None = None
    sigma: Row | None = None
    coupling: Row | None = None
    time: Row | None = None
    value: Row | None = None
    stated: tuple[Row, ...] = ()
    states: tuple[Estimated, ...] = ()
    flag: str = ""
    normals: tuple[int, ...] = ()

    @property
    def size(self) -> int:
        """Number of elements."""
        return math.prod(self.shape)

    @property
    def rows(self) -> tuple[Row, ...]:
        """Its parameter rows."""
        return tuple(row for row in (self.fixed, self.sigma, self.coupling, self.time) if row is not None)

    @property
    def parts(self) -> tuple[tuple[Row | None, tuple[int, ...]], ...]:
        """Rows of standard deviations and the elements, by rows of a matrix, for which each stands."""
        if self.coupling is None:
            return ((self.sigma, tuple(range(self.size))),)
        n = self.shape[0]
        diagonal = tuple(range(0, n * n, n + 1))
        return (self.sigma, diagonal), (self.coupling, tuple(i for i in range(n * n) if i not in diagonal))

    def variance(self, rows: Mapping[str, Any]) -> np.ndarray:
        """Variance (size,) of the ensemble of instruments with these parameters (SI, by row name), fixed parts included."""
        total = np.zeros(self.size)
        if self.fixed is not None:
            total += np.broadcast_to(np.ravel(rows[self.fixed.name]), self.size) ** 2
        for row, elements in self.parts:
            if row is not None:
                total[list(elements)] += np.broadcast_to(np.ravel(rows[row.name]), len(elements)) ** 2
        return total * (float(np.ravel(rows[self.flag])[0]) if self.flag else 1.0)


def constant(
    row: str, name: str, source: str, meaning: str, unit: str = "1", shape: tuple[int, ...] = (), frame: str = "", *,
    value: str = "", stated: str = "", stated_shape: tuple[int, ...] = (), sigma: str = "", drawn: bool = True,
    limits: Mapping[str, Any] | None = None, states: tuple[Estimated, ...] = (), flag: str = "",
    normals: tuple[int, ...] = (),
) -> Term:  # fmt: skip
    """An error that is constant over a run: a fixed part, the parameter row `row`, and one drawn at the start.

    value: name of its state row; "ROW_true" if empty.  stated, stated_shape: the row for estimators, by default ROW_sigma of
    all axes together.  drawn: whether there is a drawn part.  limits: of the fixed part.
    """
    name_of_sigma = sigma or f"{row}_sigma"
    return Term(
        name, source, "constant", shape, unit, frame,
        fixed=Row(row, f"{meaning}, fixed part", unit, shape, frame, **(limits or {})),
        sigma=_drawn(name_of_sigma, meaning, unit, shape, frame) if drawn else None,
        value=Row(value or f"{row}_true", meaning, unit, shape, frame) if drawn else None,
        stated=(sigma_row(stated or name_of_sigma, meaning, unit, stated_shape, frame if stated_shape else ""),),
        states=states, flag=flag, normals=normals,
    )  # fmt: skip


def drift(
    row: str, name: str, source: str, meaning: str, unit: str = "1", shape: tuple[int, ...] = (), frame: str = "", *,
    sigma_shape: tuple[int, ...] = (), start_time: float = 600.0, value: str = "", states: tuple[Estimated, ...] = (),
    flag: str = "", normals: tuple[int, ...] = (),
) -> Term:  # fmt: skip
    """A first-order Gauss-Markov error with the parameter rows ROW_sigma and ROW_time, which are stated to estimators."""
    sigma_frame = frame if sigma_shape else ""
    time = Row(f"{row}_time", f"{meaning} (Gauss-Markov), correlation time", "s", start=start_time, lower=1e-3, upper=HUGE)
    deviation = f"{meaning} (Gauss-Markov), standard deviation"
    return Term(
        name, source, "drift", shape, unit, frame,
        sigma=Row(f"{row}_sigma", deviation, unit, sigma_shape, sigma_frame, lower=0.0), time=time,
        value=Row(value or row, f"{meaning} at the latest epoch", unit, shape, frame),
        stated=(sigma_row(f"{row}_sigma", f"{meaning} (Gauss-Markov)", unit, sigma_shape, sigma_frame), time),
        states=states, flag=flag, normals=normals,
    )  # fmt: skip


def white(
    row: str, source: str, meaning: str, unit: str, shape: tuple[int, ...] = (), frame: str = "", *,
    sigma_shape: tuple[int, ...] = (), normals: tuple[int, ...] = (),
) -> Term:  # fmt: skip
    """White noise of a measurement: the term "noise" with the parameter row `row`, which is stated to estimators."""
    sigma_frame = frame if sigma_shape else ""
    return Term(
        "noise", source, "white", shape, unit, frame,
        sigma=Row(row, f"{meaning}, standard deviation", unit, sigma_shape, sigma_frame, lower=0.0),
        stated=(sigma_row(row, meaning, unit, sigma_shape, sigma_frame),), normals=normals,
    )  # fmt: skip


def sigma_row(name: str, meaning: str, unit: str = "1", shape: tuple[int, ...] = (), frame: str = "") -> Row:
    """A row that tells an estimator of a standard deviation."""
    return Row(name, f"{meaning}, 1 sigma", unit, shape, frame, lower=0.0, upper=HUGE)


def _drawn(name: str, meaning: str, unit: str, shape: tuple[int, ...], frame: str) -> Row:
    return Row(name, f"{meaning}, 1 sigma of the part drawn at the start", unit, shape, frame, lower=0.0)


@dataclass(frozen=True)
class Lag:
    """A part of what an instrument shows that follows the motion late: its state, and what a filter takes for it.

    name: under which the measurement equation has it.  state: rows.  start: ``p -> rows``.  sample: ``(p, x) -> rows`` after
    every sample.  value: ``x -> value``.  estimate: ``(motion, p) -> value``.
    """

    name: str
    state: Table
    start: Callable[[Values], dict[str, Any]]
    sample: Callable[[Values, Values], dict[str, Any]]
    value: Callable[[Values], Any]
    estimate: Callable[[Any, Values], Any]


@dataclass(frozen=True)
class Outlier:
    """An error of single measurements: `draw` ``(p, uniforms) -> value``; probability: its parameter row."""

    name: str
    probability: str
    uniforms: int
    draw: Callable[[Values, Any], Any]


@dataclass(frozen=True)
class Column:
    """A measured row as columns of a log.

    key: of the section; it names one column, or those of x, y, z or north, east, down.  row: of the measurement.  meaning: of
    the key.  units: allowed units and their SI values; the key KEY_unit chooses one, if `unit_key` names no other.
    unit: its default, none if empty.  axes: whether the key `axes` turns the columns into the body's.
    offset: key of a number that is added.  optional: whether a log may lack it.  constant: key of one number (deg) in place
    of the column.  angle: whether it is wrapped.
    """

    key: str
    row: str
    meaning: str
    units: Mapping[str, float] = field(default_factory=dict)
    unit: str = ""
    unit_key: str = ""
    axes: bool = False
    offset: str = ""
    optional: bool = False
    constant: str = ""
    angle: bool = False


@dataclass(frozen=True)
class Setting:
    """A key that scenarios and logs have beside the errors: `kind` is its type for pydantic.

    row: the parameter row that it sets, by the conversion of its unit; empty: none by itself.  needed: whether a log
    must give it.
    """

    key: str
    kind: Any
    default: Any
    meaning: str
    unit: str = ""
    row: str = ""
    needed: bool = False


def _nothing(motion: Any, errors: Values, p: Values) -> dict[str, Any]:
    return {}


@dataclass(frozen=True, eq=False)
class Instrument:
    """An aiding instrument.

    id: short name; also that of its sections and the beginning of its rows.  title: for headings of the documentation.
    called: in sentences and lists ("the odometer").  causes: what to look at where its measurements do not fit a filter.
    holds: what its measurements hold of a navigation, of "vertical", "horizontal" and "heading".
    values: rows of what it measures.  terms: its errors.
    measure: ``(motion, errors, p) -> {row: value}``: what it shows, of a `Motion`, of errors by the names of the terms and of
        parameters, for each of the rows `values` that is no reported accuracy.  All that it does is differentiable.
    parameters: further parameter rows.  stated: further rows stated to estimators, of the same names as parameters.
    exact, exact_rows: ``(motion, errors, p) -> {row: value}``: true values that arrive with the measurement.
    totals: state rows of the plant that add up terms, and ``(errors, p) -> value`` of each.
    accuracy: ``(p, {row: value}) -> {row: value}``: what a measurement reports of its own accuracy.
    lost: ``(p, {row: value}) -> 0 or 1``: whether a measurement is not delivered.
    quantum: parameter row of the step in which values are shown; empty: they are not rounded.
    lag, outlier: further errors.  outlier's and lag's names are those of terms for `measure`.
    aid_row: the value that a filter compares.  limit_row: the values that the limit takes; both empty: the only one.
    aid_parameters: the stated rows that a filter takes as parameters, beside those of its states.
    angle: whether the value compared is an angle.  sigma: of the rows of the measurement that of its standard deviation; empty:
        that of the white noise.
    least_sigma: smallest standard deviation by row, of an instrument without errors.
    turned: whether a whole vector over the Earth, the velocity, is turned into the measurement: what linearisation leaves of
        it is counted by filters.
    shows_heading: whether a vector of the place is turned into the measurement, so that one shows a heading that was not known:
        filters then derive the equation again at the attitude found.
    lasting: ``(motion, p) -> (variance, correlation time)`` of what is no state of a filter and lasts; `reported` says that the
        standard deviation that a measurement states contains it.
    usable: ``(motion, p) -> 0 or 1``: whether a filter uses a measurement.
    columns: its columns in logs.  settings: its further keys.  surroundings: ``(section, place) -> rows`` that the start sets.
    figures, grades, grade: keys of its errors, its catalogue and the default of it (`insenv.sensors.figures`).
    interval_s: default time between measurements.
    """

    id: str
    title: str
    called: str
    what: str
    causes: str
    values: tuple[Row, ...]
    terms: tuple[Term, ...]
    measure: Callable[[Any, Values, Values], dict[str, Any]]
    holds: tuple[str, ...] = ()
    parameters: tuple[Row, ...] = ()
    stated: tuple[Row, ...] = ()
    exact: Callable[[Any, Values, Values], dict[str, Any]] = _nothing
    exact_rows: tuple[Row, ...] = ()
    totals: tuple[tuple[Row, Callable[[Values, Values], Any]], ...] = ()
    accuracy: Callable[[Values, Mapping[str, Any]], dict[str, Any]] | None = None
    lost: Callable[[Values, Mapping[str, Any]], Any] | None = None
    quantum: Row | None = None
    lag: Lag | None = None
    outlier: Outlier | None = None
    aid_row: str = ""
    limit_row: str = ""
    aid_parameters: tuple[str, ...] = ()
    angle: bool = False
    sigma: str = ""
    least_sigma: Mapping[str, float] = field(default_factory=dict)
    turned: bool = False
    shows_heading: bool = False
    lasting: Callable[[Any, Values], tuple[Any, Any]] | None = None
    usable: Callable[[Any, Values], Any] | None = None
    columns: tuple[Column, ...] = ()
    settings: tuple[Setting, ...] = ()
    surroundings: Callable[[Any, Place | None], dict[str, Any]] | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)
    grades: Mapping[str, Any] = field(default_factory=dict)
    grade: str = "perfect"
    interval_s: float = 1.0

    @property
    def new(self) -> str:
        """The row that is 1 on the sample with which a measurement arrives."""
        return f"{self.id}_new"

    @property
    def age(self) -> str:
        """The row of the time from the epoch of the latest measurement to its arrival."""
        return f"{self.id}_age"

    @cached_property
    def measurement(self) -> Table:
        """The rows of a measurement: outputs of a plant, columns of a log, inputs of an estimator."""
        age = "Time from the epoch of the latest measurement to the end of that sample"
        arrival = (
            Row(self.new, "1 on the one sample with which a measurement arrives", lower=0.0, upper=1.0, flag=True),
            Row(self.age, age, "s", lower=-1.0, upper=3600.0),
        )
        return Table((*arrival, *self.values))

    @property
    def compared(self) -> Row:
        """The row that a filter compares."""
        return self.measurement[self.aid_row or self.values[0].name]

    @property
    def limiting(self) -> Row:
        """The row that the limit takes."""
        return self.measurement[self.limit_row or self.values[0].name]

    @property
    def noise(self) -> Term:
        """Its white noise."""
        return next(term for term in self.terms if term.kind == "white")

    @cached_property
    def all_parameters(self) -> Table:
        """Parameter rows of its errors, then its further ones."""
        quantum = () if self.quantum is None else (self.quantum,)
        return Table((*(row for term in self.terms for row in term.rows), *self.parameters, *quantum))

    @cached_property
    def stated_errors(self) -> Table:
        """The rows stated to an estimator.  Start values, mostly 0, mean "no such error"."""
        return Table(tuple(dict.fromkeys((*self.stated, *(row for term in self.terms for row in term.stated)))))

    def stated_values(self, rows: Mapping[str, Any]) -> dict[str, Any]:
        """The values of `stated_errors` from parameters (SI, by row name): fixed and drawn parts of an error as one sigma."""
        values: dict[str, Any] = {row.name: rows[row.name] for row in self.stated}
        parts: dict[str, list[Any]] = {}
        flags: dict[str, str] = {}
        for term in self.terms:
            stated = [row for row in term.stated if row is not term.time]
            if term.time is not None:
                values[term.time.name] = rows[term.time.name]
            for row, (sigma, elements) in zip(stated, term.parts, strict=False):
                sizes = parts.setdefault(row.name, [])
                if term.fixed is not None:
                    sizes.append(np.ravel(rows[term.fixed.name])[list(elements)] if row.shape == () else rows[term.fixed.name])
                sizes += [] if sigma is None else [rows[sigma.name]]
                flags[row.name] = term.flag
                if term.kind == "white" and self.quantum is not None:
                    sizes.append(QUANTUM_SIGMA * rows[self.quantum.name])
        for name, sizes in parts.items():
            axes = self.stated_errors[name].shape
            total = np.asarray(sizes[0]) if axes and len(sizes) == 1 else np.hypot(*sizes) if axes else root_sum(*sizes)
            values[name] = total * float(rows[flags[name]]) if flags[name] else total
        return values

    @property
    def error_sources(self) -> tuple[ErrorSource, ...]:
        """The sources of its errors, which can be switched off alone."""
        rows: dict[str, str] = {}
        if self.outlier is not None:
            rows["outliers"] = self.outlier.probability
        if self.lag is not None:
            rows[self.lag.name] = f"{self.id}_{self.lag.name}"
        if self.quantum is not None:
            rows["rounding"] = self.quantum.name
        return (*sources_of(self.terms), *(ErrorSource(f"{self.id} {what}", (row,)) for what, row in rows.items()))


def sources_of(terms: Iterable[Term]) -> tuple[ErrorSource, ...]:
    """The sources of errors; terms with the same one are switched off together."""
    rows: dict[str, list[str]] = {}
    for term in terms:
        rows.setdefault(term.source, []).extend(row.name for row in term.rows if row is not term.time)
    return tuple(ErrorSource(source, tuple(names)) for source, names in rows.items())


def root_sum(*parts: Any) -> float:
    """Root of the sum of the squares of the largest elements of each part."""
    return float(np.sqrt(sum(float(np.max(np.abs(part))) ** 2 for part in parts)))


def assumed(row: Row, sigma: float) -> Row:
    """A stated row with the standard deviation that a filter assumes where nothing states it."""
    return replace(row, start=sigma) if sigma else row


def errors_of(instrument: Instrument, values: Mapping[str, Any], p: Values | None = None) -> Values:
    """The errors for `measure` from `values` by name; all others are 0.

    p: parameters, for those without effect because the row of their flag is 0; None: all have effect.
    """
    parts = (instrument.lag, instrument.outlier)
    errors = {term.name: values.get(term.name, _zero(term.shape)) for term in instrument.terms}
    errors |= {part.name: values.get(part.name, 0.0) for part in parts if part is not None}
    if p is not None:
        errors |= {term.name: errors[term.name] * getattr(p, term.flag) for term in instrument.terms if term.flag}
    return Values(**errors)


def _zero(shape: tuple[int, ...]) -> Any:
    """0 in a shape, so that what it enters is left out of the equations."""
    return ca.SX(*(shape + (1, 1))[:2]) if shape else 0.0
