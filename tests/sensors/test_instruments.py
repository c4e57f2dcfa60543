"""Aiding instruments: each error against its stated parameter, with bounds that chance exceeds about once in 10^5."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from exactness import inexact_operations
from scipy.spatial.transform import Rotation
from scipy.stats import binom
from sensor_plant import CHANCE, assert_variance

from insenv.core import noise
from insenv.core.batch import make_batch
from insenv.core.compose import Part, merge
from insenv.core.model import SEED, STEP, Model, Step
from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.errors import InputError
from insenv.geodesy.magnetic import magnetic_field, world_magnetic_model
from insenv.instruments import INSTRUMENTS, TOLD
from insenv.scenario import build, load
from insenv.sensors import barometer, dvl, heading, magnetometer, odometer
from insenv.sensors.registry import registered

MODULES = {"barometer": barometer, "magnetometer": magnetometer, "odometer": odometer, "dvl": dvl, "heading": heading}
TRUTH = {
    "true_delta_velocity": (3,),
    "latitude": (),
    "longitude": (),
    "height": (),
    "velocity_n": (3,),
    "q_nb": (4,),
    "rate_eb_b": (3,),
}
DT = 0.01
LEVEL = {"latitude": 0.7, "longitude": 1.9, "height": 50.0, "q_nb": (1.0, 0.0, 0.0, 0.0)}
START = {"start_latitude": 0.7, "start_longitude": 1.9, "start_height": 50.0}
FIELD = (2.1e-5, 1e-6, 4.4e-5)


@cache
def plant(id: str) -> Model:
    """One instrument with the truth as inputs, which have the same names after `set_`."""
    given = Part(
        parameters=Table((SEED, Row("sample_interval", "s", start=DT), *(Row(n, n, start=v) for n, v in START.items()))),
        state=Table((STEP, *(Row(name, name, shape=shape) for name, shape in TRUTH.items()))),
        inputs=Table(tuple(Row(f"set_{name}", name, shape=shape) for name, shape in TRUTH.items())),
        steps={"sample": Step(lambda p, x, u: {name: getattr(u, f"set_{name}") for name in TRUTH})},
    )
    tick = Part(steps={"tick": Step(lambda p, x, u: {"step": x.step + 1})})
    equations = MODULES[id].EQUATIONS
    part = equations.sensor().part(lambda p, x: (x.rate_eb_b, 0 * x.rate_eb_b, 0 * x.rate_eb_b))
    outputs = equations.all_state
    return merge(id, id, [given, part, tick], outputs, lambda p, x: {n: getattr(x, n) for n in outputs.names})


def simulate(id: str, n: int, parameters: dict[str, Any], truth: dict[str, Any] | None = None) -> dict[str, Any]:
    """Simulate n samples; truth by row name, constant or with a leading axis of n. Returns outputs by row name, (n, ...)."""
    model = plant(id)
    inputs = np.zeros((n, model.inputs.size))
    for name, value in {**LEVEL, **(truth or {})}.items():
        value = np.asarray(value, dtype=float)
        inputs[:, model.inputs.slice(f"set_{name}")] = value.reshape(n, -1) if value.ndim > len(TRUTH[name]) else value
    outputs = make_runner(model, {f"{id}_interval": DT, **parameters}).run(n, inputs)
    assert np.isfinite(outputs).all()
    return model.outputs.unpack(outputs)


def starts(id: str, parameters: dict[str, Any], seeds: int) -> dict[str, Any]:
    """Start states of many seeds by row name, (seeds, ...)."""
    model = plant(id)
    r = np.array([noise.uniforms(s, 0, noise.START_STREAM, model.start_uniforms) for s in range(seeds)])
    return model.state.unpack(np.asarray(model.functions["start"](model.parameters.pack(parameters)[:, None], r.T)).T)


def assert_gauss_markov(samples: Any, sigma: float, time: float) -> None:
    """Assert variance and one-step correlation of processes sampled every DT, (n, k)."""
    samples = np.asarray(samples).reshape(len(samples), -1)
    decay = math.exp(-DT / time)
    freedom = samples.size * (1 - decay**2) / (1 + decay**2)  # independent samples with the same scatter of the mean square
    assert_variance(samples, sigma**2, freedom)
    # what is new in each step is white
    assert_variance(samples[1:] - decay * samples[:-1], sigma**2 * (1 - decay**2))


@pytest.mark.parametrize("id", MODULES)
def test_no_operation_differs_between_machines(id: str) -> None:
    functions = plant(id).functions
    assert {name: inexact_operations(f) for name, f in functions.items() if inexact_operations(f)} == {}


@pytest.mark.parametrize("id", MODULES)
def test_measurement_rows_are_those_that_are_declared(id: str) -> None:
    sensor, given = registered()[id].sensor, INSTRUMENTS[id]
    assert sensor.outputs == given.measurement.names
    table = MODULES[id].EQUATIONS.all_parameters
    told = sensor.told(table.unpack(table.start_vector()))
    assert set(told) == set(given.told.names)
    for name, value in told.items():
        TOLD[name].check(np.broadcast_to(np.asarray(value, dtype=float), TOLD[name].shape).ravel())


@pytest.mark.parametrize("id", MODULES)
def test_times(id: str) -> None:
    """The first measurement comes one interval after the start, each arrives after the latency, outages remove epochs."""
    rows = {f"{id}_interval": 0.1, f"{id}_latency": 0.03, f"{id}_outage_start": [0.35] + [0.0] * 15}
    rows[f"{id}_outage_end"] = [0.55] + [0.0] * 15
    y = simulate(id, 100, rows, {"height": np.arange(1.0, 101.0)})
    arrived = np.flatnonzero(y[f"{id}_new"]) + 1
    assert arrived.tolist() == [13, 23, 33, 63, 73, 83, 93]
    np.testing.assert_allclose(y[f"{id}_age"][arrived - 1], 0.03, atol=1e-12)
    if id == "barometer":
        np.testing.assert_array_equal(y["barometer_height"][arrived - 1], arrived - 3.0)
        np.testing.assert_array_equal(y["barometer_height_true"][arrived - 1], arrived - 3.0)
    without = simulate(id, 100, {f"{id}_interval": 0.1})
    assert (np.flatnonzero(without[f"{id}_new"]) + 1).tolist() == [10 * k for k in range(1, 11)]
    assert not without[f"{id}_age"].any()


# --- barometer -------------------------------------------------------------------------------------------


def test_barometer_white_noise_drift_and_allan_deviation() -> None:
    n, white, sigma, time = 200_000, 0.3, 0.5, 2.0
    y = simulate("barometer", n, {"barometer_noise": white, "barometer_drift_sigma": sigma, "barometer_drift_time": time})
    error = y["barometer_height"] - 50.0
    assert_gauss_markov(y["barometer_bias_true"], sigma, time)
    assert_variance(error - y["barometer_bias_true"], white**2)
    # Allan variance of averages over m samples: white noise white^2 / m; Gauss-Markov by the variance of its averages
    a = math.exp(-DT / time)
    for m in (1, 10, 100, 400):
        means = error[: n // m * m].reshape(-1, m).mean(axis=1)
        lags = np.arange(1, m)
        within = sigma**2 / m**2 * (m + 2 * np.sum((m - lags) * a**lags))
        pair = sigma**2 / m**2 * sum(a ** abs(i + m - j) for i in range(m) for j in range(m))
        expected = white**2 / m + within - pair
        found = 0.5 * np.mean(np.diff(means) ** 2)
        assert abs(found / expected - 1) < 4.5 * math.sqrt(3 / len(means)) + 0.01, m


def test_barometer_lag_of_a_ramp_is_the_closed_form() -> None:
    lag, rate, n = 0.4, 3.0, 500
    time = np.arange(1, n + 1) * DT
    y = simulate("barometer", n, {"barometer_lag": lag}, {"height": 50.0 + rate * time})
    behind = -rate * lag * (1 - np.exp(-time / lag))
    np.testing.assert_allclose(y["barometer_height"] - (50.0 + rate * time), behind, atol=1e-12)


def test_barometer_constants() -> None:
    x = starts("barometer", {"barometer_bias_sigma": 2.0, "barometer_scale_factor_sigma": 0.03, "barometer_bias": 1.0}, 4000)
    assert_variance(x["barometer_bias_true"] - 1.0, 4.0)
    assert_variance(x["barometer_scale_factor_true"], 0.03**2)
    assert abs(np.corrcoef(x["barometer_bias_true"], x["barometer_scale_factor_true"])[0, 1]) < 4.5 / math.sqrt(4000)
    rows = {"barometer_scale_factor": 0.0202, "barometer_speed_error": 0.5, "barometer_quantum": 0.25}
    y = simulate("barometer", 1, rows, {"height": 1050.0, "velocity_n": (30.0, 40.0, 0.0)})
    exact = 1050.0 + 0.0202 * 1000.0 - 0.5 * 2500.0 / (2 * 9.80665)
    assert 1006.25 + 0.2 < exact < 1006.5 and y["barometer_height"][0] == 1006.5


# --- magnetometer ----------------------------------------------------------------------------------------


def attitudes(n: int) -> Any:
    """Attitudes (n,) of all kinds."""
    return Rotation.random(n, random_state=5)


def scalar_first(rotation: Any) -> Any:
    return np.roll(rotation.as_quat(), 1, axis=-1)


def test_magnetometer_shows_the_field_in_body_axes() -> None:
    n = 50
    turned = attitudes(n)
    soft = np.array([[0.02, 0.01, -0.03], [0.0, -0.04, 0.02], [0.03, 0.0, 0.01]])
    hard, anomaly = np.array([1e-6, -2e-6, 3e-6]), np.array([1e-7, 2e-7, -3e-7])
    rows = {
        "magnetic_field_n": FIELD,
        "magnetometer_soft_iron": soft,
        "magnetometer_hard_iron": hard,
        "magnetic_anomaly_n": anomaly,
    }
    y = simulate("magnetometer", n, rows, {"q_nb": scalar_first(turned)})
    field_b = turned.inv().apply(np.array(FIELD) + anomaly)
    np.testing.assert_allclose(y["magnetometer_field_true"], field_b, rtol=0, atol=1e-19)
    np.testing.assert_allclose(y["magnetometer_field_b"], field_b + field_b @ soft.T + hard, rtol=0, atol=1e-19)


def test_magnetometer_noise_drift_and_constants() -> None:
    n = 40_000
    rows = {"magnetometer_noise": 3e-7, "magnetometer_drift_sigma": 2e-7, "magnetometer_drift_time": 1.0}
    y = simulate("magnetometer", n, rows)
    assert_gauss_markov(y["magnetometer_hard_iron_true"] * 1e7, 2.0, 1.0)
    assert_variance((y["magnetometer_field_b"] - y["magnetometer_hard_iron_true"]) * 1e7, 9.0)
    sigmas = {"magnetometer_hard_iron_sigma": (1.0, 2.0, 3.0), "magnetometer_soft_iron_sigma": 0.02}
    x = starts("magnetometer", {**sigmas, "magnetometer_coupling_sigma": 0.01, "magnetic_anomaly_sigma": (4.0, 5.0, 6.0)}, 3000)
    for axis in range(3):
        assert_variance(x["magnetometer_hard_iron_true"][:, axis], (axis + 1.0) ** 2)
        assert_variance(x["magnetic_anomaly_true"][:, axis], (axis + 4.0) ** 2)
    soft = x["magnetometer_soft_iron_true"]
    assert_variance(np.einsum("nii->ni", soft), 0.02**2)
    assert_variance(soft[:, ~np.eye(3, dtype=bool)], 0.01**2)
    coarse = simulate("magnetometer", 1, {"magnetic_field_n": FIELD, "magnetometer_quantum": 1e-6})
    np.testing.assert_allclose(coarse["magnetometer_field_b"][0], [21e-6, 1e-6, 44e-6], atol=1e-12)


def test_field_is_that_of_the_world_magnetic_model() -> None:
    """Where the model's report gives test values, and 100 km from the place of the gradient to 30 nT."""
    from pygeomag import GeoMag

    lat, lon, h = math.radians(48.0), math.radians(11.0), 500.0
    field, gradient = world_magnetic_model(lat, lon, h, 2026.0)
    exact = GeoMag().calculate(48.0, 11.0, 0.5, 2026.0)
    np.testing.assert_allclose(field, np.array([exact.x, exact.y, exact.z]) * 1e-9, rtol=1e-12)
    assert 2e-5 < np.hypot(*field[:2]) < 2.2e-5 and 4.2e-5 < field[2] < 4.6e-5
    for north, east, down in ((1e5, 0, 0), (0, 1e5, 0), (-7e4, 7e4, -2e3)):
        place = lat + north / 6.37e6, lon + east / (6.38e6 * math.cos(lat + north / 6.37e6)), h - down
        near = magnetic_field(ca.DM(field), ca.DM(gradient), *place, lat, lon, h).full().ravel()
        there = GeoMag().calculate(*(math.degrees(a) for a in place[:2]), place[2] / 1e3, 2026.0)
        assert np.abs(near * 1e9 - (there.x, there.y, there.z)).max() < 30.0
        assert np.abs(field * 1e9 - (there.x, there.y, there.z)).max() > 100.0
    for pole in (89.999, -89.999):  # 112 m from it, where the axes of n turn with every metre east
        near, gradient = world_magnetic_model(math.radians(pole), 0.3, 0.0, 2026.0)
        np.testing.assert_allclose(np.linalg.norm(gradient[:, 1]), np.hypot(*near[:2]) / 111.69, rtol=0.01)
    with pytest.raises(InputError, match="year = 1990: allowed is 2025 to 2030"):
        world_magnetic_model(lat, lon, h, 1990.0)


