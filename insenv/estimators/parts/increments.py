"""From a sample's increments to its rotation and its velocity change: coning, sculling and rotation compensation.

The body's rate and specific force are taken as linear in time over the present sample and the one before; the results are
then of third order in the sample interval.

Sources: Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21 (1998), part 1 for coning,
part 2 for sculling and rotation compensation; the last product of rotation compensation is the second-order term of a
constant rotation.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.tables import Row, Table

SAMPLE_INPUTS = Table((
    Row("delta_angle", "Integral of the measured angular rate over the sample", "rad", (3,), "b", lower=-1e3, upper=1e3),
    Row("delta_velocity", "Integral of the measured specific force over the sample", "m/s", (3,), "b", lower=-1e5, upper=1e5),
    Row("dt", "Sample interval", "s", start=0.005, lower=1e-6, upper=10.0),
))  # fmt: skip
"""What every estimator takes with each inertial sample."""

MEMORY = Table((
    Row("previous_delta_angle", "Compensated delta angle of the sample before", "rad", (3,), "b"),
    Row("previous_delta_velocity", "Compensated delta velocity of the sample before", "m/s", (3,), "b"),
    Row("samples", "Number of samples taken", "1"),
))  # fmt: skip
"""What is remembered of the sample before."""


def compensated(x: Any, delta_angle: Any, delta_velocity: Any) -> tuple[Any, Any]:
    """Rotation vector of the sample and its velocity change in the body axes at its start (3, rad; 3, m/s; b).

    x: rows of `MEMORY`.  delta_angle, delta_velocity: increments with known errors taken off.
    """
    # The first sample has no predecessor; the second makes up for it: by the same fit of linear rates to the two samples, the
    # coning and sculling of the first equal its own.
    weight = select(x.samples == 1, 2 / 12, 1 / 12)
    before_angle, before_velocity = x.previous_delta_angle, x.previous_delta_velocity
    rotation = delta_angle + weight * ca.cross(before_angle, delta_angle)
    turned = ca.cross(delta_angle, delta_velocity)
    sculling = ca.cross(before_angle, delta_velocity) + ca.cross(before_velocity, delta_angle)
    return rotation, delta_velocity + 0.5 * turned + (1 / 6) * ca.cross(delta_angle, turned) + weight * sculling


def remembered(x: Any, delta_angle: Any, delta_velocity: Any) -> dict[str, Any]:
    """Rows of `MEMORY` after the sample."""
    return {
        "previous_delta_angle": delta_angle,
        "previous_delta_velocity": delta_velocity,
        "samples": x.samples + 1,
    }
