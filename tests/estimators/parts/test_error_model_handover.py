"""The covariance that an alignment hands over."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from insenv import geodesy
from insenv.estimators.parts.error_model import aligned


def test_the_hand_over_carries_what_biases_do():
    """The balance of specific force and Earth rate in place, against differences of the rates at a misalignment."""
    latitude, g, gyro, accel = 0.8, 9.81, 3e-8, 5e-4
    noise = np.array([1e-5, 2e-5, 3e-4])
    level, heading = accel / g, np.hypot(gyro / (geodesy.OMEGA_IE * np.cos(latitude)), accel / g * np.tan(latitude))
    sigma = np.sqrt(noise**2 + np.array([level, level, heading]) ** 2)
    found = aligned(ca.DM(sigma), latitude, g, gyro, accel)
    P, by_accel, by_gyro = (np.array(ca.evalf(part)) for part in dataclasses.astuple(found))
    assert np.diag(P) == pytest.approx(sigma**2, rel=1e-9)
    f, omega = np.array([0, 0, -g]), geodesy.OMEGA_IE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
    for axis in range(3):
        phi = by_accel[:, axis] / accel  # the misalignment that this bias causes
        assert (np.cross(f, phi) + np.eye(3)[axis] * accel)[:2] == pytest.approx(0, abs=1e-12)
        assert np.cross(omega, phi)[1] == pytest.approx(0, abs=1e-15)
        phi = by_gyro[:, axis] / gyro
        assert (np.cross(omega, phi) + np.eye(3)[axis] * gyro)[1] == pytest.approx(0, abs=1e-15)
