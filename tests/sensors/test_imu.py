"""The inertial unit: each error against its stated parameter, and the errors that take it back to the truth."""

import math
from typing import Any

import allantools
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2
from sensor_plant import CHANCE, assert_gauss_markov, assert_mean, assert_variance, plant, simulate, starts

from insenv.core.runner import make_runner
from insenv.sensors import imu_grade
from insenv.sensors.imu import true_unit_errors
from insenv.sensors.imu_tables import FLICKER_PARTS, FLICKER_SIGMA, FLICKER_TIMES


def test_the_output_of_a_perfect_imu_is_the_truth_to_the_last_bit() -> None:
    rng = np.random.default_rng(2)
    angle, velocity = rng.normal(size=(2, 300, 3)) * 1e-2
    out = simulate(300, imu_grade("perfect").parameters(), {"true_delta_angle": angle, "true_delta_velocity": velocity})
    assert np.array_equal(out["delta_angle"], angle) and np.array_equal(out["delta_velocity"], velocity)
    assert out["imu_valid"].all() and not out["gyro_bias_true"].any() and not out["accel_bias_true"].any()


def test_white_noise_has_the_stated_density_and_is_white() -> None:
    n, dt = 10000, 0.01
    density = {"angle_random_walk": (1e-4, 2e-4, 3e-4), "velocity_random_walk": (1e-3, 2e-3, 3e-3)}
    out = simulate(n, {**density, "sample_interval": dt, "seed": 3})
    both = np.hstack([out["delta_angle"], out["delta_velocity"]])
    exact = np.square([*density["angle_random_walk"], *density["velocity_random_walk"]])
    assert_variance(both, exact * dt)
    z = both / both.std(axis=0)
    bound = 4.5 / math.sqrt(n)
    assert np.abs(np.corrcoef(z.T) - np.eye(6)).max() < bound
    assert max(abs(np.mean(z[1:, i] * z[:-1, i])) for i in range(6)) < bound
    assert np.abs(z.mean(axis=0)).max() < bound


def test_gauss_markov_bias_has_its_variance_and_correlation() -> None:
    n, every, sigma, time = 20000, 5, 2e-6, 4.0
    rows = {"sample_interval": 0.2, "gyro_instability_sigma": sigma, "gyro_instability_time": time, "seed": 5}
    bias = simulate(n, rows)["gyro_bias_true"]
    knots = bias[::every]
    assert_gauss_markov(knots, sigma, time, 1.0)
    # linear in between
    between = knots[:-1, None, :] + np.arange(every)[:, None] / every * np.diff(knots, axis=0)[:, None, :]
    assert np.allclose(bias[: len(between) * every], between.reshape(-1, 3), rtol=0, atol=1e-12 * sigma * every * 10)


def test_gauss_markov_scale_factor_and_misalignment_have_their_variance_and_correlation() -> None:
    """About the fixed parts, in the axes of the sensor; each sample is measured with what the one before it left."""
    n, every, time, C_bs = 20000, 5, 4.0, Rotation.from_rotvec([0.3, -1.2, 2.0])
    x, y, z, w = C_bs.as_quat()
    rows = {"sample_interval": 0.2, "q_bs": (w, x, y, z), "seed": 7, "accel_scale_factor_sigma": 3e-4}
    rows |= {"gyro_scale_factor": 1e-3, "gyro_scale_factor_sigma": 2e-4, "gyro_misalignment_sigma": 1e-4}
    true = np.array([0.01, -0.02, 0.03])
    out = simulate(n, {**rows, "gyro_scale_factor_time": time}, {"true_delta_angle": true})
    matrix = out["gyro_error_matrix"] @ C_bs.as_matrix()
    knots = matrix[::every]
    assert_gauss_markov(np.diagonal(knots, axis1=1, axis2=2) - 1.001, 2e-4, time, 1.0)
    assert_gauss_markov(knots[:, ~np.eye(3, dtype=bool)], 1e-4, time, 1.0)
    measured = (out["gyro_error_matrix"][:-1] @ true) @ C_bs.as_matrix().T
    assert np.allclose(out["delta_angle"][1:], measured, rtol=0, atol=1e-16)
    still = out["accel_error_matrix"] @ C_bs.as_matrix()
    assert (still == still[0]).all() and np.ptp(np.diagonal(still[0])) > 1e-5


