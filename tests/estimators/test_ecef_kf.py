"""ecef-kf: two samples against SciPy, Jacobians, its start; the printed filter against full matrices in NumPy."""

import casadi as ca
import numpy as np
import pytest
from driven import fed, outputs_of
from earth_fixed import frame_n, skew
from resting import samples
from scipy.spatial.transform import Rotation

from insenv import attitude, geodesy, run
from insenv.core import symmetric
from insenv.core.numeric import vectorized
from insenv.estimators import ecef_kf, get
from insenv.estimators.parts.strapdown import turned, velocity_change
from insenv.scenario import load

EARTH = np.array([0, 0, geodesy.OMEGA_IE])


def test_attitude_over_two_samples():
    """A rate linear in time, integrated finely by SciPy: the error falls with the fourth power of the interval."""
    rng, start, steps, errors = np.random.default_rng(0), Rotation.random(random_state=0), 1000, []
    rate, growth = rng.normal(size=3), rng.normal(size=3) * 3
    for h in (0.04, 0.02):
        t = (np.arange(steps) + 0.5) * 2 * h / steps
        true = start
        for turn in Rotation.from_rotvec((rate + growth * t[:, None]) * 2 * h / steps):
            true = true * turn
        first, second = (rate * h + growth * (b * b - a * a) / 2 for a, b in ((0, h), (h, 2 * h)))
        found = vectorized(turned, 4, 3, 3)(start.as_quat(scalar_first=True), first, second)
        errors.append((Rotation.from_quat(found, scalar_first=True) * true.inv()).magnitude())
    assert errors[0] < 1e-5
    assert errors[0] / errors[1] > 11


def test_velocity_change_over_two_samples():
    """Against fine integration with rate and force linear in time."""
    rng, h, n = np.random.default_rng(1), 0.02, 4000
    rate, growth, force, jerk = rng.normal(size=(4, 3)) * [[1], [1], [9], [9]]
    t = (np.arange(n) + 0.5) * 2 * h / n
    angle = rate * t[:, None] + growth * t[:, None] ** 2 / 2
    coning = np.cross(rate, growth) * t[:, None] ** 3 / 12
    true = Rotation.from_rotvec(angle + coning).apply(force + jerk * t[:, None]).sum(axis=0) * 2 * h / n
    parts = [v * h + g * (b * b - a * a) / 2 for v, g in ((rate, growth), (force, jerk)) for a, b in ((0, h), (h, 2 * h))]
    found = vectorized(velocity_change, 3, 3, 3, 3)(*parts)
    assert np.abs(found - true).max() < 1e-5 * np.abs(true).max()


@pytest.mark.parametrize("seed", range(2))
def test_observation_of_a_mean_against_integration(seed):
    """The mean of the velocity error over a window from the error at its end."""
    rng, C = np.random.default_rng(seed), Rotation.random(random_state=seed).as_matrix()
    force = rng.normal(size=3) * 9
    T, n = 0.5, 500
    F = np.array(ca.DM(ecef_kf.transition(ca.SX(1.0), ca.SX(C @ force), ca.SX(C))))
    x = rng.normal(size=12)
    mean = np.zeros(3)
    for _ in range(n):
        mean += (x + F @ x * T / n / 2)[:3] / n
        x = x + F @ x * (T / n) + F @ F @ x * (T / n) ** 2 / 2
    H = np.array(ca.DM(ecef_kf.observation(ecef_kf.transition(ca.SX(T), ca.SX(C @ force * T), ca.SX(C * T)), 0.5)))
    # what is left out: the drift of phi within the window, force T^2 / 6 b_g, and 2 omega_ie T / 2 dv
    assert np.abs(H @ x - mean).max() < 1.1 * np.linalg.norm(force) * T**2 / 6 * np.linalg.norm(x[9:]) + 1e-3


