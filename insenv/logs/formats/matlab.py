"""Variables of MATLAB (.mat, up to version 7) as columns, by scipy.io: structures by their fields, "imu.gyro[0]".

Files of version 7.3 are HDF5, and objects such as tables are stored in a form that is not published: they are refused.  The
elements of a file are checked before scipy.io reads them: a wrong type code makes it read beyond its tables and die.

MathWorks, MAT-File Format, chapter 1: Level 5.
"""

from __future__ import annotations

import io
import math
import struct
import zlib

from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from insenv.base.errors import InputError
from insenv.logs.formats.contract import FileColumns, Format
from insenv.logs.formats.numpy_arrays import columns_of


def read_columns(label: str, raw: bytes, section: str) -> FileColumns:
    """The columns of all variables that are numbers, vectors along the rows or columns, matrices and structures of these."""
    try:
        if raw[124:128] in _VERSION_5:
            _check(memoryview(raw)[_HEADER:], _VERSION_5[raw[124:128]])
        variables = loadmat(io.BytesIO(raw), simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{label}: a MATLAB file of version 7.3: allowed is one of version 7, save(..., '-v7') writes it"
        ) from None
    except (
        MatReadError,
        ValueError,
        TypeError,
        KeyError,
        IndexError,
        AttributeError,
        OSError,
        MemoryError,
        zlib.error,
        struct.error,
    ) as error:
        raise InputError(f"{label}: not a MATLAB file, or a damaged one: {error}") from None
    return columns_of(label, {name: value for name, value in variables.items() if not name.startswith("__")})


_HEADER = 128
_VERSION_5 = {b"\x00\x01IM": "<", b"\x01\x00MI": ">"}
"""Order of the bytes by the end of the header; versions 4 and 7.3 have others."""
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13))
_TEXT = frozenset((16, 17, 18))
"""Type codes of elements that hold numbers, and text in UTF."""
_OUTER = frozenset((_MATRIX, _COMPRESSED))
_FLAGS, _DIMENSIONS = 6, 5
_PARTS = {1: _NUMBERS | {_MATRIX}, 2: _NUMBERS | {_MATRIX}, 3: _NUMBERS | {_MATRIX}, 4: _NUMBERS | _TEXT}
_PARTS |= dict.fromkeys(range(6, 16), _NUMBERS) | dict.fromkeys((16, 17), _NUMBERS | _TEXT | {_MATRIX})
"""Types of the parts of a matrix by its class: cells, structures, objects, text; numbers; functions, opaque ones."""
_SPARSE, _OPAQUE = 5, 17
_COMPLEX = 0x800
"""Flag of a matrix with an imaginary part."""


def _check(data: memoryview, order: str, allowed: frozenset[int] = _OUTER) -> int:
    """The number of elements.  Raises `ValueError` for one of another type, or longer than what it is in, or a wrong matrix."""
    place, count = 0, 0
    while place + 8 <= len(data):
        first, size = struct.unpack_from(f"{order}II", data, place)
        small = first >> 16
        kind, size, begin = (first & 0xFFFF, small, place + 4) if small else (first, size, place + 8)
        if kind not in allowed or size > len(data) - begin or small > 4:
            raise ValueError(f"an element of type {kind} with {size} bytes is not one of the format there")
        inner = data[begin : begin + size]
        if kind == _COMPRESSED:
            _check(memoryview(zlib.decompress(inner)), order)
        elif kind == _MATRIX and size:
            _check_matrix(inner, order)
        place, count = place + 8 if small else begin + size + (0 if kind == _COMPRESSED else -size % 8), count + 1
    return count


def _check_matrix(matrix: memoryview, order: str) -> None:
    """Raise `ValueError` for a matrix that does not begin with flags and dimensions, or does not hold what they say."""
    if len(matrix) < 24:
        raise ValueError("a matrix without dimensions")
    kind, _, flags, _, dimensions, size = struct.unpack_from(f"{order}6I", matrix)
    form = flags & 0xFF
    if form == _SPARSE:
        raise ValueError("it holds a sparse matrix")
    if kind != _FLAGS or form not in _PARTS or (form != _OPAQUE and (dimensions != _DIMENSIONS or size % 4)):
        raise ValueError(f"a matrix of class {form} is not one of the format")
    parts = _check(matrix, order, _PARTS[form])
    if form in range(6, 16):
        sides = struct.unpack_from(f"{order}{size // 4}i", matrix, 24) if 24 + size <= len(matrix) else (-1,)
        if min(sides, default=-1) < 0 or math.prod(sides) > len(matrix) or parts < (5 if flags & _COMPLEX else 4):
            raise ValueError(f"a matrix of {sides} numbers in {len(matrix)} bytes")


FORMAT = Format(name="matlab", suffixes=(".mat",), read_columns=read_columns)