def test_rate_random_walk_has_its_density() -> None:
    n, dt, density = 20000, 0.1, 1e-6
    rows = {"sample_interval": dt, "accel_rate_random_walk": density, "drift_interval": 4.0, "seed": 6}
    bias = simulate(n, rows)["accel_bias_true"]
    steps = np.diff(bias[::40], axis=0)
    assert_variance(steps, density**2 * 4.0)


def test_what_is_drawn_at_the_start_over_seeds() -> None:
    rows = {"gyro_bias": 1e-6, "gyro_bias_sigma": (1e-6, 2e-6, 3e-6), "accel_bias_sigma": 1e-3}
    rows |= {"gyro_scale_factor": 1e-4, "gyro_scale_factor_sigma": 2e-4, "accel_misalignment": 3e-4}
    rows |= {"accel_misalignment_sigma": 1e-4, "gyro_instability_sigma": 5e-7, "gnss_wander_sigma": (1.0, 2.0, 3.0)}
    x = starts(rows, 1500)
    for i in range(3):
        assert_mean(x["gyro_bias_turn_on"][:, i], 1e-6, (i + 1) * 1e-6)
    assert_variance(x["gyro_bias_turn_on"] - 1e-6, (1e-12, 4e-12, 9e-12))
    assert_variance(x["gnss_wander"], (1.0, 4.0, 9.0))
    assert_variance(x["accel_bias_true"], 1e-6)
    assert_variance(x["gyro_instability"], 25e-14)
    assert np.allclose(x["gyro_bias_true"], x["gyro_bias_turn_on"] + x["gyro_instability"], rtol=0, atol=1e-20)
    scale = np.diagonal(x["gyro_error_matrix"], axis1=1, axis2=2) - 1.0
    couplings = x["accel_error_matrix"][:, ~np.eye(3, dtype=bool)]
    for drawn, mean, sigma in ((scale, 1e-4, 2e-4), (couplings, 3e-4, 1e-4)):
        assert_mean(drawn, mean, sigma)
        assert_variance(drawn - mean, sigma**2)
    assert not (x["gyro_error_matrix"][:, ~np.eye(3, dtype=bool)]).any()
    draws = np.column_stack([x["gyro_bias_turn_on"], x["accel_bias_true"], scale, couplings])
    assert np.abs(np.corrcoef(draws.T) - np.eye(15)).max() < 5.0 / math.sqrt(1500)


def test_scale_misalignment_mounting_and_g_sensitivity_against_matrices() -> None:
    C_bs = Rotation.from_rotvec([0.3, -1.2, 2.0])
    error = Rotation.from_rotvec([0.02, -0.01, 0.03])
    x, y, z, w = C_bs.as_quat()
    coupling, G = np.arange(1, 7) * 1e-3, np.arange(9).reshape(3, 3) * 1e-4
    rows = {"q_bs": (w, x, y, z), "mounting_error": error.as_rotvec(), "gyro_g_sensitivity": G}
    rows |= {"gyro_scale_factor": (1e-3, 2e-3, 3e-3), "gyro_misalignment": coupling, "gyro_bias": (1e-3, 0.0, -2e-3)}
    angle, velocity, dt = np.array([0.01, -0.02, 0.03]), np.array([0.5, 0.1, -0.05]), 0.005
    out = simulate(3, rows, {"true_delta_angle": angle, "true_delta_velocity": velocity})
    M = np.array([[1.001, 1e-3, 2e-3], [3e-3, 1.002, 4e-3], [5e-3, 6e-3, 1.003]])
    to_sensor = (C_bs * error).inv()
    sensed = M @ to_sensor.apply(angle) + np.array([1e-3, 0.0, -2e-3]) * dt + G @ C_bs.inv().apply(velocity)
    assert np.allclose(out["delta_angle"], C_bs.apply(sensed), rtol=0, atol=1e-16)
    assert np.allclose(out["gyro_bias_true"], C_bs.apply([1e-3, 0.0, -2e-3]), rtol=0, atol=1e-18)
    # the accelerometers share the mounting; only its error is visible, because the nominal mounting is undone
    assert np.allclose(out["delta_velocity"], (C_bs * to_sensor).apply(velocity), rtol=0, atol=1e-15)


