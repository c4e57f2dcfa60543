"""Aiding instruments of a recorded log: their readings, and what estimators are told of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.logs.assemble import LogReader
from insenv.logs.formats.csv_table import TextTable
from insenv.logs.recorded import Readings, delivered
from insenv.logs.units import ANGLE_UNITS, SPEED_UNITS, Array, axes_matrix, wrap
from insenv.sensors import barometer, dvl, heading, magnetometer, odometer
from insenv.sensors.contract import Place
from insenv.sensors.figures import FiguresSection
from insenv.sensors.instruments import INSTRUMENTS
from insenv.sensors.magnetometer import field_rows
from insenv.sensors.sampled import Sampled
from insenv.sensors.units import deg_to_rad

FIELD_UNITS = {"T": 1.0, "uT": 1e-6, "nT": 1e-9, "G": 1e-4, "mG": 1e-7}
"""unit -> T."""


EQUATIONS: Mapping[str, Sampled] = {
    "barometer": barometer.EQUATIONS,
    "magnetometer": magnetometer.EQUATIONS,
    "odometer": odometer.EQUATIONS,
    "dvl": dvl.EQUATIONS,
    "heading": heading.EQUATIONS,
}


def read(id: str, section: Any, reader: LogReader) -> Readings:
    """The readings of a section.  Raises `InputError` for wrong columns or values."""
    columns = [column for column in _columns(id, section) if column is not None]
    table, stamp = reader.read(id, section, [*columns, *([] if section.age is None else [section.age])])
    time, arrival, age = reader.validity(section, table, stamp)
    values, rows = _values(id, section, table)
    return Readings(id, id, time, values, rows, arrival, age)


def _columns(id: str, section: Any) -> tuple[Any, ...]:
    """The columns of the measured values, None for those that the section does not name."""
    if id == "barometer":
        return (section.height,)
    if id == "odometer":
        return (section.speed,)
    if id == "heading":
        return (section.azimuth, section.azimuth_sigma, *(section.baseline or ()))
    return tuple(section.field if id == "magnetometer" else section.velocity)


def _values(id: str, section: Any, table: TextTable) -> tuple[Array, tuple[str, ...]]:
    """The measured values (m, k) in SI and b or n, and the rows that they are.  Raises `InputError` for wrong values."""
    if id == "barometer":
        return table.columns([section.height]) + section.height_offset_m, ("barometer_height",)
    if id == "magnetometer":
        field = table.columns(section.field) @ axes_matrix(section.axes).T * FIELD_UNITS[section.field_unit]
        return field, ("magnetometer_field_b",)
    if id == "odometer":
        return table.columns([section.speed]) * SPEED_UNITS[section.speed_unit], ("odometer_speed",)
    if id == "dvl":
        return table.columns(section.velocity) @ axes_matrix(section.axes).T, ("dvl_velocity_b",)
    wanted = [section.azimuth] if section.azimuth_sigma is None else [section.azimuth, section.azimuth_sigma]
    angles = table.columns(wanted) * ANGLE_UNITS[section.azimuth_unit]
    if section.azimuth_sigma is None:
        angles = np.column_stack([angles, np.full(len(angles), np.radians(section.azimuth_sigma_deg))])
    bad = np.flatnonzero(angles[:, 1] <= 0.0)
    if bad.size:
        raise InputError(
            f"{table.where(bad[0])}: standard deviation of the azimuth is {angles[bad[0], 1]:g} rad, must be above 0"
        )
    angles[:, 0] = wrap(angles[:, 0])
    if section.baseline is None:
        return angles, ("heading_azimuth", "heading_azimuth_sigma")
    values = np.hstack([angles, table.columns(section.baseline)])
    return values, ("heading_azimuth", "heading_azimuth_sigma", "heading_baseline_n")


def told(id: str, section: FiguresSection | None, place: Place | None) -> dict[str, Any]:
    """What is told of an instrument (rows of `sensors.instruments.TOLD`) by its section; None: by the default grade.

    place: where the log is, for the field of the Earth.  Raises `InputError` where a magnetometer has none.
    """
    equations = EQUATIONS[id]
    rows = (section or _default(id)).error_rows()
    for name in ("lever_arm", "mounting", "baseline"):
        for suffix, row, convert in (("m", "b", np.asarray), ("deg", "", deg_to_rad)):
            value, target = getattr(section, f"{name}_{suffix}", None), f"{id}_{name}" + (f"_{row}" if row else "")
            if value is not None and target in equations.parameters:
                rows[target] = convert(np.array(value))
    if getattr(section, "water_track", False):
        rows["dvl_water_track"] = 1.0
    if id == "magnetometer":
        field = getattr(section, "field_nt", None)
        if field is None and place is None:
            raise InputError("magnetometer: the field of the Earth needs a place: [gnss], [initial] latitude_deg, or field_nt")
        rows |= field_rows(getattr(section, "year", 2026.0), field, place or Place(0.0, 0.0, 0.0))
    table = equations.all_parameters
    found = equations.told(table.unpack(table.pack(rows)))
    return {name: np.array(value, dtype=float) if np.ndim(value) else float(value) for name, value in found.items()}


def _default(id: str) -> FiguresSection:
    figures: Any = {
        "barometer": barometer.BarometerFigures,
        "magnetometer": magnetometer.MagnetometerFigures,
        "odometer": odometer.OdometerFigures,
        "dvl": dvl.DvlFigures,
        "heading": heading.HeadingFigures,
    }[id]
    return figures()


def sample_columns(readings: Sequence[Readings], end: Array, dt: Array) -> dict[str, Array]:
    """Columns of the estimators' inputs for samples that end at `end` (n,) s and are `dt` (n,) s long.

    Which measurement belongs to which sample: see `insenv.logs.recorded.delivered`.
    """
    columns: dict[str, Array] = {}
    for each in readings:
        given = INSTRUMENTS[each.id]
        chosen, sample, age = delivered(each.time, each.arrival, each.age, end, dt)
        rows = {given.new: np.ones(len(chosen)), given.age: age}
        rows |= {name: values[chosen] for name, values in each.columns().items()}
        for name, values in rows.items():
            start = given.measurement[name].flat_start().reshape(given.measurement[name].shape)
            columns[name] = np.tile(start, (len(end), *[1] * start.ndim)) if start.ndim else np.full(len(end), float(start))
            columns[name][sample] = values
    return columns
