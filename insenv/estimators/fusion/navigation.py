"""The navigation state as an aid sees it, less a small error: the one function through which all sensitivities are derived.

Errors are those of `insenv.estimators.parts.error_model`: estimate minus truth for position and velocity (w), psi for the
attitude, and truth minus estimate for everything that a state estimates (a bias, a scale factor, a lever arm).  With an
error e taken out,

    C_wb = (I + [psi x]) C^_wb,   v = v^ - dv,   r = r^ - dr,   value = value^ + its error

to first order.  An aid's sensitivity is then H = -d residual / d e at e = 0 (`insenv.estimators.fusion.navigation`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.core.model import Values
from insenv.estimators.fusion import history
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY
from insenv.geodesy import NOMINAL_GRAVITY


def corrected_increments(states: Sequence[ErrorState], values: Mapping[str, Any], u: Any) -> tuple[Any, Any]:
    """The increments of a sample (rad, m/s, b) without the errors in `values` (by name of the state).

    The states take their errors out one after the other, in the order in which they are given.
    """
    delta_angle, delta_velocity = u.delta_angle, u.delta_velocity
    for state in states:
        if state.increments is not None:
            delta_angle, delta_velocity = state.increments(values[state.name], delta_angle, delta_velocity, u.dt)
    return delta_angle, delta_velocity


class Navigation:
    """A navigation state after a sample, less the error `error` (n).

    x, u: state and inputs by name.  places: the slice of each error state in `error`, by name.  turn: C (3x3) by which the
    platform is turned before, a part of `error` that is too large for a first order; None: none.
    """

    def __init__(
        self, x: Any, u: Any, states: Sequence[ErrorState], places: Mapping[str, slice], error: Any, turn: Any = None
    ) -> None:
        self._x, self._u, self._states, self._turn = x, u, states, turn
        self._values = {state.name: getattr(x, state.name) + error[places[state.name]] for state in states}
        self._psi, self._dv = error[TILT], error[VELOCITY]
        estimated = self._turned(attitude.to_dcm(x.q_wb))
        self.C_wb = estimated + skew(self._psi) @ estimated
        self.C_nw = strapdown.C_nw(x.q_ew)
        self.velocity_w: Any = x.velocity_w - self._dv
        self.offset_w = -error[POSITION]
        """Position relative to the estimated one, m."""
        self.estimated_height = x.height
        self.climbed = -x.way_w[2]
        """Height gained since the start as the velocities give it, m: no correction of the height is in it."""
        _, delta_velocity = corrected_increments(states, self._values, u)
        _, used_velocity = corrected_increments(states, {s.name: getattr(x, s.name) for s in states}, u)
        self._force_error_w = estimated @ ((delta_velocity - used_velocity) / u.dt)
        self.specific_force_b = delta_velocity / u.dt
        """Specific force of the last sample, m/s^2."""

    def value(self, name: str, otherwise: Any = None) -> Any:
        """The value of an error state; `otherwise`, if the filter does not estimate it."""
        return self._values.get(name, otherwise)

    def row(self, name: str) -> Any:
        """A state row of the filter that is no error."""
        return getattr(self._x, name)

    def estimates(self, name: str) -> bool:
        """Whether the filter estimates it."""
        return name in self._values

    def offset_n(self, latitude: Any, longitude: Any, height: Any) -> Any:
        """A place (rad, rad, m) relative to the estimated position (3, m, n); down is the difference of the heights."""
        here_latitude, here_longitude, _ = geodesy.geodetic_from_q_ew(self._x.q_ew)
        return geodesy.position_error(latitude, longitude, height, here_latitude, here_longitude, self._x.height)

    def point(self, arm_b: Any, age: Any) -> tuple[Any, Any]:
        """A point of the body `age` seconds ago: position relative to the estimated one (3, m, w) and velocity (3, m/s, w).

        arm_b: from the inertial unit to the point (3, m, b).
        """
        then = self._then(age)
        arm_w = then.C_wb @ arm_b
        return then.offset_w + arm_w, then.velocity_w + then.C_wb @ ca.cross(then.rate_b, arm_b)

    def body_velocity(self, arm_b: Any, age: Any) -> Any:
        """Velocity over the Earth of a point of the body `age` seconds ago (3, m/s, b then)."""
        _, velocity_w = self.point(arm_b, age)
        return self.axes(age).T @ velocity_w

    def axes(self, age: Any) -> Any:
        """C_wb (3x3) `age` seconds ago."""
        return self.C_wb if ca.SX(age).is_zero() else self._then(age).C_wb

    def _turned(self, C_wb: Any) -> Any:
        return C_wb if self._turn is None else self._turn @ C_wb

    def _then(self, age: Any) -> _Then:
        """The motion of the inertial unit `age` seconds ago, less the error, which is nearly that of now."""
        past = history.past(self._x, self._u, age)
        turned = skew(self._psi)
        # of the specific force since then the error is that of the attitude and that of the accelerometers
        gained = self._x.velocity_w - past.velocity_w + ca.vertcat(0, 0, -NOMINAL_GRAVITY) * age
        lost = turned @ gained + self._force_error_w * age
        way = past.way_w - self._dv * age - lost * (age / 2)
        C_wb = self._turned(past.C_wb)
        C_wb = C_wb + turned @ C_wb
        sample = Values(delta_angle=past.rate_b * self._u.dt, delta_velocity=self._u.delta_velocity, dt=self._u.dt)
        rate_b = corrected_increments(self._states, self._values, sample)[0] / self._u.dt
        earth_rate = geodesy.earth_rate_w(self._x.q_ew)
        return _Then(
            offset_w=self.offset_w - way,
            velocity_w=past.velocity_w - self._dv - lost,
            C_wb=C_wb,
            rate_b=rate_b - C_wb.T @ earth_rate,
        )


@dataclass(frozen=True)
class _Then:
    offset_w: Any
    velocity_w: Any
    C_wb: Any
    rate_b: Any


# Derivatives with respect to a small error, and an error taken out of the state of a filter.


def linear(function: Callable[[Any], Any], n: int) -> tuple[Any, Any]:
    """Value (m) and derivative (m x n, sparse) of a function of n numbers at 0."""
    error = ca.SX.sym("error", n)
    value = function(error)
    at_zero = ca.substitute([value, ca.jacobian(value, error)], [error], [ca.SX.zeros(n)])
    return at_zero[0], ca.sparsify(at_zero[1])


def corrected(x: Any, correction: Any, states: Sequence[ErrorState], places: Mapping[str, slice]) -> dict[str, Any]:
    """State rows with an estimated error (n) taken out, those of the kept motion too."""
    return {
        **navigation_corrected(x, correction, states, places),
        **history.corrected(x, correction[VELOCITY], correction[TILT]),
    }


def without(x: Any, error: Any) -> dict[str, Any]:
    """State rows with an error (9) taken out, those of the kept motion too; the covariance stays as it is.

    error: estimate minus truth in n: rotation vector (rad), velocity (m/s), position (m).
    """
    q_nw = strapdown.wander_quaternion(x.q_ew)
    turn_w, velocity_w, offset_w = (attitude.rotate_inverse(q_nw, part) for part in ca.vertsplit(error, 3))
    _, placed = strapdown.moved_back(x, offset_w)
    q_nb = attitude.multiply(attitude.from_rotation_vector(-error[:3]), attitude.multiply(q_nw, x.q_wb))
    q_nw_there = strapdown.wander_quaternion(placed["q_ew"])
    return {
        "q_wb": attitude.normalize(attitude.multiply(attitude.conjugate(q_nw_there), q_nb)),
        "velocity_w": attitude.rotate_inverse(q_nw_there, attitude.rotate(q_nw, x.velocity_w) - error[3:6]),
        **placed,
        **history.corrected(x, velocity_w, -turn_w),
    }


def navigation_corrected(x: Any, correction: Any, states: Sequence[ErrorState], places: Mapping[str, slice]) -> dict[str, Any]:
    """Rows of navigation and estimated errors with an estimated error (n) taken out."""
    return {
        **strapdown.corrected(x, correction[POSITION], correction[VELOCITY], correction[TILT]),
        **{state.name: getattr(x, state.name) + correction[places[state.name]] for state in states},
    }
