"""Quantities that messages need beyond truth and estimate, in one symbolic function: angles, body rates, covariances.

The attitude error is a rotation vector e in n with the estimator's stated sigmas, uncorrelated.  To first order it
changes

    roll    by (cos psi e_N + sin psi e_E) / cos theta
    pitch   by cos psi e_E - sin psi e_N
    heading by e_D + tan theta (cos psi e_N + sin psi e_E)

where psi is the heading and theta the pitch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.core.elementary import wrap_angle
from insenv.core.tables import Row, Table, Vector

_POSE = (
    ("q_nb", "1", (4,), (1.0, 0.0, 0.0, 0.0)),
    ("velocity_n", "m/s", (3,), 0.0),
    ("latitude", "rad", (), 0.0),
    ("longitude", "rad", (), 0.0),
    ("height", "m", (), 0.0),
)
INPUTS = Table((
    *(Row(name, f"True {name}", unit, shape, start=start) for name, unit, shape, start in _POSE),
    *(Row(f"estimated_{name}", f"Estimated {name}", unit, shape, start=start) for name, unit, shape, start in _POSE),
    Row("rate_ib_b", "True rate of b relative to i", "rad/s", (3,), "b"),
    Row("measured_rate_ib_b", "Measured rate of b relative to i, minus the estimated bias", "rad/s", (3,), "b"),
    Row("home", "Latitude and longitude (rad) and height (m) of home", "SI", (3,)),
    Row("position_sigma", "Stated by the estimator; NaN if it states none", "m", (3,), "n"),
    Row("velocity_sigma", "Stated by the estimator; NaN if it states none", "m/s", (3,), "n"),
    Row("attitude_sigma", "Stated by the estimator; NaN if it states none", "rad", (3,), "n"),
    Row("rate_sigma", "Sigma of the measured rate", "rad/s", (), "b"),
))  # fmt: skip
TRIANGLE = 21
OUTPUTS = Table((
    Row("euler", "Estimated roll, pitch and heading (-pi to pi)", "rad", (3,)),
    Row("rate_nb_b", "Estimated rate of b relative to n", "rad/s", (3,), "b"),
    Row("velocity_b", "Estimated velocity over the Earth", "m/s", (3,), "b"),
    Row("offset", "Estimated position relative to home, along the NED axes at home", "m", (3,)),
    Row("estimated_longitude_wrapped", "Estimated longitude, -pi to pi", "rad"),
    Row("true_rate_nb_b", "True rate of b relative to n", "rad/s", (3,), "b"),
    Row("true_longitude_wrapped", "True longitude, -pi to pi", "rad"),
    Row("true_offset", "True position relative to home, along the NED axes at home", "m", (3,)),
    Row("pose_covariance", "Upper triangle by rows: position in n (m), roll, pitch, heading (rad)", "SI", (TRIANGLE,)),
    Row("velocity_covariance", "Upper triangle by rows: velocity in b (m/s), rates (rad/s)", "SI", (TRIANGLE,)),
))  # fmt: skip


class Derived:
    """The quantities of `OUTPUTS`, computed on fixed arrays without conversion or allocation.

    inputs, outputs: by row name, views of the arrays that each `evaluate` reads and writes.
    """

    def __init__(self) -> None:
        self._u, self._y = INPUTS.start_vector(), np.zeros(OUTPUTS.size)
        self.inputs, self.outputs = INPUTS.unpack(self._u), OUTPUTS.unpack(self._y)
        buffer: Any  # CasADi's stub knows no memoryview of an array
        buffer, self.evaluate = _function().buffer()
        self._buffer = buffer  # must live as long as `evaluate`
        buffer.set_arg(0, self._u.data)
        buffer.set_res(0, self._y.data)

    evaluate: Callable[[], None]


@lru_cache(maxsize=1)
def _function() -> Any:
    flat = ca.SX.sym("u", INPUTS.size)
    u = INPUTS.symbols(flat)
    longitude = wrap_angle(u.estimated_longitude)
    place, true_place = (u.estimated_latitude, longitude, u.estimated_height), (u.latitude, u.longitude, u.height)
    home = u.home[0], u.home[1], u.home[2]
    roll, pitch, heading = attitude.to_euler(u.estimated_q_nb)
    values = {
        "euler": ca.vertcat(roll, pitch, heading),
        "rate_nb_b": u.measured_rate_ib_b - _rate_in_b(u.estimated_q_nb, u.estimated_velocity_n, place),
        "velocity_b": attitude.rotate_inverse(u.estimated_q_nb, u.estimated_velocity_n),
        "offset": geodesy.ned_offset(*place, *home),
        "estimated_longitude_wrapped": longitude,
        "true_rate_nb_b": u.rate_ib_b - _rate_in_b(u.q_nb, u.velocity_n, true_place),
        "true_longitude_wrapped": wrap_angle(u.longitude),
        "true_offset": geodesy.ned_offset(*true_place, *home),
        "pose_covariance": _pose_covariance(u, pitch, heading),
        "velocity_covariance": _velocity_covariance(u),
    }
    return ca.Function("derived", [flat], [ca.densify(OUTPUTS.assemble(values))], {"cse": True})


def _rate_in_b(q_nb: Any, velocity_n: Any, place: Sequence[Any]) -> Any:
    """omega_in^b: Earth rate plus transport rate, in b."""
    latitude, _, height = place
    rate_n = geodesy.earth_rate_n(latitude) + geodesy.transport_rate_n(velocity_n, latitude, height)
    return attitude.rotate_inverse(q_nb, rate_n)


def _pose_covariance(u: Any, pitch: Any, heading: Any) -> Any:
    s, c = ca.sin(heading), ca.cos(heading)
    across, tangent = 1.0 / ca.cos(pitch), ca.tan(pitch)
    moved = ca.vertcat(
        ca.horzcat(c * across, s * across, 0.0), ca.horzcat(-s, c, 0.0), ca.horzcat(c * tangent, s * tangent, 1.0)
    )
    angles = moved @ ca.diag(u.attitude_sigma**2) @ moved.T
    return _triangle(ca.diagcat(ca.diag(u.position_sigma**2), angles))


def _velocity_covariance(u: Any) -> Any:
    C_bn = attitude.to_dcm(u.estimated_q_nb).T
    velocity = C_bn @ ca.diag(u.velocity_sigma**2) @ C_bn.T
    return _triangle(ca.diagcat(velocity, ca.SX.eye(3) * u.rate_sigma**2))


def _triangle(matrix: Any) -> Any:
    full = ca.densify(matrix)
    return ca.vertcat(*[full[i, j] for i in range(6) for j in range(i, 6)])


def no_vector() -> Vector:
    """Three unknown numbers (NaN)."""
    return np.full(3, np.nan)
