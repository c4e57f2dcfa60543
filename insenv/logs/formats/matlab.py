"""Variables of MATLAB (.mat, up to version 7) as columns, by scipy.io: structures by their fields, "imu.gyro[0]".

Files of version 7.3 are HDF5, and objects such as tables are stored in a form that is not published: they are refused.
"""

from __future__ import annotations

import io

from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from insenv.base.errors import InputError
from insenv.logs.formats.contract import FileColumns, Format
from insenv.logs.formats.numpy_arrays import columns_of


def read_columns(label: str, raw: bytes, section: str) -> FileColumns:
    """The columns of all variables that are numbers, vectors along the rows or columns, matrices and structures of these."""
    try:
        variables = loadmat(io.BytesIO(raw), simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{label}: a MATLAB file of version 7.3: allowed is one of version 7, save(..., '-v7') writes it"
        ) from None
    except (MatReadError, ValueError, TypeError, KeyError, IndexError, OSError, EOFError) as error:
        raise InputError(f"{label}: not a MATLAB file, or a damaged one: {error}") from None
    return columns_of(label, {name: value for name, value in variables.items() if not name.startswith("__")})


FORMAT = Format(name="matlab", suffixes=(".mat",), read_columns=read_columns)
