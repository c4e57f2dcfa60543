"""Where the passes of a smoother begin once more: at the start that the run itself tells.

Both passes are linear about what the filter believes at the time. A car that leaves with a heading 5 deg off believes to be
0.4 % faster along its track than it is; to first order that is nothing, so both are surer of it than they can be. The cure is
to be linear about the smoothed run. A filter stays near that if it starts there, and knows it well enough not to be led away
by its first measurements.

So the next start is that of a filter which is told the smoothed attitude of its start as well, with a covariance of

    R / TOLD + (|psi|^2 / 2)^2 I

where R is the smoothed one and psi the attitude error that was found: ten standard deviations, and what the first order left
out of psi itself. What the run knows of the attitude counts `TOLD` times more, which makes its stated deviations half of
`TOLD` too small. All else stays as it was stated, as far as it does not come with the attitude. Where the second start is far
from the first the same holds of it, and there is a third: from tens of degrees off three or four passes lead to the truth.
"""

from __future__ import annotations

import numpy as np

from insenv.base.remarks import Doubt, declared
from insenv.core.tables import Array
from insenv.estimators.parts.error_model import TILT

TOLD = 0.01
COUNTS = 1 / 3
"""Standard deviations: from there on what a first order leaves out counts."""
PASSES = 8
"""At most."""
LARGEST = np.pi
"""rad: of an error of the start; a larger one is no attitude, and nothing is known then."""
NOT_REACHED = declared(
    "start-not-reached",
    "the start that the run tells is {angle:.3g} deg from the one that it was smoothed from last, and no further pass is made: "
    "the sigmas are too small; state the start better, or use fusion-smoother",
    Doubt,
)


def second_order(psi: Array) -> float:
    """What an attitude error `psi` (3, rad) leaves out to first order, rad, and of a velocity in its proportion."""
    return 0.5 * float(psi @ psi)


def astray(psi: Array, speed: Array, attitude_sigma: Array, velocity_sigma: Array) -> bool:
    """Whether an attitude error `psi` (3, rad) of the start has led a run astray by more than its standard deviations allow.

    speed (m,), m/s, and smoothed standard deviations (m, 3), rad and m/s, along the run.
    """
    left_out = second_order(psi)
    allowed = COUNTS * attitude_sigma.min(axis=1), COUNTS * velocity_sigma.min(axis=1)
    return bool(np.any(left_out > allowed[0]) or np.any(left_out * speed > allowed[1]))


def told_start(P: Array, adjoint: Array, information: Array) -> tuple[Array, Array]:
    """Error (n,) of a start, and its covariance (n, n), for a filter that is told the smoothed attitude.

    P (n, n): covariance of the start.  adjoint (n,), information (n, n): what the run tells of it, so that the smoothed
    error is P adjoint, with the covariance P - P information P (`insenv.estimators.parts.adjoint`).
    """
    psi = (P @ adjoint)[TILT]
    smoothed = (P - P @ information @ P)[TILT, TILT]
    of_told = smoothed / TOLD + second_order(psi) ** 2 * np.eye(3)
    gain = np.linalg.solve(P[TILT, TILT] + of_told, P[TILT, :]).T
    return gain @ psi, P - gain @ P[TILT, :]
