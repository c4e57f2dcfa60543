"""Aiding instruments of a recorded log: their sections, their readings, their stated errors, and the samples with all of them.

All of it follows from the declaration of the instrument (`insenv.sensors.instrument`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Literal

import numpy as np
from pydantic import ValidationInfo, create_model, field_validator

from insenv.base.errors import InputError
from insenv.base.toml import Number, Positive, key
from insenv.core.tables import Array, Table
from insenv.logs.assemble import LogReader
from insenv.logs.columns import Axes, MeasurementSection, columns_of
from insenv.logs.description import LogDescription
from insenv.logs.formats.csv_table import TextTable
from insenv.logs.recorded import GnssFixes, Readings, RecordedLog, delivered
from insenv.logs.units import axes_matrix, wrap
from insenv.sensors import registry
from insenv.sensors.contract import Place
from insenv.sensors.gnss import FIX
from insenv.sensors.instrument import Column as MeasuredColumn
from insenv.sensors.instrument import Instrument
from insenv.sensors.registry import figures_of, setting_key

_AXES = 'axes of the columns: "FRD", "FLU", ... (where x, y, z point), "+x-y-z" (body forward, right, down), or 3x3 C_bs'


@cache
def section_of(instrument: Instrument) -> type[MeasurementSection]:
    """The section of a log with the columns of an instrument, its errors and its further keys."""
    keys: dict[str, Any] = {}
    validators: dict[str, Any] = {}
    for column in instrument.columns:
        keys |= _column_keys(instrument, column)
        if column.constant:
            validators[f"_{column.constant}"] = field_validator(column.constant)(_either(column.key, column.constant))
    if any(column.axes for column in instrument.columns):
        keys["axes"] = (Axes, key(..., _AXES))
    for setting in instrument.settings:
        keys[setting.key] = setting_key(setting, ... if setting.needed else setting.default)
    bases: Any = (MeasurementSection, figures_of(instrument))
    title = f"{instrument.called[0].upper()}{instrument.called[1:]}: its measurements and its errors."
    return create_model(f"{instrument.id.title()}Section", __base__=bases, __doc__=title, __validators__=validators, **keys)


def _column_keys(instrument: Instrument, column: MeasuredColumn) -> dict[str, Any]:
    size = instrument.measurement[column.row].size
    several, kind = size > 1, columns_of(size)
    may_lack = column.optional or bool(column.constant)
    meaning = f"{'columns' if several else 'column'} of the {column.meaning}"
    keys: dict[str, Any] = {column.key: (kind | None if may_lack else kind, key(None if may_lack else ..., meaning))}
    if column.units and not column.unit_key:
        keys[f"{column.key}_unit"] = (Literal[tuple(column.units)], key(column.unit or ..., f"unit of the {column.key}"))
    if column.offset:
        keys[column.offset] = (
            Number,
            key(0.0, "added to the height: the geoid undulation for heights above mean sea level", "m"),
        )
    if column.constant:
        what = f"constant {column.meaning}, where the log has none"
        keys[column.constant] = (Positive | None, key(None, what, "deg", validate_default=True))
    return keys


def _either(column: str, constant: str) -> Any:
    def check(value: Any, info: ValidationInfo) -> Any:
        if column in info.data and (info.data[column] is None) == (value is None):
            raise ValueError(f"give either {column} (a column) or {constant} (a number [deg])")
        return value

    return check


def description_class() -> type[LogDescription]:
    """`LogDescription` with an optional section for every registered instrument."""
    return _with_sections(tuple(registry.instruments().values()))


@cache
def _with_sections(instruments: tuple[Instrument, ...]) -> type[LogDescription]:
    keys: dict[str, Any] = {each.id: (section_of(each) | None, key(None, each.called)) for each in instruments}
    return create_model("LogDescription", __base__=LogDescription, **keys)


def read(id: str, section: Any, reader: LogReader) -> Readings:
    """The readings of a section.  Raises `InputError` for wrong columns or values."""
    instrument = registry.instruments()[id]
    present = [column for column in instrument.columns if getattr(section, column.key) is not None or column.constant]
    names = [name for column in present for name in _names(section, column)]
    table, stamp = reader.read(id, section, [*names, *([] if section.age is None else [section.age])])
    time, arrival, age = reader.validity(section, table, stamp)
    values = np.hstack([_values(section, column, table) for column in present])
    return Readings(id, id, time, values, tuple(column.row for column in present), arrival, age)


def _names(section: Any, column: MeasuredColumn) -> tuple[Any, ...]:
    """The columns of a file that hold a measured row."""
    named = getattr(section, column.key)
    return () if named is None else tuple(named) if isinstance(named, (tuple, list)) else (named,)


def _values(section: Any, column: MeasuredColumn, table: TextTable) -> Array:
    """The values (m, k) of a measured row, SI, body axes."""
    names = _names(section, column)
    if not names:
        return np.full((len(table.lines), 1), np.radians(getattr(section, column.constant)))
    values = table.columns(names)
    if column.axes:
        values = values @ axes_matrix(section.axes).T
    if column.units:
        values = values * column.units[getattr(section, column.unit_key or f"{column.key}_unit")]
    if column.offset:
        values = values + getattr(section, column.offset)
    if column.constant:
        wrong = np.flatnonzero(values[:, 0] <= 0.0)
        if wrong.size:
            where = table.where(wrong[0])
            raise InputError(f"{where}: {column.meaning} is {values[wrong[0], 0]:g} rad, must be above 0")
    return wrap(values) if column.angle else values


def stated_errors(id: str, section: Any, place: Place | None) -> dict[str, Any]:
    """Stated errors of an instrument, by row of its `stated_errors`, by its section; None: by the default grade.

    place: where the log is, for the field of the Earth.  Raises `InputError` where a magnetometer has none.
    """
    instrument = registry.instruments()[id]
    figures: Any = figures_of(instrument)() if section is None else section
    rows = figures.error_rows()
    if instrument.surroundings is not None:
        rows |= instrument.surroundings(section, place)
    table = instrument.all_parameters
    values = instrument.stated_values(table.unpack(table.pack(rows)))
    return {name: np.array(value, dtype=float) if np.ndim(value) else float(value) for name, value in values.items()}


def _instrument_columns(readings: Sequence[Readings], end: Array, dt: Array) -> dict[str, Array]:
    """Columns of the estimators' inputs for samples that end at `end` (n,) s and are `dt` (n,) s long.

    Which measurement belongs to which sample: see `insenv.logs.recorded.delivered`.
    """
    columns: dict[str, Array] = {}
    for each in readings:
        instrument = registry.instruments()[each.id]
        chosen, sample, age = delivered(each.time, each.arrival, each.age, end, dt)
        rows = {instrument.new: np.ones(len(chosen)), instrument.age: age}
        rows |= {name: values[chosen] for name, values in each.columns().items()}
        columns |= _spread(instrument.measurement, rows, sample, len(end))
    return columns


def _spread(table: Table, rows: Mapping[str, Array], sample: np.ndarray, count: int) -> dict[str, Array]:
    """Columns of `count` samples with the values of rows (k, ...) at some of them (k,), and their start values at others."""
    columns = {}
    for name, values in rows.items():
        start = table[name].flat_start().reshape(table[name].shape)
        columns[name] = np.tile(start, (count, *[1] * start.ndim)) if start.ndim else np.full(count, float(start))
        columns[name][sample] = values
    return columns


# The samples of a recorded log as inputs of estimators, each with the fix and the measurements that arrive in it.


def sample_columns(log: RecordedLog, window: slice) -> tuple[dict[str, Array], int]:
    """Samples in `window` as columns by the names of the estimators' inputs, and the number of fixes left out.

    A fix belongs to the first sample that ends at or after its arrival, or its time where the log states no arrival; its
    age, `gnss_age`, counts to the end of that sample.  A sample has at most one fix: of several, the last.
    """
    columns = {
        "delta_angle": log.delta_angle[window],
        "delta_velocity": log.delta_velocity[window],
        "dt": log.dt[window],
        **_instrument_columns(log.instruments, log.imu_time[window], log.dt[window]),
    }
    if log.gnss is None:
        return columns, 0
    fixes, dropped = _fix_columns(log.gnss, log.imu_time[window], log.dt[window])
    return {**columns, **fixes}, dropped


def _fix_columns(gnss: GnssFixes, end: Array, dt: Array) -> tuple[dict[str, Array], int]:
    fix, sample, age = delivered(gnss.time, gnss.arrival, gnss.age, end, dt)
    arrived = gnss.time if gnss.arrival is None else gnss.arrival
    inside = np.count_nonzero((arrived > end[0] - dt[0]) & (arrived <= end[-1]))
    values = {**vars(gnss), "valid": np.ones(len(gnss.time)), "velocity_valid": np.ones(len(gnss.time))}
    moving = gnss.velocity_n is not None and gnss.velocity_sigma is not None
    names = [name.removeprefix("gnss_") for name in FIX.names if moving or "velocity" not in name]
    rows = {f"gnss_{name}": age if name == "age" else values[name][fix] for name in names}
    return _spread(FIX, rows, sample, len(end)), int(inside - len(fix))