def test_gradient_agrees_with_the_models_own_differences() -> None:
    """At four places, one of them beside the pole, against a smaller step of the package itself."""
    from pygeomag import GeoMag

    model, step = GeoMag(), 0.01
    for lat, lon in ((10.0, 20.0), (-55.0, 179.99), (70.0, -100.0), (89.95, 10.0)):
        gradient = world_magnetic_model(math.radians(lat), math.radians(lon), 0.0, 2026.0)[1] * 1e12  # nT/km

        def at(dlat: float = 0.0, dlon: float = 0.0, dkm: float = 0.0, lat: float = lat, lon: float = lon) -> Any:
            f = model.calculate(lat + dlat, (lon + dlon + 180.0) % 360.0 - 180.0, dkm, 2026.0)
            return np.array([f.x, f.y, f.z])

        arc = math.radians(step) * 6371.0
        np.testing.assert_allclose(gradient[:, 0], (at(step) - at(-step)) / (2 * arc), rtol=0.02, atol=0.1)
        wide = math.cos(math.radians(lat)) * arc
        np.testing.assert_allclose(gradient[:, 1], (at(0, step) - at(0, -step)) / (2 * wide), rtol=0.02, atol=0.1)
        np.testing.assert_allclose(gradient[:, 2], (at(dkm=-1.0) - at(dkm=1.0)) / 2, rtol=0.02, atol=0.1)


