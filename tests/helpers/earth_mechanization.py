"""A nonlinear strapdown mechanization in Earth axes in plain NumPy, for many units at once, to check limits against."""

from __future__ import annotations

import numpy as np

from insenv import geodesy

OMEGA = np.array([0.0, 0.0, 7.292115e-5])


def rotation(vector):
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape, 3)
    safe = np.where(angle > 1e-12, angle, 1.0)
    return np.eye(3) + np.sinc(angle / np.pi) * K + (1 - np.cos(safe)) / safe**2 * (K @ K) * (angle > 1e-12)


def gravity(r):
    """Gravity (..., 3) in e at positions r (..., 3): normal gravity along the ellipsoid's normal."""
    latitude, longitude, height = geodesy.numeric.ecef_to_geodetic(r)
    up = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)], axis=-1)
    return -up * np.asarray(geodesy.numeric.normal_gravity(np.sin(latitude), height))[..., None]


def navigate(C, v, r, angles, velocities, dt):
    """Attitude C_eb (k, 3, 3), velocity and position (k, 3) in e after the increments (samples, k or 1, 3)."""
    for angle, velocity in zip(angles, velocities, strict=True):
        half = C @ rotation(0.5 * angle)
        g = gravity(r)
        turned = rotation(-OMEGA * dt) @ C @ rotation(angle)
        thrust = (half @ velocity[..., None])[..., 0]
        new = v + thrust + (g - 2 * np.cross(OMEGA, v)) * dt
        r = r + 0.5 * (v + new) * dt
        C, v = turned, new
    return C, v, r
