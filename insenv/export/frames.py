"""The tables of a recorded log as pandas DataFrames."""

from __future__ import annotations

from typing import TYPE_CHECKING

from insenv.export.log_tables import tables
from insenv.logs import RecordedLog
from insenv.report.notebook import data_frame

if TYPE_CHECKING:
    from pandas import DataFrame


def to_dataframes(log: RecordedLog) -> dict[str, DataFrame]:
    """The tables of a log by section (imu, gnss, the instruments, reference), indexed by time (s).

    The columns are those of the CSV files that `insenv.write` makes of a log.  Raises `InsenvError` if pandas is missing.
    """
    found = {}
    for name, columns in tables(log).items():
        time = columns.pop("time_s")
        found[name] = data_frame(time, columns)
    return found
