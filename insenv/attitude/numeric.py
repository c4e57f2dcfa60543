"""The functions of ``insenv.attitude`` for NumPy arrays, broadcasting over leading axes."""

from insenv.attitude import rotation
from insenv.core.numeric import vectorized

skew = vectorized(rotation.skew, 3)
multiply = vectorized(rotation.multiply, 4, 4)
conjugate = vectorized(rotation.conjugate, 4)
normalize = vectorized(rotation.normalize, 4)
to_dcm = vectorized(rotation.to_dcm, 4)
from_dcm = vectorized(rotation.from_dcm, (3, 3))
rotate = vectorized(rotation.rotate, 4, 3)
rotate_inverse = vectorized(rotation.rotate_inverse, 4, 3)
from_rotation_vector = vectorized(rotation.from_rotation_vector, 3)
from_small_rotation_vector = vectorized(rotation.from_small_rotation_vector, 3)
to_rotation_vector = vectorized(rotation.to_rotation_vector, 4)
from_euler = vectorized(rotation.from_euler, (), (), ())
to_euler = vectorized(rotation.to_euler, 4)
error_rotation_vector = vectorized(rotation.error_rotation_vector, 4, 4)
