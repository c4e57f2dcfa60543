"""`q-method`: alignment of a vehicle that stays in place, at any attitude and on any sway, as Wahba's problem in the
inertial frame.

The constant quaternion Q minimises the integral of |beta - C(Q) alpha|^2 over the vectors of
`insenv.estimators.inertial_vectors`: it is the eigenvector of the largest eigenvalue of Davenport's 4x4 matrix, which is formed
from the running integral of beta alpha^T.  No start attitude, no singular one, nothing random.  Source: the quaternion
adaptive-Kalman paper, section 2.1; Davenport's matrix: Markley and Crassidis (2014), section 5.3.
"""

from __future__ import annotations

from typing import Any

from insenv.core.model import Model, Step
from insenv.estimators import inertial_vectors
from insenv.estimators.eigen import largest_eigenvector
from insenv.estimators.increments import SAMPLE_INPUTS
from insenv.estimators.inertial_vectors import davenport
from insenv.estimators.registry import Estimator


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    rows = inertial_vectors.vectors(p, x, u)
    return {**rows, **inertial_vectors.profiles(p, x, *inertial_vectors.latest(rows), u.dt)}


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude now."""
    q_start = largest_eigenvector(davenport(x.early_profile + x.late_profile))
    return {
        "q_nb": inertial_vectors.attitude_now(x, q_start),
        "attitude_sigma": inertial_vectors.stated_sigma(p, x),
    }


MODEL = Model(
    id="q-method",
    title="alignment in place by many vectors in the inertial frame (Wahba's problem)",
    parameters=inertial_vectors.PARAMETERS,
    state=inertial_vectors.STATE + inertial_vectors.PROFILE_STATE,
    inputs=SAMPLE_INPUTS,
    outputs=inertial_vectors.OUTPUTS,
    steps={"sample": Step(sample)},
    output=output,
    start=inertial_vectors.start,
)

ESTIMATOR = Estimator(MODEL, kind="alignment", aided=False, prepare=inertial_vectors.prepare)
