"""Arrays of NumPy (.npy, .npz) as columns: by name, the columns of a matrix by name and number, "gyro[0]"."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.core.tables import Array
from insenv.logs.formats.contract import FileColumns, Format


def read_columns(label: str, raw: bytes, section: str) -> FileColumns:
    """The columns of a matrix by number, of a structured array by its fields, of an archive by the names of its arrays."""
    try:
        loaded = np.load(io.BytesIO(raw), allow_pickle=False)
        arrays = {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"{label}: not a file of NumPy's save or savez without Python objects: {error}") from None
    return columns_of(label, arrays)


def columns_of(label: str, values: Mapping[str, Any]) -> FileColumns:
    """The columns of arrays by name, of mappings of such (their names joined by points), and of structured arrays.

    A vector is a column; of a matrix each column along the longer side is one, NAME[k] with k from 0.  Dates become Unix times
    (s).  Others are left out.  Raises `InputError` if none is left.
    """
    columns: dict[str | int, Array] = {}
    for name, value in values.items():
        columns |= _columns(name, value)
    if not columns:
        names = ", ".join(filter(None, values)) or "one array"
        raise InputError(f"{label}: no vectors or matrices of real numbers (it holds {names})")
    return FileColumns(columns)


def _columns(name: str, value: Any) -> dict[str | int, Array]:
    if isinstance(value, Mapping):
        parts = [_columns(f"{name}.{key}" if name else str(key), each) for key, each in value.items()]
        return {key: column for part in parts for key, column in part.items()}
    array = np.asarray(value)
    if array.dtype.names:
        return _columns(name, {key: array[key] for key in array.dtype.names})
    if array.dtype.kind == "M":
        array = array.astype("datetime64[ns]").astype(np.int64) * 1e-9
    if array.dtype.kind not in "biuf" or array.ndim not in (1, 2) or not array.size:
        return {}
    array = array.astype(np.float64)
    if 1 in array.shape or array.ndim == 1:
        return {name or 0: array.ravel()} if array.size > 1 else {}
    upright = array if array.shape[0] >= array.shape[1] else array.T
    return {f"{name}[{k}]" if name else k: column for k, column in enumerate(upright.T)}


FORMAT = Format(name="numpy", suffixes=(".npy", ".npz"), read_columns=read_columns)
