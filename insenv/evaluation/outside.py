"""An estimate that comes from outside insenv: what may be in it, and its checks.

A wrong one is refused in one sentence, so that no error is computed from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.base.errors import InputError, nearest

Array = NDArray[np.float64]

SHAPES: Mapping[str, tuple[int, ...]] = {
    "q_nb": (4,),
    "velocity_n": (3,),
    "latitude": (),
    "longitude": (),
    "height": (),
    "attitude_sigma": (3,),
    "velocity_sigma": (3,),
    "position_sigma": (3,),
}
"""Rows of an estimate and their shapes, as estimators have them as outputs: rad, m/s, m; sigma of the attitude about n."""
_LIMITS = {"latitude": np.pi / 2, "longitude": 2 * np.pi, "height": 1e7, "velocity_n": 1e5}
_POSITION = ("latitude", "longitude", "height")
NORM = 0.01
"""Largest difference of the norm of a quaternion from 1: beyond it something else was sent."""
ROUNDING = 1e-12
"""A norm that differs from 1 by less is left as it is: so are the bits of a quaternion that was normalised."""
ORTHONORMAL = 1e-3
"""Largest element of C^T C - I of a matrix."""


def checked_estimate(given: Any) -> dict[str, Array]:
    """An estimate by row name.  Raises `InputError` that names the row, its value and what is allowed.

    given: q_nb (4, scalar first), C_nb (3, 3), a ``scipy.spatial.transform.Rotation`` from b to n, or a dict of `SHAPES` in
    which ``C_nb`` may stand for ``q_nb``.
    """
    values = dict(given) if isinstance(given, Mapping) else {"q_nb": given}
    if "C_nb" in values:
        values["q_nb"] = values.pop("C_nb")
    for name in values:
        if name not in SHAPES:
            raise InputError(f"{name!r}: unknown row of an estimate{nearest(str(name), SHAPES)}")
    some = [name for name in _POSITION if name in values]
    if some and len(some) < len(_POSITION):
        raise InputError(
            f"{', '.join(some)} without {', '.join(n for n in _POSITION if n not in some)}: a position has all three"
        )
    found = {name: _quaternion(value) if name == "q_nb" else _row(name, value) for name, value in values.items()}
    if not found:
        raise InputError("the estimate is empty: allowed is an attitude, or a dict with it")
    return found


def _row(name: str, value: Any) -> Array:
    row = _numbers(name, value, SHAPES[name])
    if name in _LIMITS and np.any(np.abs(row) > _LIMITS[name]):
        raise InputError(f"{name} = {row.tolist()}: allowed is up to {_LIMITS[name]:.6g} in size (rad, m, m/s)")
    if name.endswith("_sigma") and np.any(row < 0.0):
        raise InputError(f"{name} = {row.tolist()}: a standard deviation is not negative")
    return row


def _numbers(name: str, value: Any, *shapes: tuple[int, ...]) -> Array:
    """An array of one of the shapes, finite."""
    try:
        row = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        row = None
    if row is None or row.shape not in shapes:
        what = f"shape {row.shape}" if row is not None else f"type {type(value).__name__}"
        raise InputError(f"{name} has {what}: allowed is {' or '.join(str(shape) for shape in shapes)}")
    if not np.isfinite(row).all():
        raise InputError(f"{name} = {row.tolist()}: allowed are finite numbers")
    return row


def _quaternion(value: Any) -> Array:
    """Unit quaternion q_nb (4,)."""
    if hasattr(value, "as_matrix"):  # scipy's Rotation, whose quaternions are scalar last
        value = value.as_matrix()
    row = _numbers("q_nb", value, (4,), (3, 3))
    if row.shape == (3, 3):
        if np.max(np.abs(row.T @ row - np.eye(3))) > ORTHONORMAL or np.linalg.det(row) < 0.0:
            raise InputError(f"C_nb = {row.round(6).tolist()}: allowed is a rotation matrix, right-handed and orthonormal")
        return np.asarray(attitude.numeric.from_dcm(row))
    norm = float(np.linalg.norm(row))
    if abs(norm - 1.0) > NORM:
        raise InputError(f"q_nb = {row.tolist()} has the norm {norm:.6g}: allowed is 1 within {NORM:g}")
    return row if abs(norm - 1.0) < ROUNDING else row / norm