def test_starts_from_its_own_coarse_alignment_unless_told_not_to():
    """On sway, a start from the given attitude takes the sway for tilt at first, and is as stated after five minutes."""
    given = load("ship-swaying").model_copy(update={"estimator": {"ecef-kf": {"coarse_time_s": 0.0}}})
    own, given = (run(scenario, "ecef-kf").results[0] for scenario in ("ship-swaying", given))
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        late = own.time > 150
        assert np.all(np.abs(own.errors[channel][late]) < 3 * own.sigma[channel][late]), channel
        assert abs(given.errors[channel][-1]) < 3 * given.sigma[channel][-1], channel
    assert abs(given.errors["heading_deg"][10]) > 1 and given.sigma["heading_deg"][10] < 3


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("age", [0.0, 0.15])
def test_observation_of_a_fix_against_differences(seed, age):
    """Moving base: lever arm and age in the innovation are also in H, at random attitudes, rates and accelerations."""
    rng = np.random.default_rng(seed)
    model = ecef_kf.MODEL
    p, x = ca.SX.sym("p", model.parameters.size), ca.SX.sym("x", model.state.size)
    function = ca.Function("f", [p, x], list(ecef_kf.fix_observation(model.parameters.symbols(p), model.state.symbols(x))))
    parameters = model.parameters.pack({"antenna_lever_arm": rng.normal(size=3) * 5})
    C_eb = Rotation.random(random_state=seed)
    values = {
        "q_eb": C_eb.as_quat(scalar_first=True), "velocity_e": rng.normal(size=3) * 10, "rate_b": rng.normal(size=3),
        "rate_change_b": rng.normal(size=3), "acceleration_e": rng.normal(size=3), "gravity_e": rng.normal(size=3) * 6,
        "fix_velocity_n": rng.normal(size=3) * 10, "fix_age": age, "place": (0.6, 1.2, 50.0),
    }  # fmt: skip

    def innovation(error):
        """Innovation of an estimate with `error`: C_hat = exp(-phi) C, rates and forces with the remaining biases."""
        dv, phi, accel, gyro = error.reshape(4, 3)
        turn, force = Rotation.from_rotvec(-phi), values["acceleration_e"] - values["gravity_e"]
        off = {
            "q_eb": (turn * C_eb).as_quat(scalar_first=True), "velocity_e": values["velocity_e"] + dv,
            "rate_b": values["rate_b"] + gyro, "acceleration_e": values["gravity_e"] + turn.apply(force + C_eb.apply(accel)),
        }  # fmt: skip
        return function(parameters, model.state.pack({**values, **off}))[0].full().ravel()

    H = function(parameters, model.state.pack(values))[1].full()
    step = 1e-6
    difference = np.array([(innovation(e) - innovation(-e)) / (2 * step) for e in np.eye(12) * step]).T
    assert np.allclose(H, difference, atol=1e-7)
    assert np.abs(H[:, 3:6]).max() > 0.1 and np.abs(H[:, 9:]).max() > 0.1


@pytest.mark.parametrize("arrives", [101, 102])
def test_a_fix_that_waits_for_the_end_of_its_pair_is_older_by_a_sample(arrives):
    """A start along north with 2 m/s^2; a fix of velocity 0 without weight: its innovation is the velocity at its epoch."""
    dt, age, count, (latitude, force) = 0.01, 0.05, 102, (0.7, 2.0)
    gravity, here = float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0)), np.arange(1, count + 1) == arrives
    columns = {
        "delta_angle": np.tile(geodesy.numeric.earth_rate_n(latitude) * dt, (count, 1)),
        "delta_velocity": np.tile([force * dt, 0.0, -gravity * dt], (count, 1)), "dt": np.full(count, dt),
        "gnss_valid": here, "gnss_velocity_valid": here, "gnss_age": np.full(count, age),
        "gnss_latitude": np.full(count, latitude), "gnss_velocity_sigma": np.full((count, 3), 1e6),
    }  # fmt: skip
    found = fed(ecef_kf.MODEL, columns, {"latitude": latitude, "moving": 1.0, "update_interval": 1.0}).outputs()
    north = frame_n(geodesy.numeric.geodetic_to_ecef(latitude, 0.0, 0.0))[:, 0]
    assert found["innovation"] @ north == pytest.approx(force * (arrives * dt - age), abs=2e-3)


def test_the_covariance_is_shown_about_north_east_and_down():
    """An attitude error about e with the covariance of the state, resolved in n at a place with neither 0 nor 90 deg."""
    model, rng = ecef_kf.MODEL, np.random.default_rng(8)
    L = rng.normal(size=(ecef_kf.N, ecef_kf.N)) * 1e-3
    place = (0.7, -2.0, 100.0)
    state = model.state.pack(
        {"coarse": 0.0, "place": place, "covariance": np.array(ca.DM(symmetric.triangle(ca.DM(L @ L.T)))).ravel()}
    )
    shown = outputs_of(model, state)
    axes = frame_n(geodesy.numeric.geodetic_to_ecef(*place)).T
    expected = axes @ (L @ L.T)[ecef_kf.TILT, ecef_kf.TILT] @ axes.T
    assert np.allclose(shown["attitude_covariance"], expected, rtol=1e-9, atol=1e-15)
    assert np.allclose(shown["attitude_sigma"], np.sqrt(np.diag(expected)), rtol=1e-9)


