"""Sensors: each error against its stated parameter, with bounds that chance exceeds about once in 10^5."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from exactness import inexact_operations
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2

from insenv.core import noise
from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.errors import InputError
from insenv.files.toml import validated
from insenv.scenario import load
from insenv.scenario.description import scenario_class
from insenv.sensors import GNSS_GRADES, IMU_GRADES, flicker, gnss_grade, imu_grade, units
from insenv.sensors.gnss import GNSS_PARAMETERS, GNSS_STATE, gnss_part
from insenv.sensors.gnss_section import GnssSection
from insenv.sensors.imu import imu_part
from insenv.sensors.imu_tables import IMU_PARAMETERS, IMU_STATE
from insenv.sensors.thermal import without_thermal_errors

CHANCE = 1e-5
TRUTH = {
    "true_delta_angle": (3,),
    "true_delta_velocity": (3,),
    "latitude": (),
    "longitude": (),
    "height": (),
    "velocity_n": (3,),
    "acceleration_n": (3,),
    "q_nb": (4,),
    "rate_eb_b": (3,),
    "rate_change_b": (3,),
}
LEVEL = {"latitude": 0.7, "longitude": 1.9, "height": 50.0, "q_nb": (1.0, 0.0, 0.0, 0.0)}


@cache
def plant() -> Model:
    """The two sensors with the truth as inputs, which have the same names after `set_`."""
    given = Part(
        parameters=Table((SEED, Row("sample_interval", "Length of a sample", "s", start=0.005))),
        state=Table((STEP, *(Row(name, name, shape=shape) for name, shape in TRUTH.items()))),
        inputs=Table(tuple(Row(f"set_{name}", name, shape=shape) for name, shape in TRUTH.items())),
        steps={"sample": Step(lambda p, x, u: {name: getattr(u, f"set_{name}") for name in TRUTH})},
    )
    tick = Part(steps={"tick": Step(lambda p, x, u: {"step": x.step + 1})})
    outputs = IMU_STATE + GNSS_STATE
    parts = [given, imu_part(), gnss_part(lambda p, x: (x.rate_eb_b, x.rate_change_b, x.acceleration_n)), tick]
    return merge("sensors", "Sensors", parts, outputs, lambda p, x: {n: getattr(x, n) for n in outputs.names})


def simulate(n: int, parameters: dict[str, Any], truth: dict[str, Any] | None = None, backend: str | None = None):
    """Simulate n samples; truth by row name, constant or with a leading axis of n. Returns outputs by row name, (n, ...)."""
    model = plant()
    rows = {"gnss_interval": 1e9, **parameters}
    inputs = np.zeros((n, model.inputs.size))
    for name, value in {**LEVEL, **(truth or {})}.items():
        value = np.asarray(value, dtype=float)
        inputs[:, model.inputs.slice(f"set_{name}")] = value.reshape(n, -1) if value.ndim > len(TRUTH[name]) else value
    outputs = make_runner(model, rows, backend).run(n, inputs)
    assert np.isfinite(outputs).all()
    return model.outputs.unpack(outputs)


def starts(parameters: dict[str, Any], seeds: int) -> dict[str, Any]:
    """Start states of many seeds by row name, (seeds, ...)."""
    model = plant()
    r = np.array([noise.uniforms(s, 0, noise.START_STREAM, model.start_uniforms) for s in range(seeds)])
    p = model.parameters.pack(parameters)
    return model.state.unpack(np.asarray(model.functions["start"](p[:, None], r.T)).T)


def assert_variance(samples: Any, variance: float, freedom: float | None = None) -> None:
    """Assert that the mean square of zero-mean samples is within chi-square bounds (`freedom`: by default all samples)."""
    samples = np.ravel(samples)
    freedom = freedom or samples.size
    ratio = float(np.mean(samples**2)) / variance
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], freedom) / freedom
    assert low < ratio < high, (ratio, low, high)


def assert_mean(samples: Any, mean: float, std: float) -> None:
    """Assert that the mean of independent samples is within 4.5 of its standard deviations."""
    samples = np.ravel(samples)
    assert abs(samples.mean() - mean) < 4.5 * std / math.sqrt(samples.size)


# --- the models ------------------------------------------------------------------------------------------


def test_no_operation_differs_between_machines() -> None:
    assert {name: inexact_operations(f) for name, f in plant().functions.items() if inexact_operations(f)} == {}


def test_steps_uniforms_and_order_of_rows() -> None:
    model = plant()
    assert list(model.steps) == ["sample", "drift", "gnss", "gnss_delivery", "tick"]
    assert {name: step.uniforms for name, step in model.steps.items()} == {
        "sample": 7, "drift": 42, "gnss": 13, "gnss_delivery": 0, "tick": 0
    }  # fmt: skip
    assert IMU_STATE.names[:3] == ("delta_angle", "delta_velocity", "imu_valid")
    assert GNSS_STATE.names[:6] == (
        *("gnss_valid", "gnss_velocity_valid"),
        *("gnss_latitude", "gnss_longitude", "gnss_height", "gnss_velocity_n"),
    )  # fmt: skip
    assert len({*IMU_PARAMETERS.names, *IMU_STATE.names, *GNSS_PARAMETERS.names, *GNSS_STATE.names}) == len(
        IMU_PARAMETERS.names + IMU_STATE.names + GNSS_PARAMETERS.names + GNSS_STATE.names
    ), "an FMU has one name space"


def all_errors() -> dict[str, Any]:
    """Every error at once, and large."""
    rows: dict[str, Any] = {}
    for name, scale in (("gyro", 1e-3), ("accel", 1e-1)):
        for row in (
            "bias",
            "bias_sigma",
            "instability_sigma",
            "rate_random_walk",
            "temperature_slope",
            "scale_factor_slope",
        ):
            rows[f"{name}_{row}"] = scale
        for row in ("scale_factor", "scale_factor_sigma", "misalignment", "misalignment_sigma"):
            rows[f"{name}_{row}"] = 0.05
        rows |= {
            f"{name}_instability_time": 0.5,
            f"{name}_quantum": scale * 1e-3,
            f"{name}_range": scale * 1e3,
        }
    rows |= {"angle_random_walk": 1e-3, "velocity_random_walk": 1e-1}
    rows |= {"gyro_g_sensitivity": 1e-4, "q_bs": (0.5, 0.5, 0.5, 0.5), "mounting_error_sigma": 0.3}
    rows |= {"imu_drop_probability": 0.1, "drift_interval": 0.1, "imu_temperature_initial": 250.0}
    rows |= {
        "imu_temperature_time": 3.0,
        "gnss_interval": 0.05,
        "gnss_latency": 0.02,
        "gnss_epoch_offset": 0.003,
    }
    rows |= {"antenna_lever_arm_b": (1.0, -2.0, 0.5), "gnss_position_noise": 1.0, "gnss_velocity_noise": 0.1}
    rows |= {"gnss_wander_sigma": 2.0, "gnss_outlier_probability": 0.1, "gnss_outlier_size": 100.0, "seed": 7}
    return rows


def test_all_errors_at_once_are_finite_and_the_same_on_both_runners() -> None:
    rng = np.random.default_rng(1)
    truth = {"true_delta_angle": rng.normal(size=(400, 3)), "true_delta_velocity": rng.normal(size=(400, 3))}
    native, interpreter = (simulate(400, all_errors(), truth, backend) for backend in (None, "interpreter"))
    for name, value in native.items():
        assert np.array_equal(value, interpreter[name]), name


# --- inertial measurement unit ---------------------------------------------------------------------------


def test_the_output_of_a_perfect_imu_is_the_truth_to_the_last_bit() -> None:
    rng = np.random.default_rng(2)
    angle, velocity = rng.normal(size=(2, 300, 3)) * 1e-2
    out = simulate(300, imu_grade("perfect").parameters(), {"true_delta_angle": angle, "true_delta_velocity": velocity})
    assert np.array_equal(out["delta_angle"], angle)
    assert np.array_equal(out["delta_velocity"], velocity)
    assert out["imu_valid"].all() and not out["gyro_bias_true"].any() and not out["accel_bias_true"].any()


def test_white_noise_has_the_stated_density_and_is_white() -> None:
    n, dt = 20000, 0.01
    density = {"angle_random_walk": (1e-4, 2e-4, 3e-4), "velocity_random_walk": (1e-3, 2e-3, 3e-3)}
    out = simulate(n, {**density, "sample_interval": dt, "seed": 3})
    both = np.hstack([out["delta_angle"], out["delta_velocity"]])
    for i, one in enumerate((*density["angle_random_walk"], *density["velocity_random_walk"])):
        assert_variance(both[:, i], one**2 * dt)
        # Allan variance at 1 s: density^2 / tau; degrees of freedom of neighbouring clusters, white noise
        clusters = both[:, i].reshape(-1, 100).sum(axis=1) / 1.0
        m = clusters.size
        assert_variance(np.diff(clusters) / math.sqrt(2.0), one**2, 2.0 * (m - 1) ** 2 / (3 * m - 4))
    z = both / both.std(axis=0)
    bound = 4.5 / math.sqrt(n)
    assert np.abs(np.corrcoef(z.T) - np.eye(6)).max() < bound
    assert max(abs(np.mean(z[1:, i] * z[:-1, i])) for i in range(6)) < bound
    assert np.abs(z.mean(axis=0)).max() < bound


def test_white_noise_can_be_written_as_a_standard_deviation_per_sample() -> None:
    dt, std = 0.005, 2e-5
    density = units.density_from_sample_std(std, dt)
    assert density == pytest.approx(std * math.sqrt(dt), rel=1e-15)
    out = simulate(20000, {"angle_random_walk": density, "sample_interval": dt})
    assert_variance(out["delta_angle"] / dt, std**2)


def test_gauss_markov_bias_has_its_variance_and_correlation() -> None:
    n, every, sigma, time = 40000, 5, 2e-6, 4.0
    rows = {"sample_interval": 0.2, "gyro_instability_sigma": sigma, "gyro_instability_time": time, "seed": 5}
    bias = simulate(n, rows)["gyro_bias_true"]
    knots = bias[::every]
    decay = math.exp(-1.0 / time)
    m = knots.size
    # variance of the mean of squares of an AR(1) process: as of m (1 - a^2) / (1 + a^2) independent ones
    assert_variance(knots, sigma**2, m * (1 - decay**2) / (1 + decay**2))
    innovation = knots[1:] - decay * knots[:-1]
    assert_variance(innovation, sigma**2 * (1 - decay**2))
    for lag in (1, 2, 4, 8):
        correlation = np.mean(knots[lag:] * knots[:-lag]) / np.mean(knots**2)
        assert abs(correlation - decay**lag) < 4.5 * math.sqrt((1 + decay**2) / (1 - decay**2) / m)
    # linear in between
    between = knots[:-1, None, :] + np.arange(every)[:, None] / every * np.diff(knots, axis=0)[:, None, :]
    assert np.allclose(bias[: len(between) * every], between.reshape(-1, 3), rtol=0, atol=1e-12 * sigma * every * 10)


def test_rate_random_walk_has_its_density() -> None:
    n, dt, density = 30000, 0.1, 1e-6
    rows = {"sample_interval": dt, "accel_rate_random_walk": density, "drift_interval": 4.0, "seed": 6}
    bias = simulate(n, rows)["accel_bias_true"]
    steps = np.diff(bias[::40], axis=0)
    assert_variance(steps, density**2 * 4.0)
    # Allan variance at 100 s: density^2 tau / 3 (IEEE Std 952); overlapping clusters, few degrees of freedom
    clusters = bias[: 30000 // 1000 * 1000].reshape(-1, 1000, 3).mean(axis=1)
    assert_variance(np.diff(clusters, axis=0) / math.sqrt(2.0), density**2 * 100.0 / 3.0, 0.5 * 3 * len(clusters))


def test_what_is_drawn_at_the_start_over_seeds() -> None:
    rows = {"gyro_bias": 1e-6, "gyro_bias_sigma": (1e-6, 2e-6, 3e-6), "accel_bias_sigma": 1e-3}
    rows |= {"gyro_scale_factor": 1e-4, "gyro_scale_factor_sigma": 2e-4, "accel_misalignment": 3e-4}
    rows |= {
        "accel_misalignment_sigma": 1e-4,
        "gyro_instability_sigma": 5e-7,
        "gnss_wander_sigma": (1.0, 2.0, 3.0),
    }
    x = starts(rows, 1500)
    for i in range(3):
        assert_mean(x["gyro_bias_turn_on"][:, i], 1e-6, (i + 1) * 1e-6)
        assert_variance(x["gyro_bias_turn_on"][:, i] - 1e-6, ((i + 1) * 1e-6) ** 2)
        assert_variance(x["gnss_wander"][:, i], (i + 1.0) ** 2)
    assert_variance(x["accel_bias_true"], 1e-6)
    assert_variance(x["gyro_instability"], 25e-14)
    assert np.allclose(x["gyro_bias_true"], x["gyro_bias_turn_on"] + x["gyro_instability"], rtol=0, atol=1e-20)
    scale = np.diagonal(x["gyro_error_matrix"], axis1=1, axis2=2) - 1.0
    assert_mean(scale, 1e-4, 2e-4)
    assert_variance(scale - 1e-4, 4e-8)
    couplings = x["accel_error_matrix"][:, ~np.eye(3, dtype=bool)]
    assert_mean(couplings, 3e-4, 1e-4)
    assert_variance(couplings - 3e-4, 1e-8)
    assert not (x["gyro_error_matrix"][:, ~np.eye(3, dtype=bool)]).any()
    draws = np.column_stack([x["gyro_bias_turn_on"], x["accel_bias_true"], scale, couplings])
    assert np.abs(np.corrcoef(draws.T) - np.eye(15)).max() < 5.0 / math.sqrt(1500)


def test_scale_misalignment_mounting_and_g_sensitivity_against_matrices() -> None:
    C_bs = Rotation.from_rotvec([0.3, -1.2, 2.0])
    error = Rotation.from_rotvec([0.02, -0.01, 0.03])
    x, y, z, w = C_bs.as_quat()
    coupling, G = np.arange(1, 7) * 1e-3, np.arange(9).reshape(3, 3) * 1e-4
    rows = {"q_bs": (w, x, y, z), "mounting_error": error.as_rotvec(), "gyro_g_sensitivity": G}
    rows |= {
        "gyro_scale_factor": (1e-3, 2e-3, 3e-3),
        "gyro_misalignment": coupling,
        "gyro_bias": (1e-3, 0.0, -2e-3),
    }
    angle, velocity, dt = np.array([0.01, -0.02, 0.03]), np.array([0.5, 0.1, -0.05]), 0.005
    out = simulate(3, rows, {"true_delta_angle": angle, "true_delta_velocity": velocity})
    M = np.array([[1.001, 1e-3, 2e-3], [3e-3, 1.002, 4e-3], [5e-3, 6e-3, 1.003]])
    to_sensor = (C_bs * error).inv()
    sensed = M @ to_sensor.apply(angle) + np.array([1e-3, 0.0, -2e-3]) * dt + G @ C_bs.inv().apply(velocity)
    assert np.allclose(out["delta_angle"], C_bs.apply(sensed), rtol=0, atol=1e-16)
    assert np.allclose(out["gyro_bias_true"], C_bs.apply([1e-3, 0.0, -2e-3]), rtol=0, atol=1e-18)
    # the accelerometers share the mounting; only its error is visible, because the nominal mounting is undone
    assert np.allclose(out["delta_velocity"], (C_bs * to_sensor).apply(velocity), rtol=0, atol=1e-15)


def test_quantisation_loses_nothing() -> None:
    rng = np.random.default_rng(8)
    angle, velocity = rng.normal(size=(2, 2000, 3)) * 1e-5
    q = {"gyro_quantum": 3e-5, "accel_quantum": 7e-6}
    out = simulate(2000, q, {"true_delta_angle": angle, "true_delta_velocity": velocity})
    for true, measured, quantum in (
        (angle, out["delta_angle"], 3e-5),
        (velocity, out["delta_velocity"], 7e-6),
    ):
        counts = measured / quantum
        assert np.allclose(counts, np.round(counts), rtol=0, atol=1e-9)
        lag = np.cumsum(true, axis=0) - np.cumsum(measured, axis=0)
        assert np.abs(lag).max() <= 0.5 * quantum * (1 + 1e-9)
        assert len(np.unique(counts.round())) > 2


def test_saturation_stops_at_full_scale() -> None:
    dt = 0.01
    rows = {"gyro_range": 2.0, "accel_range": 30.0, "sample_interval": dt}
    rates, forces = np.array([[1.9, -5.0, 2.1]]), np.array([[-31.0, 29.0, 500.0]])
    out = simulate(1, rows, {"true_delta_angle": rates * dt, "true_delta_velocity": forces * dt})
    assert np.allclose(out["delta_angle"] / dt, [[1.9, -2.0, 2.0]], rtol=1e-15)
    assert np.allclose(out["delta_velocity"] / dt, [[-30.0, 29.0, 30.0]], rtol=1e-15)


def test_temperature_warms_up_and_drags_the_bias_along() -> None:
    dt, n, time = 0.1, 1200, 30.0
    rows = {"sample_interval": dt, "imu_temperature_initial": 280.0, "imu_temperature_final": 320.0}
    rows |= {"imu_temperature_time": time, "imu_temperature_reference": 300.0, "gyro_temperature_slope": 2e-7}
    out = simulate(n, rows)
    t = np.arange(n) * dt  # the first sample has the start value
    exact = 320.0 - 40.0 * np.exp(-t / time)
    assert np.allclose(out["imu_temperature"][::10], exact[::10], rtol=0, atol=1e-10)
    assert np.abs(out["imu_temperature"] - exact).max() < 40.0 / time**2 * 1.0**2 / 8.0 * 1.01
    for i in range(3):
        assert np.allclose(out["gyro_bias_true"][:, i], 2e-7 * (out["imu_temperature"] - 300.0), rtol=0, atol=1e-18)


def test_a_ramp_moves_the_temperature_and_the_warm_up_ends_on_it() -> None:
    dt, n, time, ramp = 0.1, 1200, 30.0, 0.02
    rows = {"sample_interval": dt, "imu_temperature_initial": 280.0, "imu_temperature_final": 320.0}
    rows |= {"imu_temperature_time": time, "imu_temperature_ramp": ramp}
    t = np.arange(n) * dt
    exact = 320.0 + ramp * t - 40.0 * np.exp(-t / time)
    assert np.allclose(simulate(n, rows)["imu_temperature"][::10], exact[::10], rtol=0, atol=1e-10)


def test_the_scale_factor_follows_the_temperature_on_each_axis() -> None:
    dt, n = 0.1, 1200
    rows = {"sample_interval": dt, "imu_temperature_initial": 280.0, "imu_temperature_final": 320.0}
    rows |= {"imu_temperature_time": 30.0, "imu_temperature_reference": 300.0}
    rows |= {"gyro_scale_factor_slope": (1e-5, -2e-5, 3e-5), "accel_scale_factor_slope": (-4e-5, 5e-5, 0.0)}
    rows |= {"q_bs": (np.cos(0.4), np.sin(0.4), 0.0, 0.0)}  # the slopes belong to the sensor's axes
    angle, velocity = np.array([1e-3, 2e-3, -3e-3]), np.array([0.1, -0.2, -0.98])
    out = simulate(n, rows, {"true_delta_angle": angle, "true_delta_velocity": velocity})
    C_bs = Rotation.from_euler("x", 0.8).as_matrix()
    warmth = out["imu_temperature"] - 300.0
    for name, true in (("gyro", angle), ("accel", velocity)):
        factors = 1.0 + warmth[:, None] * np.array(rows[f"{name}_scale_factor_slope"])
        measured = out["delta_angle" if name == "gyro" else "delta_velocity"]
        assert np.allclose(measured, (factors * (C_bs.T @ true)) @ C_bs.T, rtol=0, atol=1e-15)


def test_a_calibration_takes_off_what_the_temperature_adds() -> None:
    rows = {"sample_interval": 0.01, "imu_temperature_initial": 280.0, "imu_temperature_final": 330.0}
    rows |= {"imu_temperature_time": 5.0, "imu_temperature_ramp": 0.1, "imu_temperature_reference": 300.0}
    rows |= {"gyro_scale_factor_slope": (1e-5, -2e-5, 3e-5), "gyro_temperature_slope": (1e-6, 2e-6, -3e-6)}
    angle = np.array([1e-3, 2e-3, -3e-3])
    out = simulate(1200, rows, {"true_delta_angle": angle})
    slopes = np.array(rows["gyro_temperature_slope"]), np.array(rows["gyro_scale_factor_slope"])
    clean = without_thermal_errors(out["delta_angle"], np.full(1200, 0.01), out["imu_temperature"] - 300.0, *slopes)
    assert np.abs(out["delta_angle"] - angle).max() > 5e-7
    assert np.allclose(clean, angle, rtol=0, atol=1e-17)


def test_dropped_samples_are_marked_empty_and_a_function_of_the_seed() -> None:
    n, probability = 20000, 0.03
    truth = {"true_delta_angle": (1e-3, 2e-3, 3e-3), "true_delta_velocity": (0.0, 0.0, -0.05)}
    out = simulate(n, {"imu_drop_probability": probability, "seed": 4}, truth)
    lost = out["imu_valid"] == 0.0
    low, high = binom.ppf([CHANCE / 2, 1 - CHANCE / 2], n, probability)
    assert low <= lost.sum() <= high
    assert not out["delta_angle"][lost].any() and not out["delta_velocity"][lost].any()
    assert (out["delta_angle"][~lost] == [1e-3, 2e-3, 3e-3]).all()
    again = simulate(n, {"imu_drop_probability": probability, "seed": 4}, truth)["imu_valid"]
    assert np.array_equal(again, out["imu_valid"])
    other = simulate(n, {"imu_drop_probability": probability, "seed": 5}, truth)["imu_valid"]
    assert not np.array_equal(other, out["imu_valid"])


# --- GNSS receiver ---------------------------------------------------------------------------------------

A, E2 = 6378137.0, (2.0 - 1.0 / 298.257223563) / 298.257223563


def ecef(latitude: Any, longitude: Any, height: Any) -> Any:
    N = A / np.sqrt(1.0 - E2 * np.sin(latitude) ** 2)
    p = (N + height) * np.cos(latitude)
    z = (N * (1.0 - E2) + height) * np.sin(latitude)
    return np.stack([p * np.cos(longitude), p * np.sin(longitude), z], axis=-1)


def ned(out: dict[str, Any], fixes: Any = slice(None)) -> Any:
    """Fixes in metres north, east, down of the IMU position LEVEL."""
    lat, lon = LEVEL["latitude"], LEVEL["longitude"]
    s, c, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    C_ne = np.array([[-s * cl, -s * sl, c], [-sl, cl, 0.0], [-c * cl, -c * sl, -s]])
    r = ecef(out["gnss_latitude"][fixes], out["gnss_longitude"][fixes], out["gnss_height"][fixes])
    return (r - ecef(lat, lon, LEVEL["height"])) @ C_ne.T


def test_fixes_come_at_their_rate_late_and_once() -> None:
    dt, n = 0.1, 105
    height = np.arange(1, n + 1) * dt  # encodes the time of measurement
    for latency in (0.0, 0.1, 0.3, 0.9):
        rows = {"sample_interval": dt, "gnss_interval": 1.0, "gnss_latency": latency}
        out = simulate(n, rows, {"height": height})
        arrivals = np.flatnonzero(out["gnss_valid"]) + 1
        expected = [k for k in (10 * (i + 1) + round(latency / dt) for i in range(10)) if k <= n]
        assert arrivals.tolist() == expected
        fixes = arrivals - 1
        assert np.allclose(out["gnss_age"][fixes], latency, rtol=0, atol=1e-12)
        assert np.allclose(out["gnss_height"][fixes], arrivals * dt - latency, rtol=0, atol=1e-7)
        assert np.array_equal(out["gnss_velocity_valid"], out["gnss_valid"])
        # a fix is invisible before it is delivered
        changes = np.flatnonzero(np.diff(out["gnss_height"])) + 2
        assert set(changes) <= set(arrivals)
    without = simulate(n, {"sample_interval": dt, "gnss_interval": 1.0, "gnss_has_velocity": 0.0})
    assert without["gnss_valid"].sum() == 10 and not without["gnss_velocity_valid"].any()


def test_lever_arm_and_an_epoch_between_samples() -> None:
    arm, rate = np.array([1.5, -0.7, -2.0]), np.array([0.3, -0.2, 0.5])
    velocity, acceleration, tau = np.array([20.0, -5.0, 1.0]), np.array([1.0, 2.0, -0.5]), 0.004
    change = np.array([0.1, -0.15, 0.1])  # rad/s^2: 1.5 mm/s in tau
    attitude = Rotation.from_rotvec([0.4, -0.2, 1.1])
    x, y, z, w = attitude.as_quat()
    truth = {"q_nb": (w, x, y, z), "rate_eb_b": rate, "rate_change_b": change, "velocity_n": velocity}
    truth["acceleration_n"] = acceleration

    def antenna(t: float) -> Any:
        turned = attitude * Rotation.from_rotvec(rate * t + change * (t * t / 2))
        return velocity * t + 0.5 * acceleration * t**2 + turned.apply(arm)

    for offset in (0.0, tau):
        rows = {"gnss_interval": 0.05, "antenna_lever_arm_b": arm, "gnss_epoch_offset": offset}
        out = simulate(10, rows, truth)
        assert out["gnss_age"][9] == offset
        assert np.allclose(ned(out)[9], antenna(-offset), rtol=0, atol=2e-8)
        h = 1e-3
        slope = (antenna(h - offset) - antenna(-h - offset)) / (2 * h)
        assert np.allclose(out["gnss_velocity_n"][9], slope, rtol=0, atol=1e-5)


def test_gnss_noise_wander_and_reported_sigmas() -> None:
    n, white, wander, time = 12000, np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0]), 0.5
    rows = {"sample_interval": 0.1, "gnss_interval": 0.1, "gnss_velocity_noise": (0.1, 0.2, 0.3), "seed": 9}
    out = simulate(n, {**rows, "gnss_position_noise": white})
    errors = ned(out)
    for i in range(3):
        assert_variance(errors[:, i], white[i] ** 2)
        assert_variance(out["gnss_velocity_n"][:, i], (0.1 * (i + 1)) ** 2)
    assert np.abs(np.corrcoef(errors.T) - np.eye(3)).max() < 4.5 / math.sqrt(n)
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 4.5 / math.sqrt(n)
    assert np.allclose(out["gnss_position_sigma"][-1], white) and np.allclose(out["gnss_velocity_sigma"][-1, 0], 0.1)

    out = simulate(n, {**rows, "gnss_wander_sigma": wander, "gnss_wander_time": time})
    errors, decay = ned(out), math.exp(-0.1 / time)
    for i in range(3):
        assert_variance(errors[:, i], wander[i] ** 2, n * (1 - decay**2) / (1 + decay**2))
        assert_variance(errors[1:, i] - decay * errors[:-1, i], wander[i] ** 2 * (1 - decay**2))
    perfect = simulate(10, {"sample_interval": 0.1, "gnss_interval": 0.1})
    assert (perfect["gnss_position_sigma"] > 0).all() and (perfect["gnss_velocity_sigma"] > 0).all()


def test_outliers_are_as_many_and_as_large_as_stated() -> None:
    n, probability, size = 8000, 0.05, 40.0
    rows = {"sample_interval": 0.1, "gnss_interval": 0.1, "seed": 10}
    out = simulate(n, {**rows, "gnss_outlier_probability": probability, "gnss_outlier_size": size})
    errors = ned(out)
    length = np.linalg.norm(errors, axis=1)
    wrong = length > 1.0
    low, high = binom.ppf([CHANCE / 2, 1 - CHANCE / 2], n, probability)
    assert low <= wrong.sum() <= high
    assert np.allclose(length[wrong], size, rtol=1e-6)
    assert length[~wrong].max() < 1e-6
    for i in range(3):  # uniform over the sphere: each component of variance 1/3
        assert_mean(errors[wrong, i] / size, 0.0, 3**-0.5)


def test_outage_windows_take_the_epochs_inside_them() -> None:
    start, end = np.zeros(16), np.zeros(16)
    start[:2], end[:2] = (3.0, 7.0), (5.0, 7.5)
    start[15], end[15] = 9.0, 11.0
    rows = {"sample_interval": 0.1, "gnss_interval": 0.5, "gnss_outage_start": start, "gnss_outage_end": end}
    for latency in (0.0, 0.4):
        arrivals = np.flatnonzero(simulate(140, {**rows, "gnss_latency": latency})["gnss_valid"]) + 1
        epochs = np.round(arrivals * 0.1 - latency, 6)
        lost = {3.0, 3.5, 4.0, 4.5, 7.0, 9.0, 9.5, 10.0, 10.5}
        expected = [t for t in np.arange(1, 28) * 0.5 if t not in lost]
        assert epochs.tolist()[: len(expected)] == expected
    # the epoch counts, not the sample: half a sample earlier it precedes the windows
    early = simulate(140, {**rows, "gnss_epoch_offset": 0.05})
    times = (np.flatnonzero(early["gnss_valid"]) + 1) * 0.1
    assert 3.0 in np.round(times, 6) and 5.0 not in np.round(times, 6)


def _receiver(interval: float, latency: float, offset: float) -> GnssSection:
    return GnssSection.model_construct(interval_s=interval, latency_s=latency, epoch_offset_s=offset)


@pytest.mark.parametrize(
    ("rate_hz", "times", "field"),
    [
        (200.0, (1.0, 1.0, 0.0), "gnss.latency_s"),
        (200.0, (1.0, 0.0033, 0.0), "gnss.latency_s"),
        (200.0, (0.0, 0.0, 0.0), "gnss.interval_s"),
        (200.0, (1.0, 0.1, 0.005), "gnss.epoch_offset_s"),
        (100.0 / 3.0, (1.0, 0.0, 0.0), "gnss.interval_s"),
    ],
)
def test_timing_that_cannot_be_is_refused(rate_hz: float, times: tuple[float, float, float], field: str) -> None:
    with pytest.raises(InputError, match=field):
        _receiver(*times).rows(rate_hz)


def test_timing_that_can_be_is_not() -> None:
    assert _receiver(1.0, 0.995, 0.0049).rows(200.0)["gnss_latency"] == 0.995
    assert _receiver(0.2, 0.0, 0.0).rows(400.0)["gnss_interval"] == 0.2


# --- grades, units ---------------------------------------------------------------------------------


def test_units_against_hand_calculation() -> None:
    assert units.deg_h_to_rad_s(1.0) == pytest.approx(4.84813681109536e-6, rel=1e-14)
    assert units.deg_sqrt_h_to_rad_sqrt_s(1.0) == pytest.approx(2.908882086657216e-4, rel=1e-14)
    assert units.deg_h_sqrt_h_to_rad_s_sqrt_s(60.0) == pytest.approx(units.deg_h_to_rad_s(1.0), rel=1e-14)
    assert units.ug_to_m_s2(1e6) == pytest.approx(9.80665, rel=1e-15)
    assert units.m_s_sqrt_h_to_m_s_sqrt_s(60.0) == pytest.approx(1.0, rel=1e-15)
    assert units.deg_h_g_to_rad_s_per_m_s2(9.80665) == pytest.approx(4.84813681109536e-6, rel=1e-14)
    assert units.mgal_to_m_s2(1e5) == 1.0 and units.deg_c_to_k(20.0) == pytest.approx(293.15)
    assert units.rad_s_to_deg_h(units.deg_h_to_rad_s(3.0)) == pytest.approx(3.0)
    assert units.arcsec_to_rad(3600.0) == units.deg_to_rad(1.0)
    assert units.one_sigma_from_cep(1.1774100225154747) == pytest.approx(1.0, rel=1e-15)


def test_every_grade_fits_the_tables_and_every_figure_has_a_source() -> None:
    for grade in IMU_GRADES.values():
        IMU_PARAMETERS.pack(grade.parameters())
        for figure in grade.figures():
            assert grade.source(figure), (grade.name, figure)
        assert set(grade.sources) <= {
            "",
            *grade.figures(),
            "gyro_instability_time_s",
            "accel_instability_time_s",
        }
    for receiver in GNSS_GRADES.values():
        GNSS_PARAMETERS.pack(receiver.parameters())
        assert receiver.source or receiver.name == "perfect"


def test_grades_in_si() -> None:
    paper = imu_grade("paper-quaternion").parameters()
    # 0.01 deg/h and 50 ug per sample at 200 Hz
    assert paper["angle_random_walk"] / math.sqrt(0.005) == pytest.approx(4.848e-8, rel=1e-4)
    assert paper["velocity_random_walk"] / math.sqrt(0.005) == pytest.approx(4.903e-4, rel=1e-3)
    assert paper["gyro_bias"] == pytest.approx([4.848e-8, 4.848e-8, -4.848e-8], rel=1e-4)
    assert IMU_PARAMETERS.pack(imu_grade("perfect").parameters()) == pytest.approx(IMU_PARAMETERS.start_vector())
    assert imu_grade("paper-ecef").parameters()["accel_bias"] == pytest.approx(2e-4, rel=1e-14)
    assert imu_grade("leador").parameters()["accel_instability_sigma"] == pytest.approx(15e-5, rel=1e-14)
    assert imu_grade("leador").parameters()["velocity_random_walk"] == pytest.approx(0.03 / 60.0)
    assert imu_grade("navigation").parameters()["velocity_random_walk"] == pytest.approx(20 * 9.80665e-6)
    assert gnss_grade("centimetre").parameters()["gnss_position_noise"].tolist() == [0.01, 0.01, 0.02]


def test_an_unknown_grade_suggests_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'tactical'"):
        imu_grade("tactial")
    with pytest.raises(InputError, match="did you mean 'rtk'"):
        gnss_grade("rtkk")


# --- flicker noise ---------------------------------------------------------------------------------


def allan_deviation(rate: Any, times: Any) -> Any:
    """Overlapping Allan deviation (IEEE Std 952, annex C) of rates at intervals of 1 s, (n, axes), at whole `times` (s)."""
    angle = np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(rate, axis=0)])
    found = []
    for m in times:
        second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
        found.append(np.sqrt((second**2).mean(axis=0) / (2.0 * m * m)))
    return np.array(found)


def allan_of_the_processes(time: Any) -> Any:
    """Allan deviation of the sum of Gauss-Markov processes of floor 1, in closed form."""
    total = 0.0
    for T in flicker.TIMES:
        u = time / T
        total = total + 2 * flicker.SIGMA**2 / u * (1 - (3 - 4 * np.exp(-u) + np.exp(-2 * u)) / (2 * u))
    return np.sqrt(total)


def test_flicker_noise_is_nearly_flat_from_ten_seconds_to_half_a_day() -> None:
    time = np.logspace(1, np.log10(5e4), 200)
    assert 0.92 < allan_of_the_processes(time).min() < allan_of_the_processes(time).max() < 1.01


def test_flicker_noise_has_the_floor_that_is_asked_for() -> None:
    """The Allan deviation of 3 axes of both triads over 55 hours, 4 units, and after white noise has averaged out."""
    n, floor = 200_000, {"gyro_flicker": (1e-7, 2e-7, 4e-7), "accel_flicker": (1e-4, 2e-4, 5e-5)}
    times = np.array([10, 30, 100, 300, 1000, 3000])
    ratios = []
    for seed in range(4):
        out = simulate(n, {"sample_interval": 1.0, "drift_interval": 1.0, "seed": seed, **floor})
        for output, name in (("delta_angle", "gyro_flicker"), ("delta_velocity", "accel_flicker")):
            ratios.append(allan_deviation(out[output], times) / np.array(floor[name]))
    mean = np.sqrt(np.mean(np.square(np.concatenate(ratios, axis=1)), axis=1))
    # 24 axes of n / (2 time) independent differences each
    bound = 5.0 / np.sqrt(24 * n / times)
    assert (np.abs(mean / allan_of_the_processes(times) - 1.0) < bound + 0.01).all(), mean
    assert (np.abs(mean - 1.0) < 0.1).all(), mean


def test_flicker_noise_is_stationary_from_the_first_sample_on() -> None:
    """Over 400 units: the variance of the bias after the first sample, after a minute and after an hour is the same."""
    floor = np.array([1e-7, 2e-7, 3e-7])
    biases = []
    for seed in range(400):
        out = simulate(40, {"sample_interval": 1.0, "drift_interval": 1.0, "seed": seed, "gyro_flicker": floor})
        biases.append(out["gyro_bias_true"][[0, 1, 39]] / floor)
    variance = np.mean(np.square(biases), axis=(0, 2))
    expected = flicker.PARTS * flicker.SIGMA**2
    low, high = chi2.ppf([CHANCE, 1 - CHANCE], 1200) / 1200
    assert (low * expected < variance).all() and (variance < high * expected).all()


def test_without_flicker_noise_nothing_changes() -> None:
    rows = {"sample_interval": 1.0, "gyro_instability_sigma": 1e-7, "gyro_rate_random_walk": 1e-9, "seed": 3}
    out = simulate(50, rows)
    other = simulate(50, {**rows, "accel_flicker": 1e-4})
    assert np.array_equal(out["delta_angle"], other["delta_angle"])
    assert not out["gyro_flicker_parts"].any() and other["accel_flicker_parts"].any()


@pytest.mark.parametrize(
    ("section", "key", "limit"),
    [
        ("imu", "gyro_temperature_slope_deg_h_k", 1e4),
        ("imu", "accel_temperature_slope_ug_k", 1e5),
        ("imu", "gyro_scale_factor_slope_ppm_k", 1e3),
        ("imu", "accel_scale_factor_slope_ppm_k", 1e3),
        ("imu", "gyro_scale_factor_sigma_ppm", 1e6),
        ("imu", "gyro_g_sensitivity_deg_h_g", 1e6),
        ("odometer", "slip_percent_s2_m", 100.0),
        ("odometer", "scale_factor_percent", 100.0),
        ("dvl", "misalignment_deg", 180.0),
        ("heading", "outlier_probability", 1.0),
    ],
)
def test_no_unit_has_an_error_without_bounds(section: str, key: str, limit: float) -> None:
    values = load("car-city-drive").model_dump(mode="json", exclude_none=True)
    values[section] = {**(values.get(section) or {}), key: limit}
    validated(scenario_class(), values, "s")
    values[section][key] = 1.01 * limit
    with pytest.raises(InputError, match=f"{section}.{key} = "):
        validated(scenario_class(), values, "s")
