"""Keys that every table of a log has: its files, how they are written, the column and unit of the time; types of columns."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Strict, ValidationInfo

from insenv.base.remarks import clock
from insenv.base.toml import Number, Positive, Section, key, list_of
from insenv.core.tables import Array
from insenv.logs.units import axes_matrix


def _check_column(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, (str, int)) or (isinstance(value, int) and value < 0):
        raise ValueError("must be a column name in quotes or a column number, counted from 0")
    return value


def _check_axes(value: Any, info: ValidationInfo) -> Any:
    axes_matrix(value, reflection_allowed=info.field_name == "accel_axes")
    return value


def _as_tuple(value: object) -> object:
    files = [value] if isinstance(value, str) else value
    if not isinstance(files, (list, tuple)) or not files or not all(isinstance(f, str) and f for f in files):
        raise ValueError("must be a path or a list of paths, in quotes")
    return tuple(files)


Column = Annotated[str | int, BeforeValidator(_check_column)]
Columns3 = Annotated[tuple[Column, Column, Column], list_of(3, "three")]


def columns_of(size: int) -> Any:
    """The type of a key that names one column, or a list of several."""
    named: Any = Column if size == 1 else tuple[(Column,) * size]  # type: ignore[misc]
    return Column if size == 1 else Columns3 if size == 3 else Annotated[named, list_of(size, str(size))]


Sigma3 = Annotated[tuple[Positive, Positive, Positive], list_of(3, "three")]
Axes = Annotated[Any, AfterValidator(_check_axes)]
Files = Annotated[tuple[str, ...], BeforeValidator(_as_tuple)]
Columns4 = Annotated[tuple[Column, Column, Column, Column], list_of(4, "four")]
AngleUnit = Literal["deg", "rad"]
PositionUnit = Literal["deg", "rad", "1e-7 deg"]


class FileSection(Section):
    """The files of a section: how they are written, and the column and unit of the time."""

    file: Files = key(
        ...,
        "path (relative to this TOML file), or package:NAME/path for a file inside an installed Python package; .gz and "
        ".zip with one file are unpacked; a list of files joins their columns by time, and a column that several of them "
        'have is named with the name of its file, "gyro.csv:x"',
    )
    format: str = key(
        "csv",
        "how the files are written, a name of the table of formats above; csv: any text table; absent: by the end of the name "
        "of the first file, csv if no format has it",
    )
    delimiter: Literal["auto", ",", ";", "tab", "space"] = key("auto", "separator of the fields; space: blanks and tabs")
    header_rows: Annotated[int, Strict()] | None = key(
        None,
        "lines before the first row; the last of them holds the column names; absent: detected",
        "lines",
        ge=0,
        le=1000,
    )
    comment: str = key("#", "lines that start with this character are skipped", min_length=1, max_length=1)
    keep_where: dict[str, Number | list[Number]] = key(
        {},
        "use only the rows in which this column has this value (or one of these values); of several files, each that has the "
        "column is reduced so before they are joined",
    )
    skip_empty: bool = key(
        False, "skip rows in which one of the columns is empty, nan or null (GNSS columns in a file at IMU rate)", strict=True
    )
    time: Column = key(..., "column of the time stamp")
    time_unit: Literal["s", "ms", "us", "ns", "min", "h"] = key("s", "unit of the time column")
    time_scale: Positive = key(1.0, "further factor on the time, for a clock that runs fast or slow")
    time_offset_s: Number = key(0.0, "added to the time after unit and scale; all tables must share one clock", "s")

    @classmethod
    def column_keys(cls) -> tuple[str, ...]:
        """The keys that name columns."""
        return tuple(name for name, field in cls.model_fields.items() if (field.description or "").startswith("column"))

    def named_columns(self) -> list[Column]:
        """The columns that the keys name."""
        values = [value for name in self.column_keys() if (value := getattr(self, name)) is not None]
        return [column for value in values for column in (value if isinstance(value, tuple) else (value,))]


class MeasurementSection(FileSection):
    """The files of measurements that arrive some time after they were made."""

    age: Column | None = key(
        None,
        "column of the time from the measurement to its stamp [s], where stamps are of arrival; absent: stamps are of validity",
    )


def before(time: Array, limit: float) -> np.ndarray:
    """Whether times (n,) s are before a limit by more than rounding: a limit that is the time of a sample leaves it in."""
    return np.asarray(time < limit - (4.0 * np.spacing(abs(limit)) if np.isfinite(limit) else 0.0))


def window_words(start_s: float | None, stop_s: float | None) -> str:
    """The part of a log that its keys start_s and stop_s choose, for a message; absent ones are left out."""
    begin = "" if start_s is None else f"from start_s = {clock(start_s)} s"
    end = "" if stop_s is None else f"to stop_s = {clock(stop_s)} s"
    return " ".join(filter(None, (begin, end))) or "in the whole log"