# --- odometer --------------------------------------------------------------------------------------------


def test_odometer_shows_the_speed_of_its_point_along_its_axis() -> None:
    n = 40
    turned, rng = attitudes(n), np.random.default_rng(1)
    velocity, rate, arm = rng.normal(size=(n, 3)) * 10, rng.normal(size=(n, 3)), np.array([1.0, -2.0, 0.5])
    mounting, error = np.array([0.1, -0.2, 0.3]), np.array([0.01, 0.02, -0.03])
    rows = {"odometer_lever_arm_b": arm, "odometer_mounting": mounting, "odometer_mounting_error": error}
    y = simulate("odometer", n, rows, {"q_nb": scalar_first(turned), "velocity_n": velocity, "rate_eb_b": rate})
    axes = Rotation.from_rotvec(mounting) * Rotation.from_rotvec(error)  # takes v to b
    exact = axes.inv().apply(turned.inv().apply(velocity) + np.cross(rate, arm))[:, 0]
    np.testing.assert_allclose(y["odometer_speed"], exact, atol=1e-13)
    np.testing.assert_array_equal(y["odometer_speed_true"], y["odometer_speed"])


def test_odometer_scale_slip_and_quantum() -> None:
    truth = {"velocity_n": (20.0, 0.0, 0.0), "true_delta_velocity": (3.0 * DT, 0.0, -9.8 * DT)}
    rows = {"odometer_scale_factor": 0.01, "odometer_slip": 0.003}
    y = simulate("odometer", 1, rows, truth)
    np.testing.assert_allclose(y["odometer_speed"], 20.0 * (1 + 0.01 + 0.003 * 3.0), rtol=1e-14)
    shown = simulate("odometer", 1, {**rows, "odometer_quantum": 1 / 3.6}, truth)["odometer_speed"][0]
    np.testing.assert_allclose(shown * 3.6, round(20.38 * 3.6), atol=1e-12)
    assert_variance(simulate("odometer", 20_000, {"odometer_noise": 0.05}, truth)["odometer_speed"] - 20.0, 0.05**2)
    drawn = {
        "odometer_scale_factor_sigma": 0.01,
        "odometer_slip_sigma": 0.002,
        "odometer_mounting_error_sigma": (0.1, 0.2, 0.3),
    }
    x = starts("odometer", drawn, 3000)
    assert_variance(x["odometer_scale_factor_true"], 1e-4)
    assert_variance(x["odometer_slip_true"], 4e-6)
    for axis in range(3):
        assert_variance(x["odometer_mounting_error_true"][:, axis], (0.1 * (axis + 1)) ** 2)
    np.testing.assert_allclose(np.linalg.norm(x["odometer_axis"], axis=1), 1.0, atol=1e-14)


