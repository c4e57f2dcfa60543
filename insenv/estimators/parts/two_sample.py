"""Two gyro samples at once: quaternion recursion of third order and velocity change of the ECEF fine-alignment paper.

The paper's quaternion is Jekeli's, the conjugate of ours: its (31) acts on conj(q_eb), and its (35) is then C_eb. The
conjugate of ``B(w) conj(q)`` is the Hamilton product ``q (0, w)``, so (30) becomes one product q r with r built from
three pure quaternions. The tests compare this form with the paper's matrices, and both with scipy.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude


def rates(first: Any, second: Any) -> tuple[Any, Any, Any]:
    """Rate times the double interval at its start, middle and end (3 each, rad), from the two samples: (32)-(34).

    The rate is taken as linear in time. first, second: delta angles relative to the target frame (3, rad, b).
    """
    return 3 * first - second, first + second, 3 * second - first


def turned(q: Any, first: Any, second: Any) -> Any:
    """q_eb (4) after two samples, of norm 1 within the recursion's error (fourth order): (30).

    first, second: delta angles relative to e (3, rad, b), with the Earth's rotation subtracted as in (28), (29).
    """
    start, middle, end = (ca.vertcat(0, w) for w in rates(first, second))
    product = attitude.multiply
    one = ca.SX([1, 0, 0, 0])
    r = (
        one
        + (end + 4 * middle + start) / 12
        + product(product(start, middle), one + end / 4) / 12
        + product(middle - start / 2, end) / 12
    )
    return product(q, r)


def velocity_change(first: Any, second: Any, first_velocity: Any, second_velocity: Any) -> Any:
    """Integral of C(t) f over the two samples in the body axes at their start (3, m/s).

    first, second: delta angles (3, rad) relative to the target frame of C; the rest: delta velocities (3, m/s,
    b). Rates and specific force are taken as linear in time. Savage, J. Guidance 21 (1998), part 2: rotation
    compensation to second order and two-sample sculling.
    """
    angle, velocity = first + second, first_velocity + second_velocity
    swept = ca.cross(angle, velocity)
    sculling = ca.cross(first, second_velocity) + ca.cross(first_velocity, second)
    return velocity + swept / 2 + ca.cross(angle, swept) / 6 + sculling * (2 / 3)
