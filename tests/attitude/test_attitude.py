"""Rotations against SciPy's Rotation, at every attitude."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insenv import attitude
from insenv.attitude import numeric

RNG = np.random.default_rng(2)
CORNERS = np.array([q for q in np.ndindex(3, 3, 3, 3) if q != (1, 1, 1, 1)], float) - 1.0  # w = 0, half turns, ...
QUATERNIONS = np.concatenate([RNG.normal(size=(2000, 4)), CORNERS, CORNERS + 1e-9 * RNG.normal(size=(80, 4))])
QUATERNIONS /= np.linalg.norm(QUATERNIONS, axis=1, keepdims=True)
VECTORS = RNG.normal(size=(len(QUATERNIONS), 3))


def scipy_of(q):
    return Rotation.from_quat(q, scalar_first=True)


def distance(q, p):
    """The difference of two rotations, whatever the signs of their quaternions."""
    return np.minimum(np.linalg.norm(q - p, axis=-1), np.linalg.norm(q + p, axis=-1)).max()


def test_matrices_rotation_and_products():
    C = scipy_of(QUATERNIONS).as_matrix()
    np.testing.assert_allclose(numeric.to_dcm(QUATERNIONS), C, atol=1e-15)
    np.testing.assert_allclose(numeric.rotate(QUATERNIONS, VECTORS), np.einsum("nij,nj->ni", C, VECTORS), atol=5e-15)
    back = numeric.rotate_inverse(QUATERNIONS, numeric.rotate(QUATERNIONS, VECTORS))
    np.testing.assert_allclose(back, VECTORS, atol=5e-15)
    q = numeric.from_dcm(C)
    assert distance(q, QUATERNIONS) < 2e-15 and (q[:, 0] >= 0).all()
    a, b = QUATERNIONS, RNG.permutation(QUATERNIONS)
    assert distance(numeric.multiply(a, b), (scipy_of(a) * scipy_of(b)).as_quat(scalar_first=True)) < 2e-15
    assert distance(numeric.multiply(a, numeric.conjugate(a)), [1, 0, 0, 0]) < 1e-15
    np.testing.assert_allclose(numeric.normalize(3.7 * a), a, atol=1e-15)
    u, v = VECTORS[:100], VECTORS[100:200]
    np.testing.assert_allclose(np.einsum("nij,nj->ni", numeric.skew(u), v), np.cross(u, v), atol=1e-15)


def test_rotation_vectors_of_any_length():
    direction = VECTORS[:500] / np.linalg.norm(VECTORS[:500], axis=1, keepdims=True)
    for length in (0.0, 1e-300, 1e-160, 1e-12, 1e-3, 0.49999, 0.50001, 1.0, np.pi, 6.0, 50.0):
        phi = length * direction
        q = numeric.from_rotation_vector(phi)
        assert distance(q, Rotation.from_rotvec(phi).as_quat(scalar_first=True)) < 1e-14
        if length <= 0.5:
            np.testing.assert_allclose(numeric.from_small_rotation_vector(phi), q, atol=1.2e-16)
        if length < 3.0:
            np.testing.assert_allclose(numeric.to_rotation_vector(q), phi, rtol=1e-15, atol=2e-15 * length)
            np.testing.assert_array_equal(numeric.to_rotation_vector(-q), numeric.to_rotation_vector(q))
    np.testing.assert_array_equal(numeric.from_rotation_vector(np.zeros(3)), [1, 0, 0, 0])
    np.testing.assert_array_equal(numeric.to_rotation_vector([1, 0, 0, 0]), np.zeros(3))
    half_turns = np.c_[np.zeros(3), np.eye(3)]
    np.testing.assert_allclose(np.abs(numeric.to_rotation_vector(half_turns)), np.pi * np.eye(3), rtol=1e-15)


def test_rotation_vectors_are_differentiable_everywhere():
    phi, q = ca.SX.sym("phi", 3), ca.SX.sym("q", 4)
    forward = ca.Function("f", [phi], [ca.jacobian(attitude.from_rotation_vector(phi), phi)])
    np.testing.assert_array_equal(forward([0, 0, 0]).full(), [[0, 0, 0], *(0.5 * np.eye(3))])
    backward = ca.Function("f", [q], [ca.jacobian(attitude.to_rotation_vector(q), q)])
    np.testing.assert_array_equal(backward([1, 0, 0, 0]).full()[:, 1:], 2 * np.eye(3))
    for length in (0.4, 0.6, 2.0):
        turn = length * np.array([0.36, 0.48, 0.8])
        chain = backward(numeric.from_rotation_vector(turn)) @ forward(turn)
        np.testing.assert_allclose(chain.full(), np.eye(3), atol=1e-14)
    assert np.isfinite(backward([0, 0.6, 0, 0.8]).full()).all()


def test_euler_angles_against_scipy_also_straight_up_and_down():
    roll, pitch, heading = RNG.uniform([[-np.pi], [-1.5], [-np.pi]], [[np.pi], [1.5], [np.pi]], (3, 2000))
    q = numeric.from_euler(roll, pitch, heading)
    oracle = Rotation.from_euler("ZYX", np.c_[heading, pitch, roll])
    assert distance(q, oracle.as_quat(scalar_first=True)) < 1e-15
    np.testing.assert_allclose(numeric.to_euler(q), [roll, pitch, heading], atol=2e-14)
    np.testing.assert_allclose(numeric.to_euler(-q), [roll, pitch, heading], atol=2e-14)
    for side in (1.0, -1.0):
        found = numeric.to_euler(numeric.from_euler(roll, side * np.pi / 2, heading))
        np.testing.assert_array_equal(found[0], 0.0)
        np.testing.assert_allclose(found[1], side * np.pi / 2, atol=1e-15)
        np.testing.assert_allclose(np.sin((found[2] - heading + side * roll) / 2), 0.0, atol=2e-15)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_euler_angles_near_the_vertical_and_on_the_axes(gap, side):
    """Within 1.4e-14 rad of it roll is set to 0, with an attitude error of up to that size."""
    roll, heading = np.meshgrid(np.linspace(-np.pi, np.pi, 17), np.linspace(-np.pi, np.pi, 17))
    pitch = np.full_like(roll, side * (np.pi / 2 - gap))
    q = numeric.from_euler(roll, pitch, heading)
    euler = np.array(numeric.to_euler(q))
    assert np.abs(euler).max() <= np.nextafter(np.pi, 4) and np.abs(euler[1]).max() <= np.pi / 2
    np.testing.assert_allclose(euler[1], pitch, rtol=0, atol=1e-15)  # where asin would have an error of 1e-8
    assert distance(numeric.from_euler(*euler), q) < (2e-15 if gap > 2e-14 else 1.6e-14)


def test_error_rotation_vector():
    phi = VECTORS / np.linalg.norm(VECTORS, axis=1, keepdims=True) * RNG.uniform(size=(len(VECTORS), 1))
    q_estimate = numeric.multiply(numeric.from_rotation_vector(phi), QUATERNIONS)
    np.testing.assert_allclose(numeric.error_rotation_vector(q_estimate, QUATERNIONS), phi, atol=5e-15)


@pytest.mark.parametrize("error", [1e-3, -1e-3, 1e-6])
def test_renormalized_length_is_of_second_order(error):
    """A quaternion of norm 1 + e becomes one of norm 1 - 3/2 e^2, and the same rotation."""
    q, x = QUATERNIONS[0], ca.SX.sym("x", 4)
    found = ca.Function("f", [x], [attitude.renormalize(x)])(q * (1 + error)).full().ravel()
    assert np.linalg.norm(found) - 1 == pytest.approx(-1.5 * error**2, rel=0.01, abs=1e-15)
    assert np.allclose(found / np.linalg.norm(found), q, rtol=0, atol=1e-15)