# --- Doppler log -----------------------------------------------------------------------------------------


def test_doppler_log() -> None:
    n = 40
    turned, rng = attitudes(n), np.random.default_rng(2)
    velocity, rate, arm = rng.normal(size=(n, 3)) * 5, rng.normal(size=(n, 3)) * 0.1, np.array([-10.0, 2.0, 4.0])
    error, current = np.array([0.01, -0.02, 0.05]), np.array([0.5, -0.3, 0.0])
    truth = {"q_nb": scalar_first(turned), "velocity_n": velocity, "rate_eb_b": rate}
    rows = {"dvl_lever_arm_b": arm, "dvl_misalignment": error, "dvl_scale_factor": 0.005, "dvl_current_n": current}
    for water in (0.0, 1.0):
        y = simulate("dvl", n, {**rows, "dvl_water_track": water}, truth)
        exact = turned.inv().apply(velocity - water * current) + np.cross(rate, arm)
        np.testing.assert_allclose(y["dvl_velocity_b"], 1.005 * Rotation.from_rotvec(error).inv().apply(exact), atol=1e-13)
        np.testing.assert_allclose(y["dvl_velocity_true"], turned.inv().apply(velocity) + np.cross(rate, arm), atol=1e-13)


def test_doppler_log_noise_and_current() -> None:
    rows = {"dvl_noise": 0.02, "dvl_current_sigma": 0.3, "dvl_current_time": 1.5, "dvl_water_track": 1.0}
    y = simulate("dvl", 60_000, rows)
    assert_gauss_markov(y["dvl_current_true"][:, :2], 0.3, 1.5)
    assert not y["dvl_current_true"][:, 2].any()
    assert_variance(y["dvl_velocity_b"] + y["dvl_current_true"], 0.02**2)
    x = starts("dvl", {"dvl_scale_factor_sigma": 0.005, "dvl_misalignment_sigma": (0.01, 0.02, 0.03)}, 3000)
    assert_variance(x["dvl_scale_factor_true"], 0.005**2)
    for axis in range(3):
        assert_variance(x["dvl_misalignment_true"][:, axis], (0.01 * (axis + 1)) ** 2)
    told = dvl.EQUATIONS.told({**dvl.PARAMETERS.unpack(dvl.PARAMETERS.pack(rows)), "dvl_water_track": 0.0})
    assert told["dvl_current_sigma"] == 0.0, "a log that tracks the ground has no current"


