"""ecef-kf-printed against the same filter in plain NumPy with full matrices."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.estimators import get
from insenv.plant.feeding import input_rows

LATITUDE, DT, COUNT = 0.7, 0.02, 1500
SIGMAS = {"tilt_sigma": 0.01, "heading_sigma": 0.03, "gyro_bias_sigma": 1e-6, "accel_bias_sigma": 1e-3, "gravity_noise": 3e-5,
          "angle_random_walk": 2e-6, "velocity_random_walk": 4e-5}  # fmt: skip
START = {"start_roll": 0.012, "start_pitch": -0.006, "start_heading": 0.52}
AXIS = np.array([0.0, 0.0, geodesy.OMEGA_IE])


def skew(v):
    return np.cross(np.eye(3), np.asarray(v))


def samples():
    """At rest at roll 0.004, pitch 0.003, heading 0.5, with biases and noise."""
    C_nb = Rotation.from_euler("ZYX", [0.5, 0.003, 0.004]).as_matrix()
    rng = np.random.default_rng(4)
    gravity = float(geodesy.numeric.normal_gravity(np.sin(LATITUDE), 0.0))
    rate = C_nb.T @ geodesy.numeric.earth_rate_n(LATITUDE) + [5e-7, -4e-7, 3e-7]
    force = C_nb.T @ [0, 0, -gravity] + [4e-4, -3e-4, 5e-4]
    turned = rate * DT + 2e-6 * np.sqrt(DT) * rng.normal(size=(COUNT, 3))
    return turned, force * DT + 4e-5 * np.sqrt(DT) * rng.normal(size=(COUNT, 3)), gravity


def reference(turned, changed, gravity):
    """Attitude matrix b to n at the end, and the covariance of the misalignment about n."""
    s, c = np.sin(LATITUDE), np.cos(LATITUDE)
    C_en = np.array([[-s, 0, -c], [0, 1, 0], [c, 0, -s]])
    C = C_en @ Rotation.from_euler("ZYX", [START[f"start_{name}"] for name in ("heading", "pitch", "roll")]).as_matrix()
    P = np.zeros((12, 12))
    P[:3, :3] = 0.1**2 * np.eye(3)
    P[3:6, 3:6] = C_en @ np.diag([0.01, 0.01, 0.03]) ** 2 @ C_en.T
    P[6:9, 6:9], P[9:, 9:] = 1e-6 * np.eye(3), 1e-12 * np.eye(3)
    v, accel, gyro, down = np.zeros(3), np.zeros(3), np.zeros(3), C_en @ [0, 0, gravity]
    Q = np.diag(np.repeat([(4e-5**2 + 3e-5**2) * DT, 2e-6**2 * DT, 0, 0], 3))
    H = np.eye(3, 12)
    for angle, velocity in zip(turned, changed, strict=True):
        after = C @ Rotation.from_rotvec(angle - (C.T @ AXIS + gyro) * DT).as_matrix()
        felt = (C + after) @ (velocity - accel * DT) / 2
        F = np.zeros((12, 12))
        F[:3, :3], F[:3, 3:6], F[:3, 6:9] = -2 * skew(AXIS), skew(felt / DT), C
        F[3:6, 3:6], F[3:6, 9:] = -skew(AXIS), -C
        v = v + felt + (down - 2 * np.cross(AXIS, v)) * DT
        Phi = expm(F * DT)
        P = Phi @ P @ Phi.T + Q
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + 1e-6 * np.eye(3))
        x = gain @ v
        P = (np.eye(12) - gain @ H) @ P
        v, accel, gyro = v - x[:3], accel + x[6:9], gyro + x[9:]
        C = Rotation.from_rotvec(x[3:6]).as_matrix() @ after
    return C_en.T @ C, C_en.T @ P[3:6, 3:6] @ C_en


@pytest.mark.slow
def test_against_the_filter_with_full_matrices():
    turned, changed, gravity = samples()
    model = get("ecef-kf-printed").model
    runner = make_runner(model, {"latitude": LATITUDE, **SIGMAS, **START})
    columns = {"delta_angle": turned, "delta_velocity": changed, "dt": np.full(COUNT, DT)}
    runner.run(COUNT, input_rows(model, columns, COUNT), 0)
    C_nb, covariance = reference(turned, changed, gravity)
    found = runner.outputs()
    apart = Rotation.from_matrix(attitude.numeric.to_dcm(found["q_nb"]) @ C_nb.T).as_rotvec()
    moved = Rotation.from_matrix(C_nb @ Rotation.from_euler("ZYX", [0.52, -0.006, 0.012]).as_matrix().T).as_rotvec()
    assert np.abs(moved).max() > 5e-3  # it has done something
    assert np.abs(apart[:2]).max() < 3e-7 and abs(apart[2]) < 1e-5
    assert np.allclose(np.sqrt(np.diag(covariance)), found["attitude_sigma"], rtol=0.05)  # times the scatter of the innovations
    assert np.allclose(covariance, found["attitude_covariance"], atol=1e-3 * np.abs(covariance).max())


def test_it_says_that_it_is_for_comparison():
    rows = {"latitude": 0.7, "gyro_bias_sigma": 1e-8, "accel_bias_sigma": 1e-4, "angle_random_walk": 0.0,
            "tilt_sigma": 0.001, "heading_sigma": 0.01}  # fmt: skip
    notes = get("ecef-kf-printed").objections(rows, 600.0)
    assert len(notes) == 1 and "for comparison" in notes[0]
