"""Stated accuracies of alignments against variances computed from their definition: least squares, Brownian paths, loops."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

from insenv import run
from insenv.core.runner import make_runner
from insenv.estimators import analytic, get, gyrocompass, inertial_fir
from insenv.estimators.parts import inertial_vectors
from insenv.estimators.parts.fir import BLOCK_S
from insenv.geodesy import OMEGA_IE
from insenv.geodesy.numeric import earth_rate_n, normal_gravity

G, LATITUDE = 9.8, 0.6
QUIET = {"accel_bias_sigma": 0.0, "gyro_bias_sigma": 0.0, "angle_random_walk": 0.0, "velocity_random_walk": 0.0}


def stated(time, age=0.0, mean_age=0.0, lost=0.0, **noises):
    """`inertial_vectors.stated_sigma` in numbers."""
    p = SimpleNamespace(**{**QUIET, **noises})
    x = SimpleNamespace(rest_force_n=ca.SX([0, 0, -G]), axis_n=ca.SX([np.cos(LATITUDE), 0, -np.sin(LATITUDE)]))
    return np.array(ca.DM(ca.evalf(inertial_vectors.stated_sigma(p, x, ca.SX(time), lost, age, mean_age)))).ravel()


def line(density, duration, count=20_000):
    """Standard deviations of the end and of the slope of a line fitted to white noise of a density, over `duration`."""
    t = (np.arange(count) + 0.5) * duration / count - duration  # 0 at the end
    A = np.stack([np.ones(count), t], axis=1)
    return density * np.sqrt(count / duration) * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))


def test_white_noise_of_the_accelerometers_is_that_of_a_fitted_line():
    """The apparent vertical follows a line: its end is the tilt, its slope over the horizontal Earth rate the heading."""
    V, time = 2e-3, 300.0
    end, slope = line(V / G, time)
    found = stated(time + 20.0, lost=20.0, velocity_random_walk=V)
    assert found == pytest.approx([end, end, slope / (OMEGA_IE * np.cos(LATITUDE))], rel=1e-4)


def test_biases_of_the_stated_accuracy():
    """Tilt by the accelerometers and by what the gyros drift since the vertical; heading by the east gyro and the tilt."""
    found = stated(1e4, age=50.0, accel_bias_sigma=1e-3)
    assert found == pytest.approx([1e-3 / G, 1e-3 / G, 1e-3 / G * np.tan(LATITUDE)])
    found = stated(1e4, age=50.0, gyro_bias_sigma=1e-7)
    assert found == pytest.approx([5e-6, 5e-6, 1e-7 / (OMEGA_IE * np.cos(LATITUDE))])


def test_gyro_noise_since_the_vertical_is_the_mean_of_a_brownian_path():
    """Of a path over 2 x 40 s: variance of its end minus its mean, by the covariance min(s, t) of its points."""
    N, mean_age, count = 3e-5, 40.0, 800
    t = (np.arange(count) + 0.5) * 2 * mean_age / count
    covariance = N**2 * np.minimum(t[:, None], t)
    weights = -np.full(count, 1 / count)
    weights[-1] += 1
    expected = np.sqrt(weights @ covariance @ weights)
    assert stated(1e6, mean_age=mean_age, angle_random_walk=N)[:2] == pytest.approx([expected] * 2, rel=2e-3)


def test_heading_by_gyro_noise_is_the_slope_of_a_brownian_path():
    """The mean rate over the time: the best estimate of the drift of a Brownian path."""
    N, time = 3e-5, 300.0
    assert stated(time, angle_random_walk=N)[2] == pytest.approx(N / np.sqrt(time) / (OMEGA_IE * np.cos(LATITUDE)))


# --- inertial-fir -------------------------------------------------------------------------------------------


def levelled(seconds, **parameters):
    """Tilt variance of `inertial-fir` after blocks of levelling from a known one, with a sway too large to learn from."""
    model = get("inertial-fir").model
    values = {"sway_velocity_sigma": 100.0, **QUIET, **parameters}
    p, block = model.parameters.pack(values), model.kernels["level"]
    x = model.state.pack({"block_time": BLOCK_S, "gravity": G, "axis_n": [np.cos(LATITUDE), 0, -np.sin(LATITUDE)],
                          "tilt_variance": 0.0,
                          "velocity_variance": 0.0, "force_sum": [0, 0, -G * BLOCK_S]})  # fmt: skip
    u = model.inputs.start_vector()
    for _ in range(round(seconds / BLOCK_S)):
        done, result = 0, np.array(block.function(p, x, u, [])).ravel()
        for span in block.spans:
            x[span] = result[done : done + span.stop - span.start]
            done += span.stop - span.start
    return float(model.state.unpack(x)["tilt_variance"])


def test_levelling_allows_for_the_drift_of_the_gyros():
    """White noise grows with the time; a bias as noise that drifts as far as it does in 100 s."""
    assert levelled(100.0, gyro_bias_sigma=4e-8) == pytest.approx((4e-8 * 100.0) ** 2, rel=1e-3)
    assert levelled(100.0, angle_random_walk=2e-7) == pytest.approx(2e-7**2 * 100.0, rel=1e-3)


def test_levelling_reaches_the_variance_of_the_optimal_loop():
    """Two states, velocity and tilt, against the steady Riccati equation of the continuous filter."""
    N, V, sway = 5e-6, 1e-3, 0.3
    F, H = np.array([[0.0, G], [0.0, 0.0]]), np.array([[1.0, 0.0]])
    P = solve_continuous_are(F.T, H.T, np.diag([V**2, N**2]), np.array([[sway**2]]))
    found = levelled(600.0, angle_random_walk=N, velocity_random_walk=V, sway_velocity_sigma=sway)
    assert found == pytest.approx(P[1, 1], rel=0.05)


def test_tilt_of_the_fix_allows_for_what_the_gyros_drift_in_its_delay():
    """At the first fix, of a vertical in the middle of the vectors: the delay of the cascade and half the baseline."""
    model = get("inertial-fir").model
    runner = make_runner(model, {**QUIET, "gyro_bias_sigma": 4e-8, "latitude": LATITUDE}, "interpreter")
    runner.x[:] = model.state.pack({"fixes": 1.0, "tilt_variance": 0.0}, base=runner.x)
    delay = BLOCK_S * (inertial_fir.CASCADE.span / 2) + 54.0
    assert runner.outputs()["attitude_sigma"][:2] == pytest.approx([4e-8 * delay] * 2, rel=1e-6)
    assert runner.outputs()["attitude_sigma"][2] == pytest.approx(4e-8 / (OMEGA_IE * np.cos(LATITUDE)), rel=1e-6)


# --- gyrocompass and analytic ---------------------------------------------------------------------------------


def test_noise_of_the_heading_loop_is_that_of_its_equations():
    """v', phi_E', phi_D' of the module with white noise of gyros and accelerometers: the steady covariance."""
    tau, R = 40.0, OMEGA_IE * np.cos(LATITUDE)
    K1, K2, K3 = 3 / tau, 3 / tau**2, 1 / tau**3
    F = np.array([[-K1, -G, 0.0], [K2 / G, 0.0, R], [K3 / (G * R), 0.0, 0.0]])
    for name, noise in (("angle_random_walk", np.diag([0, 1e-5**2, 0])), ("velocity_random_walk", np.diag([1e-3**2, 0, 0]))):
        expected = np.sqrt(solve_continuous_lyapunov(F, -noise)[2, 2])
        given = {**QUIET, name: {"angle_random_walk": 1e-5, "velocity_random_walk": 1e-3}[name], "heading_constant": tau}
        x = gyrocompass.MODEL.state.pack({"time": 1e6, "gravity": G, "axis_n": [np.cos(LATITUDE), 0, -np.sin(LATITUDE)]})
        p = gyrocompass.MODEL.parameters.pack({**given, "start_heading_sigma": 0.0})
        shown = gyrocompass.MODEL.outputs.unpack(np.array(gyrocompass.MODEL.kernels["output"].function(p, x)).ravel())
        assert shown["attitude_sigma"][2] == pytest.approx(expected, rel=1e-3), name