def test_quantisation_loses_nothing_and_saturation_stops_at_full_scale() -> None:
    rng = np.random.default_rng(8)
    angle, velocity = rng.normal(size=(2, 2000, 3)) * 1e-5
    q = {"gyro_quantum": 3e-5, "accel_quantum": 7e-6}
    out = simulate(2000, q, {"true_delta_angle": angle, "true_delta_velocity": velocity})
    for true, measured, quantum in ((angle, out["delta_angle"], 3e-5), (velocity, out["delta_velocity"], 7e-6)):
        counts = measured / quantum
        assert np.allclose(counts, np.round(counts), rtol=0, atol=1e-9)
        assert np.abs(np.cumsum(true - measured, axis=0)).max() <= 0.5 * quantum * (1 + 1e-9)
        assert len(np.unique(counts.round())) > 2
    dt, rates, forces = 0.01, np.array([[1.9, -5.0, 2.1]]), np.array([[-31.0, 29.0, 500.0]])
    rows = {"gyro_range": 2.0, "accel_range": 30.0, "sample_interval": dt}
    out = simulate(1, rows, {"true_delta_angle": rates * dt, "true_delta_velocity": forces * dt})
    assert np.allclose(out["delta_angle"] / dt, [[1.9, -2.0, 2.0]], rtol=1e-15)
    assert np.allclose(out["delta_velocity"] / dt, [[-30.0, 29.0, 30.0]], rtol=1e-15)


@pytest.mark.parametrize("ramp", [0.0, 0.02])
def test_temperature_warms_up_and_drags_biases_and_scale_factors_along(ramp: float) -> None:
    """The warm-up ends on the ramp; the slopes belong to the sensor's axes."""
    dt, n, time = 0.1, 1200, 30.0
    bias, scale = np.array([2e-7, -1e-7, 3e-7]), np.array([1e-5, -2e-5, 3e-5])
    rows = {"sample_interval": dt, "imu_temperature_initial": 280.0, "imu_temperature_final": 320.0}
    rows |= {"imu_temperature_ramp": ramp, "imu_temperature_time": time, "imu_temperature_reference": 300.0}
    rows |= {"gyro_temperature_slope": bias, "gyro_scale_factor_slope": scale, "accel_scale_factor_slope": -2 * scale}
    rows |= {"q_bs": (np.cos(0.4), np.sin(0.4), 0.0, 0.0)}
    angle, velocity = np.array([1e-3, 2e-3, -3e-3]), np.array([0.1, -0.2, -0.98])
    out = simulate(n, rows, {"true_delta_angle": angle, "true_delta_velocity": velocity})
    t = np.arange(n) * dt  # the first sample has the start value
    exact = 320.0 + ramp * t - 40.0 * np.exp(-t / time)
    assert np.allclose(out["imu_temperature"][::10], exact[::10], rtol=0, atol=1e-10)
    assert np.abs(out["imu_temperature"] - exact).max() < 40.0 / time**2 * 1.0**2 / 8.0 * 1.01
    warmth, C_bs = out["imu_temperature"][:, None] - 300.0, Rotation.from_euler("x", 0.8).as_matrix()
    assert np.allclose(out["gyro_bias_true"], warmth * (C_bs @ bias), rtol=0, atol=1e-18)
    turned = (1.0 + warmth * scale) * (C_bs.T @ angle) + warmth * bias * dt
    assert np.allclose(out["delta_angle"], turned @ C_bs.T, rtol=0, atol=1e-15)
    sped = (1.0 - 2 * warmth * scale) * (C_bs.T @ velocity)
    assert np.allclose(out["delta_velocity"], sped @ C_bs.T, rtol=0, atol=1e-15)


def test_dropped_samples_are_marked_and_empty() -> None:
    n, probability = 8000, 0.03
    truth = {"true_delta_angle": (1e-3, 2e-3, 3e-3), "true_delta_velocity": (0.0, 0.0, -0.05)}
    out = simulate(n, {"imu_drop_probability": probability, "seed": 4}, truth)
    lost = out["imu_valid"] == 0.0
    low, high = binom.ppf([CHANCE / 2, 1 - CHANCE / 2], n, probability)
    assert low <= lost.sum() <= high
    assert not out["delta_angle"][lost].any() and not out["delta_velocity"][lost].any()
    assert (out["delta_angle"][~lost] == [1e-3, 2e-3, 3e-3]).all()


