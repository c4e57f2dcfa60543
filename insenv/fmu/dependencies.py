"""What the outputs at the start depend on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from insenv.core.model import Model


def start_dependencies(model: Model) -> NDArray[np.bool_]:
    """(outputs.size, parameters.size): whether an output of the start state depends on a parameter.

    From the equations' own sparsity; what takes random numbers depends on the seed.
    """
    import casadi as ca

    p = ca.SX.sym("p", model.parameters.size)
    r = ca.SX.sym("r", model.start_uniforms)
    y = model.kernels["output"].function(p, model.kernels["start"].function(p, r))
    found = np.zeros((model.outputs.size, model.parameters.size), dtype=bool)
    if found.size:
        rows, columns = ca.jacobian_sparsity(y, p).get_triplet()
        found[rows, columns] = True
    if model.start_uniforms:
        rows, _ = ca.jacobian_sparsity(y, r).get_triplet()
        found[rows, model.parameters.slice("seed").start] = True
    return found
