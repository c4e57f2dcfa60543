"""The end of a lever arm some time ago on a vehicle whose rate changes."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insenv.estimators.parts import lever_arm


def _functions():
    rate, change, arm, age, dt = (ca.SX.sym(name, size) for name, size in
                                  (("w", 3), ("c", 3), ("l", 3), ("age", 1), ("dt", 1)))  # fmt: skip
    x, first = ca.SX.sym("x", lever_arm.MEMORY.size), ca.SX.sym("first")
    rows = lever_arm.MEMORY.symbols(x)
    followed = lever_arm.followed(rows, rate, dt, first)["mean_rate"]
    return {
        "then": ca.Function("then", [rate, change, arm, age], list(lever_arm.then(rate, change, arm, age))),
        "followed": ca.Function("followed", [x, rate, dt, first], [followed]),
        "acceleration": ca.Function("acceleration", [x, rate, dt], [lever_arm.angular_acceleration(rows, rate, dt)]),
    }


FUNCTIONS = _functions()


def call(name, *arguments):
    found = FUNCTIONS[name](*arguments)
    return [np.squeeze(r.full()) for r in found] if isinstance(found, (list, tuple)) else np.squeeze(found.full())


def test_the_arm_some_time_ago_against_rotations():
    """Remaining errors are of third (arm) and second order (swing) in the age."""
    rng = np.random.default_rng(2)
    rate, change, arm = rng.normal(size=3) * 0.3, rng.normal(size=3) * 0.5, rng.normal(size=3) * 5

    def turned(t):  # from the present body axes to those t later
        return Rotation.from_rotvec(rate * t + change * t * t / 2).apply(arm)

    errors = []
    for age in (0.04, 0.02):
        arm_then, swing = call("then", rate, change, arm, age)
        h = 1e-5
        errors.append(
            (np.abs(arm_then - turned(-age)).max(), np.abs(swing - (turned(h - age) - turned(-h - age)) / (2 * h)).max())
        )
    assert errors[0][0] / errors[1][0] == pytest.approx(8, rel=0.1) and errors[1][0] < 1e-5
    assert errors[0][1] / errors[1][1] == pytest.approx(4, rel=0.1) and errors[1][1] < 1e-3


def test_the_rate_of_the_fix_on_a_ramp_and_on_a_sway():
    """w - age w' is the rate at the time of the fix: exact on a ramp, within 1 % of the change on a sway of 8 s."""
    dt, age = 0.005, 0.2
    for rate, bound in ((lambda t: 0.3 + 0.2 * t, 1e-9), (lambda t: 0.137 * np.sin(2 * np.pi * t / 8), 1e-3)):
        x = np.r_[0, 0, 0, age / 2]
        for k in range(1, 1601):
            now = np.array([rate((k - 0.5) * dt), 0, 0])  # the mean over a sample
            x[:3] = call("followed", x, now, dt, float(k == 1))
        change = call("acceleration", x, now, dt)[0]
        end = now[0] + change * dt / 2
        assert abs(end - age * change - rate(k * dt - age)) < bound
    # a lag is never shorter than four samples
    assert np.allclose(call("acceleration", np.zeros(4), np.ones(3), dt), 1 / (lever_arm.SHORTEST * dt))