# --- two antennas ----------------------------------------------------------------------------------------


def test_two_antenna_heading() -> None:
    n = 60
    turned, baseline, error = attitudes(n), np.array([0.6, -0.8, 0.1]), np.array([0.01, 0.0, -0.02])
    rows = {"heading_baseline_b": baseline, "heading_baseline_error": error}
    y = simulate("heading", n, rows, {"q_nb": scalar_first(turned)})
    exact = turned.apply(baseline + error)
    np.testing.assert_allclose(y["heading_baseline_n"], exact, atol=1e-14)
    np.testing.assert_allclose(y["heading_azimuth"], np.arctan2(exact[:, 1], exact[:, 0]), atol=1e-14)
    np.testing.assert_array_equal(y["heading_azimuth"], y["heading_azimuth_true"])


def test_two_antenna_heading_states_its_scatter() -> None:
    """The azimuth scatters as reported; the noise of north and east differs, and so does its effect."""
    rows = {
        "heading_baseline_noise": (0.004, 0.012, 0.02),
        "heading_wander_sigma": (0.003, 0.001, 0.0),
        "heading_wander_time": 0.05,
    }
    for angle in (0.0, 0.7, math.pi / 2):
        half = 0.5 * angle
        y = simulate("heading", 40_000, rows, {"q_nb": (math.cos(half), 0.0, 0.0, math.sin(half))})
        variance = ((0.012**2 + 1e-6) * math.cos(angle) ** 2) + ((0.004**2 + 9e-6) * math.sin(angle) ** 2)
        assert_variance(y["heading_azimuth"] - angle, variance, 40_000 / 12)  # correlated over 10 samples
        np.testing.assert_allclose(np.mean(y["heading_azimuth_sigma"]), math.sqrt(variance), rtol=0.01)
    assert_gauss_markov(y["heading_wander"][:, 0], 0.003, 0.05)


