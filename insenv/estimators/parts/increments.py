"""Rotation and velocity change of an inertial sample: coning, sculling and rotation compensation.

Rate and specific force of the body are taken as linear in time over the present sample and the one before; the results
are of third order in the sample interval.

Sources: Savage, "Strapdown inertial navigation integration algorithm design", J. Guidance 21 (1998), part 1 for coning,
part 2 for sculling and rotation compensation; the last product of rotation compensation is the second-order term of a
constant rotation.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.elementary import select
from insenv.core.tables import Row, Table

MEMORY = Table((
    Row("previous_delta_angle", "Bias-corrected delta angle of the previous sample", "rad", (3,), "b"),
    Row("previous_delta_velocity", "Bias-corrected delta velocity of the previous sample", "m/s", (3,), "b"),
    Row("samples", "Number of samples so far", "1"),
))  # fmt: skip
"""State rows: the previous sample."""


def compensated(x: Any, delta_angle: Any, delta_velocity: Any) -> tuple[Any, Any]:
    """Rotation vector of the sample and its velocity change in the body axes at its start (3, rad; 3, m/s; b).

    x: rows of `MEMORY`. delta_angle, delta_velocity: increments with known errors subtracted.
    """
    # the first sample has no predecessor, so the second counts twice: by the same linear fit to the two samples, coning
    # and sculling of the first equal those of the second
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
