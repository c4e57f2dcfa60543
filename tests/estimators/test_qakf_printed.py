"""qakf-printed and qakf-improved-printed against the textbook filter in plain NumPy, matrix by matrix."""

import numpy as np
import pytest

from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.estimators import get, qakf_printed
from insenv.plant.feeding import input_rows

IDS = ("qakf-printed", "qakf-improved-printed")
LATITUDE, DT = 0.6, 0.05


def left(v):
    """[v +]: v (x) q as a matrix times q."""
    return np.array([[0, *-v], *np.column_stack([v, np.cross(np.eye(3), -v).T])])


def right(v):
    """[v -]: q (x) v as a matrix times q."""
    return np.array([[0, *-v], *np.column_stack([v, np.cross(np.eye(3), v).T])])


def textbook(alpha, beta, improved, b=1.0, s=0.0, known=0.0, least=1e-7):
    """Q (4) after all vectors: Kalman filter with a 4x4 gain, noise by Sage and Husa."""
    q, P, K, r = np.array([1.0, 0, 0, 0]), np.eye(4), np.zeros((4, 4)), 0.0
    for k, (a, c) in enumerate(zip(alpha / geodesy.NOMINAL_GRAVITY, beta / geodesy.NOMINAL_GRAVITY, strict=True)):
        M = left(c) - right(a)
        K = K + M.T @ M * DT
        H = K if improved else M
        e = -H @ q
        d = 1 / (k + 1) if b == 1 else (1 - b) / (1 - b ** (k + 1))
        r = max((1 - d) * r + d * np.trace(np.outer(e, e) - s * H @ P @ H.T) / 4, (least / geodesy.NOMINAL_GRAVITY) ** 2)
        if known:
            r = (known / geodesy.NOMINAL_GRAVITY) ** 2
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + r * np.eye(4))
        q = q + gain @ e
        q /= np.linalg.norm(q)
        P = (np.eye(4) - gain @ H) @ P @ (np.eye(4) - gain @ H).T + r * gain @ gain.T
    return q


def at_rest(id, q_nb, n=400, **parameters):
    """The filter after n samples at rest with noise, and the vectors that it has seen."""
    C_nb, rate_n = attitude.numeric.to_dcm(q_nb), geodesy.numeric.earth_rate_n(LATITUDE)
    up = np.array([0, 0, float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))])
    noise = 1e-3 * np.random.default_rng(2).normal(size=(n, 3))
    force = -C_nb.T @ up + noise
    columns = {"delta_angle": np.tile(C_nb.T @ rate_n * DT, (n, 1)), "delta_velocity": force * DT, "dt": np.full(n, DT)}
    model = get(id).model
    runner = make_runner(model, {"latitude": LATITUDE, **parameters})
    runner.run(n, input_rows(model, columns, n), 0)
    turns = attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(rate_n * (np.arange(n)[:, None] + 0.5) * DT))
    beta = np.einsum("tij,j->ti", turns, -up)
    turns_b = attitude.numeric.to_dcm(attitude.numeric.from_rotation_vector(C_nb.T @ rate_n * np.arange(n)[:, None] * DT))
    alpha = np.einsum("tij,tj->ti", turns_b, force)
    return runner, alpha, beta


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize(
    "reading", [{}, {"forgetting": 0.97}, {"subtracted": 1.0, "least_noise_sigma": 1e-4}, {"noise_sigma": 1e-3}]
)
def test_against_the_textbook(id, reading):
    q_nb = attitude.numeric.from_euler(0.1, -0.2, 0.7)
    runner, alpha, beta = at_rest(id, q_nb, **reading)
    names = {"forgetting": "b", "subtracted": "s", "noise_sigma": "known", "least_noise_sigma": "least"}
    expected = textbook(alpha, beta, "improved" in id, **{names[name]: value for name, value in reading.items()})
    found = runner.model.state.unpack(runner.x)["q_start"]
    # alpha here leaves out the rotation within a sample: 2e-6 rad
    assert np.abs(attitude.numeric.error_rotation_vector(found, expected)).max() < 2e-3
    assert np.abs(attitude.numeric.error_rotation_vector(found, expected)[:2]).max() < 2e-5
    assert np.abs(attitude.numeric.error_rotation_vector(found, q_nb)).max() > 1e-4  # 20 s leave an error to compare


@pytest.mark.parametrize("id", IDS)
def test_without_noise_any_attitude_is_found(id):
    q_nb = attitude.numeric.from_euler(-1.0, 0.4, 2.5)
    C_nb, n = attitude.numeric.to_dcm(q_nb), 2400
    force = -C_nb.T @ [0, 0, float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))]
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE)
    columns = {"delta_angle": np.tile(rate * DT, (n, 1)), "delta_velocity": np.tile(force * DT, (n, 1)), "dt": np.full(n, DT)}
    model = get(id).model
    runner = make_runner(model, {"latitude": LATITUDE})
    runner.run(n, input_rows(model, columns, n), 0)
    error = np.abs(attitude.numeric.error_rotation_vector(runner.outputs()["q_nb"], q_nb))
    # from 2.5 rad of heading: what that leaves in the first residuals counts as noise from then on
    assert error[:2].max() < 1e-3 and error[2] < 0.1


def test_both_say_that_they_are_for_comparison():
    for id in IDS:
        estimator = get(id)
        rows = {row.name: row.flat_start()[0] for row in estimator.model.parameters if row.name != "start_quaternion"}
        assert "for comparison" in " ".join(estimator.objections(rows, 200.0))
    assert get(IDS[0]).needed_s({}) == qakf_printed.SETTLING_S
