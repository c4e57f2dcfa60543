"""The navigation state as an aid sees it, less a small error: the one function through which all sensitivities are derived.

Errors are those of `insenv.estimators.parts.error_model`: estimate minus truth for position and velocity (w), psi for the
attitude, and truth minus estimate for everything that a state estimates (a bias, a scale factor, a lever arm).  With an
error e taken out,

    C_wb = (I + [psi x]) C^_wb,   v = v^ - dv,   r = r^ - dr,   value = value^ + its error

to first order.  An aid's sensitivity is then H = -d residual / d e at e = 0 (`insenv.estimators.fusion.retraction`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from insenv import attitude, geodesy
from insenv.attitude import skew
from insenv.estimators.fusion.contract import ErrorState
from insenv.estimators.parts import lever_arm, strapdown
from insenv.estimators.parts.error_model import POSITION, TILT, VELOCITY


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

    x, u: state and inputs by name.  places: the slice of each error state in `error`, by name.
    """

    def __init__(self, x: Any, u: Any, states: Sequence[ErrorState], places: Mapping[str, slice], error: Any) -> None:
        self._x = x
        self._values = {state.name: getattr(x, state.name) + error[places[state.name]] for state in states}
        psi = error[TILT]
        estimated = attitude.to_dcm(x.q_wb)
        self.C_wb = estimated + skew(psi) @ estimated
        self.C_nw = strapdown.C_nw(x.q_ew)
        self.velocity_w = x.velocity_w - error[VELOCITY]
        self.offset_w = -error[POSITION]
        """Position relative to the estimated one, m."""
        self.estimated_height = x.height
        delta_angle, delta_velocity = corrected_increments(states, self._values, u)
        estimates = {state.name: getattr(x, state.name) for state in states}
        used_angle, used_velocity = corrected_increments(states, estimates, u)
        self.specific_force_b = delta_velocity / u.dt
        """Specific force of the last sample, m/s^2."""
        # the acceleration of the last sample holds the estimated specific force: exchange it
        self.acceleration_w = x.acceleration_w + (self.C_wb @ delta_velocity - estimated @ used_velocity) / u.dt
        """Acceleration over the Earth in the last sample, m/s^2."""
        # the mean rate, with which it is compared, has the same error
        self.angular_acceleration_b = lever_arm.angular_acceleration(x, used_angle / u.dt, u.dt)
        """rad/s^2."""
        now = delta_angle / u.dt + self.angular_acceleration_b * (u.dt / 2)
        self.rate_b = now - self.C_wb.T @ geodesy.earth_rate_w(x.q_ew)
        """Angular rate relative to the Earth at the end of the sample, rad/s."""

    def value(self, name: str, otherwise: Any = None) -> Any:
        """The value of an error state; `otherwise`, if the filter does not estimate it."""
        return self._values.get(name, otherwise)

    def estimates(self, name: str) -> bool:
        """Whether the filter estimates it."""
        return name in self._values

    def offset_n(self, latitude: Any, longitude: Any, height: Any) -> Any:
        """A place (rad, rad, m) relative to the estimated position (3, m, n)."""
        own_latitude, own_longitude, _ = geodesy.geodetic_from_q_ew(self._x.q_ew)
        return geodesy.ned_offset(latitude, longitude, height, own_latitude, own_longitude, self._x.height)

    def point(self, arm_b: Any, age: Any) -> tuple[Any, Any]:
        """A point of the body `age` seconds ago: position relative to the estimated one (3, m, w) and velocity (3, m/s, w).

        arm_b: from the inertial unit to the point (3, m, b).
        """
        arm, swing = lever_arm.then(self.rate_b, self.angular_acceleration_b, arm_b, age)
        offset = self.offset_w - self.velocity_w * age + self.acceleration_w * (age**2 / 2) + self.C_wb @ arm
        return offset, self.velocity_w - self.acceleration_w * age + self.C_wb @ swing

    def body_velocity(self, arm_b: Any, age: Any) -> Any:
        """Velocity over the Earth of a point of the body `age` seconds ago (3, m/s, b then)."""
        _, velocity_w = self.point(arm_b, age)
        return self.axes(age).T @ velocity_w

    def axes(self, age: Any) -> Any:
        """C_wb (3x3) `age` seconds ago, to second order in the rotation since."""
        turn = skew(self.rate_b) * age
        return self.C_wb @ (ca.SX.eye(3) - turn + 0.5 * turn @ turn)
