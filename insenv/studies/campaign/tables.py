"""The runs of a campaign as a table: one row per run, as a DataFrame, a CSV file or a Parquet file."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.studies.campaign.statistics import Statistics

FORMATS = ("csv", "parquet")


def run_columns(found: Statistics) -> dict[str, NDArray[Any]]:
    """By name: number and seed of the run, its varied keys, then final error, rms, limit and stated of each channel, health.

    Values of choices are the chosen ones.  Numbers that do not exist are NaN.
    """
    columns: dict[str, NDArray[Any]] = {"run": np.arange(len(found.seeds)), "seed": found.seeds.astype(np.int64)}
    for place, variation in enumerate(found.plan.variations):
        numbers = found.values[:, place]
        given = variation.distribution
        columns[variation.key] = numbers if given.kind != "choice" else np.array([given.value(number) for number in numbers])
    for kind in ("final", "rms", "limit", "stated"):
        columns |= {f"{kind}_{name}": getattr(found, kind)[:, place] for place, name in enumerate(found.channels)}
    if found.health:
        columns["health"] = np.array(["" if one is None else one.verdict for one in found.health])
    columns["diverged"] = ~found.whole
    return columns


def check_format(name: str) -> None:
    """Raise `InputError` for a format that is unknown or whose package is missing."""
    if name not in FORMATS:
        raise InputError(f"table = {name!r}: allowed is {' or '.join(FORMATS)}")
    if name == "parquet":
        need("table 'parquet'", "pyarrow", extra="workbench")


def write_runs(found: Statistics, path: Path, name: str) -> None:
    """Write the table of the runs in a format (`FORMATS`); numbers keep all their digits."""
    check_format(name)
    columns = run_columns(found)
    if name == "parquet":
        import pyarrow
        import pyarrow.parquet

        pyarrow.parquet.write_table(pyarrow.table({key: pyarrow.array(values) for key, values in columns.items()}), path)
        return
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(_texts(values) for values in columns.values()), strict=True))


def _texts(values: NDArray[Any]) -> list[Any]:
    """Values as they stand in a CSV file: NaN is empty."""
    if values.dtype.kind != "f":
        return [str(value).lower() if values.dtype.kind == "b" else value for value in values.tolist()]
    return ["" if np.isnan(value) else repr(value) for value in values.tolist()]