def test_analytic_states_the_noise_of_two_means():
    V, N, time = 2e-3, 3e-5, 200.0
    p = analytic.MODEL.parameters.pack({**QUIET, "velocity_random_walk": V, "angle_random_walk": N, "latitude": LATITUDE})
    path = {"angle": np.array([1e-3, 0, -1e-3]), "velocity": np.array([0, 0, -G * time])}
    x = analytic.MODEL.state.pack({**path, "first": np.concatenate(list(path.values())) / time, "time": time})
    shown = analytic.MODEL.outputs.unpack(np.array(analytic.MODEL.kernels["output"].function(p, x)).ravel())
    expected = [V / np.sqrt(time) / G] * 2 + [N / np.sqrt(time) / (OMEGA_IE * np.cos(LATITUDE))]
    assert shown["attitude_sigma"] == pytest.approx(expected, rel=1e-6)


def test_the_scatter_about_a_straight_line_is_that_of_a_fit():
    """Angle and velocity of a swaying base, sample by sample, against a line fitted to them."""
    rng, dt, count = np.random.default_rng(5), 0.1, 400
    model = analytic.MODEL
    rows = np.cumsum(rng.normal(size=(count, 6)), axis=0) * 1e-2 + [1e-4, 0, 2e-4, 0.1, 0.2, -9.8]
    u = np.tile(model.inputs.start_vector(), (count, 1))
    u[:, model.inputs.slice("delta_angle")], u[:, model.inputs.slice("delta_velocity")] = rows[:, :3] * dt, rows[:, 3:] * dt
    u[:, model.inputs.slice("dt")] = dt
    runner = make_runner(model, None, "interpreter")
    runner.run(count, u, 0)
    found = np.array(ca.DM(ca.evalf(analytic.spread(model.state.symbols(ca.SX(ca.DM(runner.x))))))).ravel()
    middle = np.cumsum(rows, axis=0) * dt - rows * dt / 2  # the integrals in the middle of each sample
    t = dt * (np.arange(count) + 0.5)
    left = middle - np.stack([np.polyval(np.polyfit(t, column, 1), t) for column in middle.T], axis=1)
    assert found == pytest.approx(np.mean(left**2, axis=0), rel=2e-3)
    ended = np.array(ca.DM(ca.evalf(analytic.departure(model.state.symbols(ca.SX(ca.DM(runner.x))))))).ravel()
    lines = [np.polyval(np.polyfit(t, column, 1), dt * count) for column in middle.T]
    assert ended == pytest.approx(rows.sum(axis=0) * dt - lines, rel=2e-3)