def test_a_vertical_baseline_has_a_finite_azimuth_of_no_worth() -> None:
    y = simulate("heading", 10, {"heading_baseline_b": (0.0, 0.0, -1.0), "heading_baseline_noise": (0.01,) * 3})
    assert np.isfinite(y["heading_azimuth"]).all() and (y["heading_azimuth_sigma"] > 0.3).all()


def test_length_check_drops_wrong_ambiguities() -> None:
    """Of displacements of length s from a baseline of length L, uniform in direction, the check keeps those with |d| in
    L -+ t: cos between (( L - t)^2 - L^2 - s^2) / (2 L s) and that with + t."""
    n, length, size, tolerance = 20_000, 1.0, 0.19, 0.05
    rows = {"heading_outlier_probability": 1.0, "heading_outlier_size": size, "heading_length_tolerance": tolerance}
    kept = int(simulate("heading", n, rows)["heading_new"].sum())
    low, high = (((length + side * tolerance) ** 2 - length**2 - size**2) / (2 * length * size) for side in (-1, 1))
    share = (min(high, 1.0) - max(low, -1.0)) / 2
    assert binom.ppf(CHANCE / 2, n, share) <= kept <= binom.ppf(1 - CHANCE / 2, n, share)
    assert simulate("heading", 100, {**rows, "heading_length_tolerance": 0.0})["heading_new"].all()


# --- receiver, whole plants --------------------------------------------------------------------------------


LEGS = [{"accelerate_to_mps": 15.0}, {"turn_deg": 90.0, "radius_m": 40.0}, {"drive_s": 60.0}]


def scenario(**changes: Any) -> Any:
    """A car that drives with all instruments, and a receiver that delivers late."""
    values = {
        "title": "Car", "duration_s": 60.0, "rate_hz": 100.0, "seed": 4,
        "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "heading_deg": 30.0},
        "vehicle": {"kind": "car", "legs": LEGS},
        "imu": {"grade": "tactical"},
        "gnss": {"grade": "rtk", "latency_s": 0.2, "lever_arm_m": [1.0, 0.0, -1.0]},
    }  # fmt: skip
    return load({**values, **changes})


EVERY = {id: {} for id in MODULES}


def outputs(given: Any, seed: int | None = None, backend: str | None = None) -> dict[str, Any]:
    made = build(given, seed=seed)
    runner = make_runner(made.model, made.parameters, backend)
    return made.model.outputs.unpack(runner.run(made.samples))


def test_instruments_change_no_number_of_the_others() -> None:
    alone, among = outputs(scenario()), outputs(scenario(**EVERY))
    for name, value in alone.items():
        np.testing.assert_array_equal(among[name], value, err_msg=name)
    for id in MODULES:
        assert among[f"{id}_new"].sum() > 50 and np.ptp(among[INSTRUMENTS[id].values[0]]) > 0


def test_interpreter_and_native_agree_with_all_instruments() -> None:
    given = scenario(**EVERY)
    one, two = outputs(given, backend="interpreter"), outputs(given, backend="native")
    for name, value in one.items():
        np.testing.assert_array_equal(two[name], value, err_msg=name)