SIGMAS = {"tilt_sigma": 0.01, "heading_sigma": 0.03, "gyro_bias_sigma": 1e-6, "accel_bias_sigma": 1e-3, "gravity_noise": 3e-5,
          "angle_random_walk": 2e-6, "velocity_random_walk": 4e-5}  # fmt: skip
START = {"start_roll": 0.012, "start_pitch": -0.006, "start_heading": 0.52}


def reference(columns, gravity):
    """Attitude matrix b to n at the end, and the covariance of the misalignment about n."""
    latitude, dt = 0.7, 0.02
    s, c = np.sin(latitude), np.cos(latitude)
    C_en = np.array([[-s, 0, -c], [0, 1, 0], [c, 0, -s]])
    C = C_en @ Rotation.from_euler("ZYX", [START[f"start_{name}"] for name in ("heading", "pitch", "roll")]).as_matrix()
    P = np.zeros((12, 12))
    P[:3, :3] = 0.1**2 * np.eye(3)
    P[3:6, 3:6] = C_en @ np.diag([0.01, 0.01, 0.03]) ** 2 @ C_en.T
    P[6:9, 6:9], P[9:, 9:] = 1e-6 * np.eye(3), 1e-12 * np.eye(3)
    v, accel, gyro, down = np.zeros(3), np.zeros(3), np.zeros(3), C_en @ [0, 0, gravity]
    Q = np.diag(np.repeat([(4e-5**2 + 3e-5**2) * dt, 2e-6**2 * dt, 0, 0], 3))
    H = np.eye(3, 12)
    for angle, velocity in zip(columns["delta_angle"], columns["delta_velocity"], strict=True):
        after = C @ Rotation.from_rotvec(angle - (C.T @ EARTH + gyro) * dt).as_matrix()
        felt = (C + after) @ (velocity - accel * dt) / 2
        F = np.zeros((12, 12))
        F[:3, :3], F[:3, 3:6], F[:3, 6:9] = -2 * skew(EARTH), skew(felt / dt), C
        F[3:6, 3:6], F[3:6, 9:] = -skew(EARTH), -C
        v = v + felt + (down - 2 * np.cross(EARTH, v)) * dt
        X = F * dt
        Phi = np.eye(12) + X @ (np.eye(12) + X / 2 @ (np.eye(12) + X / 3))
        P = Phi @ P @ Phi.T + Q
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + 1e-6 * np.eye(3))
        x = gain @ v
        P = (np.eye(12) - gain @ H) @ P
        v, accel, gyro = v - x[:3], accel + x[6:9], gyro + x[9:]
        C = Rotation.from_rotvec(x[3:6]).as_matrix() @ after
    return C_en.T @ C, C_en.T @ P[3:6, 3:6] @ C_en


def test_the_printed_filter_is_the_filter_with_full_matrices():
    """Half a minute at rest at roll 0.004, pitch 0.003, heading 0.5, with biases and noise."""
    q_nb, errors = attitude.numeric.from_euler(0.004, 0.003, 0.5), ([5e-7, -4e-7, 3e-7], [4e-4, -3e-4, 5e-4])
    columns = samples(q_nb, 0.7, 30.0, 0.02, *errors, accel_noise=3e-4)
    columns["delta_angle"] = columns["delta_angle"] + 3e-7 * np.random.default_rng(4).normal(size=(1500, 3))
    C_nb, covariance = reference(columns, float(geodesy.numeric.normal_gravity(np.sin(0.7), 0.0)))
    found = fed(get("ecef-kf-printed").model, columns, {"latitude": 0.7, **SIGMAS, **START}, "interpreter").outputs()
    apart = Rotation.from_matrix(attitude.numeric.to_dcm(found["q_nb"]) @ C_nb.T).as_rotvec()
    moved = Rotation.from_matrix(C_nb @ Rotation.from_euler("ZYX", [0.52, -0.006, 0.012]).as_matrix().T).as_rotvec()
    assert np.abs(moved).max() > 5e-3  # it has done something
    assert np.abs(apart[:2]).max() < 3e-7 and abs(apart[2]) < 1e-5
    assert np.allclose(np.sqrt(np.diag(covariance)), found["attitude_sigma"], rtol=0.05)  # times the scatter of the innovations
    assert np.allclose(covariance, found["attitude_covariance"], atol=1e-3 * np.abs(covariance).max())