def test_analytic_knows_that_somebody_has_just_stepped_in():
    """A parked car, 2.5 s after it has begun to tilt by 0.6 deg: heading is off by 100 deg, 14 deg were stated."""
    found = run("car-parked", "analytic", seed=30000, duration_s=125.0).results[0]
    for channel in ("roll_deg", "pitch_deg", "heading_deg"):
        late = found.time > 55.0
        assert (np.abs(found.errors[channel]) < 3 * found.sigma[channel])[late].all(), channel
    assert np.abs(found.errors["heading_deg"]).max() > 90.0


@pytest.mark.parametrize("tilt", [(2e-4, 0.0), (0.0, 2e-4), (-1e-4, 3e-4)])
def test_levelling_removes_a_tilt_about_either_axis(tilt):
    """At rest, from a tilt that its variance allows: velocity feedback takes it out within two minutes."""
    model, dt, count = get("inertial-fir").model, 0.1, 1200
    rate, g = earth_rate_n(LATITUDE), float(normal_gravity(np.sin(LATITUDE), 0.0))
    given = {"latitude": LATITUDE, "block_samples": 1, "sway_velocity_sigma": 0.01, "heading_memory": 0.0, **QUIET}
    runner = make_runner(model, given, "interpreter")
    q = np.array([1.0, tilt[0] / 2, tilt[1] / 2, 0.0])
    rows = {"begin": 0.0, "fixes": 1.0, "q_n0i": q / np.linalg.norm(q), "velocity_variance": 1e-4, "tilt_variance": 1e-7}
    runner.x[:] = model.state.pack(rows, base=runner.x)
    runner.run(count, model.inputs.pack({"delta_angle": rate * dt, "delta_velocity": [0, 0, -g * dt], "dt": dt}), 0)
    left = 2 * runner.outputs()["q_nb"][1:3]
    assert np.abs(left).max() < 0.02 * np.abs(tilt).max()
