"""Attitude functions of CasADi symbols; ``attitude.numeric`` holds the same functions of NumPy arrays."""

from insenv.attitude import numeric
from insenv.attitude.rotation import (
    conjugate,
    error_rotation_vector,
    from_dcm,
    from_euler,
    from_rotation_vector,
    from_small_rotation_vector,
    multiply,
    normalize,
    renormalize,
    rotate,
    rotate_inverse,
    skew,
    split_half_angles,
    to_dcm,
    to_euler,
    to_rotation_vector,
)

__all__ = [
    "conjugate",
    "error_rotation_vector",
    "from_dcm",
    "from_euler",
    "from_rotation_vector",
    "from_small_rotation_vector",
    "multiply",
    "normalize",
    "numeric",
    "renormalize",
    "rotate",
    "rotate_inverse",
    "skew",
    "split_half_angles",
    "to_dcm",
    "to_euler",
    "to_rotation_vector",
]