def test_what_is_taken_out_of_the_increments_leaves_the_truth():
    """Every error of a unit that is turned in the body, warms up and has no noise."""
    rows = {"q_bs": (0.5, 0.5, -0.5, 0.5), "mounting_error": (0.01, -0.02, 0.03), "imu_temperature_initial": 310.0, "seed": 5}
    for name, size in (("gyro", 1e-3), ("accel", 1e-1)):
        rows |= {f"{name}_{row}": size for row in ("bias", "bias_sigma", "temperature_slope")}
        rows |= {f"{name}_scale_factor_slope": 1e-4}
        rows |= {f"{name}_{row}": 0.02 for row in ("scale_factor", "scale_factor_sigma", "misalignment_sigma")}
    rows["gyro_g_sensitivity"] = np.diag([1e-3, 2e-3, 3e-3])
    model = plant()
    runner = make_runner(model, rows | {"gnss_interval": 1e9})
    true = np.array([0.02, -0.03, 0.01]), np.array([0.05, 0.01, -0.04])
    inputs = {f"set_{name}": value for name, value in zip(("true_delta_angle", "true_delta_velocity"), true, strict=True)}
    shown = model.outputs.unpack(runner.run(3, np.tile(model.inputs.pack(inputs), (3, 1))))
    parameters = model.parameters.unpack(runner.p)
    found = true_unit_errors(runner.state, parameters)
    assert abs(runner.state["imu_temperature"] - parameters["imu_temperature_reference"]) > 1.0
    by_force = {"gyro": found["gyro_g_sensitivity"] * true[1], "accel": 0.0}
    for triad, row, exact in (("gyro", "delta_angle", true[0]), ("accel", "delta_velocity", true[1])):
        unbiased = shown[row][-1] - found[f"{triad}_bias"] * parameters["sample_interval"] - by_force[triad]
        kept = np.eye(3) - np.diag(found[f"{triad}_scale"])  # I - S - M
        kept[~np.eye(3, dtype=bool)] -= found[f"{triad}_misalignment"]
        assert kept @ unbiased == pytest.approx(exact, rel=1e-12)
        assert np.abs(found[f"{triad}_misalignment"]).min() > 1e-3


def allan_of_the_processes(time: Any) -> Any:
    """Allan deviation of the sum of Gauss-Markov processes of floor 1, in closed form."""
    total = 0.0
    for T in FLICKER_TIMES:
        u = time / T
        total = total + 2 * FLICKER_SIGMA**2 / u * (1 - (3 - 4 * np.exp(-u) + np.exp(-2 * u)) / (2 * u))
    return np.sqrt(total)


def test_it_has_the_floor_that_is_asked_for() -> None:
    """The Allan deviation of 3 axes of both triads; the processes are nearly flat from ten seconds to half a day."""
    flat = allan_of_the_processes(np.logspace(1, np.log10(5e4), 200))
    assert 0.92 < flat.min() < flat.max() < 1.01
    floor = {"gyro_flicker": (1e-7, 2e-7, 4e-7), "accel_flicker": (1e-4, 2e-4, 5e-5)}
    n, seeds, times = 20_000, 2, np.array([10, 30, 100, 300])
    ratios = []
    for seed in range(seeds):
        out = simulate(n, {"sample_interval": 1.0, "drift_interval": 1.0, "seed": seed, **floor})
        for output, name in (("delta_angle", "gyro_flicker"), ("delta_velocity", "accel_flicker")):
            for rate, size in zip(out[output].T, floor[name], strict=True):
                ratios.append(allantools.oadev(rate, 1.0, "freq", times)[1] / size)
    mean = np.sqrt(np.mean(np.square(ratios), axis=0))
    # 6 axes a seed of n / (2 time) independent differences each
    bound = 5.0 / np.sqrt(6 * seeds * n / times)
    assert (np.abs(mean / allan_of_the_processes(times) - 1.0) < bound + 0.01).all(), mean
    assert (np.abs(mean - 1.0) < 0.1).all(), mean


def test_it_is_stationary_from_the_first_sample_on() -> None:
    """Over many units: the variance of the bias after the first sample and after half a minute is the same."""
    units, floor = 200, np.array([1e-7, 2e-7, 3e-7])
    biases = []
    for seed in range(units):
        out = simulate(30, {"sample_interval": 1.0, "drift_interval": 1.0, "seed": seed, "gyro_flicker": floor})
        biases.append(out["gyro_bias_true"][[0, 1, 29]] / floor)
    variance = np.mean(np.square(biases), axis=(0, 2))
    expected = FLICKER_PARTS * FLICKER_SIGMA**2
    low, high = chi2.ppf([CHANCE, 1 - CHANCE], 3 * units) / (3 * units)
    assert (low * expected < variance).all() and (variance < high * expected).all()
