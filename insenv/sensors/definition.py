"""What the declaration of an instrument must be: whole in itself, and beside the other sensors and the filters of `fusion`.

An instrument is checked once, where it is registered, so that a fault is one message there, and an installed package that
has one spoils nothing but itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any, get_args, get_type_hints

import casadi as ca

from insenv.base.errors import InputError, naming, nearest
from insenv.base.shipped import NAMES_OF_FUSION
from insenv.base.units import check_unit
from insenv.core.instructions import check_exact
from insenv.core.model import Values
from insenv.core.tables import Row, Table, check_rows
from insenv.sensors.contract import Sensor, no_motion
from insenv.sensors.figures import TimedSection
from insenv.sensors.instrument import Column, Instrument, Motion, Term, errors_of
from insenv.sensors.sampled import Sampled, TrueMotion, timing_rows

HOLDS = ("vertical", "horizontal", "heading")
"""What measurements may hold of a navigation."""
KINDS = get_args(get_type_hints(Term)["kind"])


def check_instrument(this: Instrument) -> None:
    """Raise `InputError`, which names the instrument, for a declaration that is wrong in itself."""
    with naming(f"sensor {this.id!r}"):
        _check_rows(this)
        _check_terms(this)
        _check_names(this)
        _check_keys(this)
        _check_columns(this)
    with naming(f"sensor {this.id!r}, measure"):
        _check_measure(this)


def check_beside(this: Instrument, instruments: Iterable[Instrument], sensors: Iterable[Sensor]) -> None:
    """Raise `InputError` for names that another sensor or a filter of `fusion` has: rows, estimated states, the id.

    instruments: the other ones.  sensors: the other ones, that are no instruments.
    """
    where = f"sensor {this.id!r}"
    module, _, attribute = NAMES_OF_FUSION.partition(":")
    of_fusion: Mapping[str, str] = getattr(import_module(module), attribute)()
    if this.id in of_fusion:
        raise InputError(f"{where}: {of_fusion[this.id]} has this name: choose another id")
    states = ((each.id, state.name) for each in instruments for _, state in _estimated(each.terms))
    owners: dict[str, str] = {name: f"the sensor {id!r}" for id, name in states}
    owners.update(of_fusion)
    for term, state in _estimated(this.terms):
        if state.name in owners:
            owner = owners[state.name]
            raise InputError(f"{where}, term {term.name!r}: {owner} has the state {state.name!r} already: choose another name")
    taken = {name: each.id for each in instruments for name in _rows_of(each)}
    for sensor in sensors:
        part = sensor.part(no_motion)
        taken |= {row.name: sensor.id for row in (*part.parameters, *part.state)}
    for name in _rows_of(this):
        if name in taken:
            raise InputError(
                f"{where}: row {name!r}: the sensor {taken[name]!r} has a row of this name: choose another, such as "
                f"'{this.id}_{name.removeprefix(f'{taken[name]}_')}'"
            )


def _estimated(terms: Iterable[Term]) -> Iterator[tuple[Term, Any]]:
    return ((term, state) for term in terms for state in term.states)


def _rows_of(this: Instrument) -> tuple[str, ...]:
    sampled = Sampled(this)
    return tuple(dict.fromkeys((*sampled.all_parameters.names, *sampled.all_state.names, *this.stated_errors.names)))


def _known(what: str, name: str, allowed: Collection[str]) -> None:
    if name not in allowed:
        raise InputError(f"{what} {name!r}: unknown{nearest(str(name), allowed)}")


def _once(what: str, names: Iterable[str]) -> None:
    names = list(names)
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"two {what} are named {twice[0]!r}: allowed is a name of its own for each")


def _check_rows(this: Instrument) -> None:
    if not this.values:
        raise InputError("values = (): allowed are the rows of a measurement, at least one")
    _ = this.measurement, Sampled(this).all_parameters, this.stated_errors, Sampled(this).all_state  # two rows of one name


def _check_terms(this: Instrument) -> None:
    parts = [part.name for part in (this.lag, this.outlier) if part is not None]
    _once("errors", [*(term.name for term in this.terms), *parts])
    if not any(term.kind == "white" for term in this.terms):
        raise InputError("no term is white noise: allowed is at least one white(...), from which a filter weighs a measurement")
    for term in this.terms:
        with naming(f"term {term.name!r}"):
            _check_term(this, term)
    owners: dict[str, str] = {}
    for term, state in _estimated(this.terms):
        first = owners.setdefault(state.name, term.name)
        if first != term.name or [each.name for each in term.states].count(state.name) > 1:
            raise InputError(
                f"the terms {first!r} and {term.name!r} are both estimated as the state {state.name!r}: "
                "allowed is a name of its own for each"
            )


def _check_term(this: Instrument, term: Term) -> None:
    if term.kind not in KINDS:
        raise InputError(f"kind = {term.kind!r}: allowed is {', '.join(map(repr, KINDS))}")
    if term.kind == "drift" and (term.time is None or term.sigma is None):
        raise InputError("a drift has the rows sigma and time: allowed is drift(...)")
    if term.flag:
        _known("flag", term.flag, this.all_parameters.names)
    if len(term.states) > len(term.parts):
        raise InputError(f"{len(term.states)} estimated states: allowed is at most {len(term.parts)}")
    for state, (_, elements) in zip(term.states, term.parts, strict=False):
        wrong = [element for element in state.elements if element not in elements]
        if wrong:
            listed = ", ".join(map(str, elements))
            raise InputError(f"state {state.name!r}: element {wrong[0]!r} of the shape {term.shape}: allowed is {listed}")
        for name in filter(None, (state.sigma, state.time, state.start)):
            _known(f"state {state.name!r}: stated row", name, this.stated_errors.names)


def _check_names(this: Instrument) -> None:
    values = [row.name for row in this.values]
    for what, given, allowed in (
        ("holds:", this.holds, HOLDS),
        ("aid_row:", filter(None, [this.aid_row]), values),
        ("limit_row:", filter(None, [this.limit_row]), values),
        ("sigma: row", filter(None, [this.sigma]), values),
        ("least_sigma: row", this.least_sigma, values),
        ("aid_parameters: row", this.aid_parameters, this.stated_errors.names),
    ):
        for name in given:
            _known(what, name, allowed)


def _check_keys(this: Instrument) -> None:
    table = this.all_parameters
    _once("keys", ["grade", *TimedSection.model_fields, *this.figures, *(setting.key for setting in this.settings)])
    for name, figure in this.figures.items():
        _known(f"figure {name!r}: row", figure.row, table.names)
        if figure.convert is None:
            check_unit(f"figure {name!r}", figure.unit, figure.row, table[figure.row].unit)
    for setting in this.settings:
        if setting.row:
            _known(f"setting {setting.key!r}: row", setting.row, table.names)
            check_unit(f"setting {setting.key!r}", setting.unit, setting.row, table[setting.row].unit)
    for name, grade in this.grades.items():
        for figure in grade.figures:
            _known(f"grade {name!r}: figure", figure, this.figures)
    _known("the default grade", this.grade, this.grades)
    if not (isinstance(this.interval_s, (int, float)) and 0.0 < this.interval_s <= 3600.0):
        raise InputError(f"interval_s = {this.interval_s!r} s: allowed is above 0 s, at most 3600 s")


def _check_columns(this: Instrument) -> None:
    values = {row.name: row for row in this.values}
    _once("columns", (column.key for column in this.columns))
    _once("columns of one row", (column.row for column in this.columns))
    for column in this.columns:
        with naming(f"column {column.key!r}"):
            _known("row", column.row, values)
            _check_column(column, values[column.row])


def _check_column(column: Column, row: Row) -> None:
    if column.axes and row.shape != (3,):
        raise InputError(f"axes: row {row.name!r} has the shape {row.shape}: allowed is (3,)")
    if column.unit:
        _known("the default unit", column.unit, column.units)


def _check_measure(this: Instrument) -> None:
    """Evaluate the measurement equation for symbols."""
    p, motion = _symbolic(this)
    errors = {term.name: ca.SX.sym(term.name, *(term.shape + (1, 1))[:2]) for term in this.terms}
    if this.lag is not None:
        errors[this.lag.name] = this.lag.value(Values(**_symbols(this.lag.state)))
    if this.outlier is not None:
        errors[this.outlier.name] = this.outlier.draw(p, ca.SX.sym("r", this.outlier.uniforms))
    values = Table(this.values)
    try:
        rows = check_rows(this.measure(motion, errors_of(this, errors, p), p), values)
    except AttributeError as fault:
        if isinstance(fault.obj, TrueMotion):
            parts = [name for name in vars(Motion) if not name.startswith("_")]
            raise InputError(f"the motion has no {fault.name!r}{nearest(str(fault.name), parts)}") from fault
        raise
    reported = {} if this.accuracy is None else this.accuracy(p, {**_symbols(values), **rows})
    shown = values.assemble({**rows, **reported})
    check_exact(ca.Function("measure", [ca.vertcat(*ca.symvar(shown))], [shown]))


def _symbols(table: Table) -> dict[str, Any]:
    return vars(table.symbols(ca.SX.sym("v", table.size)))


def _symbolic(this: Instrument) -> tuple[Values, TrueMotion]:
    """The parameters of an instrument and the motion of a plant, as symbols."""
    own = _symbols(this.all_parameters + timing_rows(this.id))
    shapes = {"q_nb": 4, "velocity_n": 3, "true_delta_velocity": 3}
    of_plant = ("sample_interval", "start_latitude", "start_longitude", "start_height", "latitude", "longitude", "height")
    moves = {name: ca.SX.sym(name, shapes.get(name, 1)) for name in (*shapes, *of_plant)}
    return Values(**own), TrueMotion(Values(**own, **moves), Values(**moves), ca.SX.sym("rate", 3))