@pytest.mark.slow
def test_rows_of_a_batch_are_the_single_runs() -> None:
    """With all instruments, and a lever arm and a delay that each seed draws, to the bit."""
    given = scenario(
        **EVERY, duration_s=8.0, gnss={"grade": "rtk", "latency_s": 0.4, "delay_sigma_s": 0.1, "lever_arm_sigma_m": 0.3}
    )
    made = build(given)
    batch = make_batch(made.model, 9, {**made.parameters, "seed": 20}, lanes=8, backend="native")
    shown = batch.run(made.samples, every=1)
    for row in (0, 3, 8):
        alone = build(given, seed=20 + row)
        np.testing.assert_array_equal(shown[row], make_runner(alone.model, alone.parameters).run(alone.samples))


def test_lever_arm_and_delay_differ_from_what_is_told() -> None:
    """The fix is that of the actual antenna at the actual time: what is told of both is the rest."""
    receiver = {"grade": "perfect", "latency_s": 0.2, "lever_arm_m": [1.0, 0.0, -1.0]}
    wrong = {**receiver, "lever_arm_error_m": [0.3, -0.2, 0.1], "delay_error_s": 0.137}
    told, true = outputs(scenario(gnss=receiver)), outputs(scenario(gnss=wrong))
    at = np.flatnonzero(true["gnss_valid"])
    np.testing.assert_allclose(true["gnss_delay_true"], 0.137, atol=1e-12)
    np.testing.assert_allclose(true["antenna_lever_arm_true"][0], [1.3, -0.2, -0.9])
    # the epoch is a whole second less the part of a sample; the age says 0.137 s less than it was
    np.testing.assert_allclose(true["gnss_age"][at], 0.2, atol=1e-9)
    np.testing.assert_allclose(
        (at + 1) * 0.01 - true["gnss_age"][at] - 0.137, np.round((at + 1) * 0.01 - 0.34) - 0.007, atol=1e-9
    )
    # independently: the truth, interpolated at that time by cubics of position and velocity
    from insenv import attitude, geodesy

    for k in at[5:50:7]:
        epoch = (k + 1) * 0.01 - 0.337
        below = int(epoch / 0.01 + 1e-9) - 1
        share = epoch / 0.01 - 1 - below
        place = [
            geodesy.numeric.geodetic_from_ned_offset(
                attitude.numeric.rotate(true["q_nb"][j], true["antenna_lever_arm_true"][j]),
                *(true[name][j] for name in ("latitude", "longitude", "height")),
            )
            for j in (below, below + 1)
        ]
        fix = [true[f"gnss_{name}"][k] for name in ("latitude", "longitude", "height")]
        there = (1 - share) * np.array(place[0]) + share * np.array(place[1])
        assert np.linalg.norm(geodesy.numeric.ned_offset(*fix, *there)) < 1e-3
    np.testing.assert_array_equal(told["gnss_delay_true"], 0.0)
    np.testing.assert_array_equal(told["antenna_lever_arm_true"][0], [1.0, 0.0, -1.0])


def test_drawn_lever_arm_and_delay() -> None:
    given = scenario(gnss={"grade": "rtk", "latency_s": 0.4, "lever_arm_sigma_m": [0.1, 0.2, 0.3], "delay_sigma_s": 0.05})
    made = build(given)
    model = made.model
    r = np.array([noise.uniforms(s, 0, noise.START_STREAM, model.start_uniforms) for s in range(2000)])
    p = model.parameters.pack(made.parameters)[:, None]
    x = model.state.unpack(np.asarray(model.functions["start"](p, r.T)).T)
    assert_variance(x["gnss_delay_true"], 0.05**2)
    np.testing.assert_allclose(x["gnss_latency_true"] + x["gnss_epoch_offset_true"], 0.4 + x["gnss_delay_true"], atol=1e-12)
    assert (x["gnss_epoch_offset_true"] >= 0.0).all() and (x["gnss_epoch_offset_true"] < 0.01).all()
    for axis in range(3):
        assert_variance(x["antenna_lever_arm_true"][:, axis], (0.1 * (axis + 1)) ** 2)
    told = made.knowledge.rows
    np.testing.assert_allclose(told["antenna_lever_arm_sigma"], [0.1, 0.2, 0.3])
    assert told["gnss_delay_sigma"] == 0.05
    assert "cut" not in "".join(given.notes)


def test_no_fix_is_from_the_future_and_one_is_pending() -> None:
    """A stated delay beyond that is refused; a drawn one is cut, and a note says so."""
    receiver = {"grade": "rtk", "latency_s": 0.1, "interval_s": 0.2}
    for wrong in (-0.11, 0.1, 0.2, 100.0):
        with pytest.raises(InputError, match=rf"delay_error_s = {wrong:g} s: allowed is from -0\.1 to 0\.09 s where latency_s"):
            build(scenario(gnss={**receiver, "delay_error_s": wrong}))
    for delay in (-0.1, 0.09):
        found = outputs(scenario(gnss={**receiver, "delay_error_s": delay}))
        np.testing.assert_allclose(found["gnss_delay_true"][0], delay, atol=1e-12)
    drawn = scenario(gnss={**receiver, "delay_sigma_s": 10.0})
    assert any("gnss.delay_sigma_s = 10 s: drawn delays are cut to -0.1 to 0.09 s" in note for note in drawn.notes)
    delays = [outputs(drawn, seed=seed)["gnss_delay_true"][0] for seed in range(6)]
    np.testing.assert_allclose(sorted({round(float(delay), 9) for delay in delays}), [-0.1, 0.09])


def test_knowledge_has_what_is_told() -> None:
    rows = build(
        scenario(magnetometer={"year": 2027.0}, odometer={"lever_arm_m": [0.0, 0.8, 1.0], "mounting_deg": [0, 0, 2]})
    ).knowledge.rows
    np.testing.assert_allclose(rows["odometer_lever_arm_b"], [0.0, 0.8, 1.0])
    np.testing.assert_allclose(rows["odometer_mounting"], [0, 0, math.radians(2)])
    assert rows["odometer_scale_factor_sigma"] == pytest.approx(0.01)
    assert rows["odometer_noise"] == pytest.approx(math.hypot(0.05, 0.01 / math.sqrt(12)))
    exact = world_magnetic_model(math.radians(48.0), math.radians(11.0), 500.0, 2027.0)
    np.testing.assert_array_equal(rows["magnetic_field_n"], exact[0])
    np.testing.assert_array_equal(rows["magnetic_field_gradient"], exact[1])
    assert rows["barometer_noise"] == 0.0 and rows["dvl_current_time"] == 600.0, "no such instrument: the start values"


@pytest.mark.parametrize("id", MODULES)
def test_every_figure_of_a_grade_is_a_key_and_has_a_source(id: str) -> None:
    section = registered()[id]
    assert "perfect" in section.grades and not section.grades["perfect"].figures
    for grade in section.grades.values():
        assert all(name in section.model_fields and grade.source(name) for name in grade.figures)
        section(grade=grade.name).rows(100.0)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        (
            {"barometer": {"interval_s": 0.0333}},
            r"barometer\.interval_s = 0\.0333 s: allowed is a whole number of samples of 0\.01 s",
        ),
        ({"odometer": {"latency_s": 0.2}}, r"odometer\.latency_s = 0\.2 s: allowed is less than odometer\.interval_s = 0\.1 s"),
        ({"magnetometer": {"grade": "rm310"}}, r"magnetometer\.grade = 'rm310'.*'rm310': unknown; did you mean 'rm3100'"),
        ({"magnetometer": {"year": 2050.0}}, r"magnetometer\.year = 2050: allowed is 2025 to 2030"),
        ({"heading": {"baseline_m": [0, 0, 0]}}, r"heading\.baseline_m = \[0, 0, 0\] m: allowed is a baseline with a length"),
        ({"dvl": {"outages_s": [[5.0, 2.0]]}}, r"dvl\.outages_s.*the outage from 5 s to 2 s must begin at 0 or later"),
        ({"barometer": {"noise_m": -1.0}}, r"barometer\.noise_m = -1"),
        ({"odometer": {"wheel": 1}}, r"odometer\.wheel.*unknown key"),
    ],
)
def test_wrong_values(section: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        scenario(**section)
