"""Truth against independent references: analytic sway, an ODE in SciPy, vehicles at rest, differences."""

from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from lone_vehicle import DEG, VEHICLES, history, plant
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from insenv.core.codegen import native_source
from insenv.core.runner import make_runner
from insenv.vehicles import truth_instant
from insenv.vehicles.truth import PLACES

OMEGA_IE = 7.292115e-5


SWAY = {  # amplitude (rad or m), period (s), phase (rad)
    "roll": (10 * DEG, 8.0, 0.3), "pitch": (5 * DEG, 6.0, 0.0), "yaw": (3 * DEG, 10.0, -0.4),
    "north": (0.5, 7.0, 0.0), "east": (0.5, 6.0, 1.1), "down": (1.0, 8.0, 0.0),
}  # fmt: skip
LEVER = np.array([3.0, -1.0, -2.0])
PLACE = {"start_latitude": 30 * DEG, "start_longitude": 114 * DEG, "start_height": 10.0, "start_heading": 30 * DEG}


def ship_parameters(**others: object) -> dict:
    values: dict = {**PLACE, "imu_lever_arm_b": LEVER, **others}
    for motion, (amplitude, period, phase) in SWAY.items():
        values |= {f"{motion}_amplitude": amplitude, f"{motion}_phase": phase}
        values[f"{motion}_angular_frequency"] = 2 * np.pi / period
    return values


def turned(angle: ca.SX, axis: int) -> ca.SX:
    K = ca.skew(np.eye(3)[axis])
    return np.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * K @ K


def sway(lever: np.ndarray) -> ca.Function:
    """t -> C_nb, omega_nb^b, velocity and acceleration of the IMU in n, by automatic differentiation."""
    t = ca.SX.sym("t")
    roll, pitch, yaw, *place = (amplitude * ca.sin(2 * np.pi / T * t + phase) for amplitude, T, phase in SWAY.values())
    C = turned(30 * DEG + yaw, 2) @ turned(pitch, 1) @ turned(roll, 0)
    rate = ca.inv_skew(C.T @ ca.reshape(ca.jacobian(ca.vec(C), t), 3, 3))
    moved = ca.vertcat(*place) + C @ lever
    velocity = ca.jacobian(moved, t)
    return ca.Function("sway", [t], [C, rate, velocity, ca.jacobian(velocity, t)])


def earth(latitude: float, height: float) -> tuple[float, float, np.ndarray]:
    """Radii of curvature (m) and normal gravity (m/s^2, NED): Groves 2013, Heiskanen and Moritz 1967.

    The north part by the law of a conservative field, d((R_M + h) g_N)/dh = -d(gamma)/dL, to second order in e^2 and h / a.
    """
    a, f, gm = 6378137.0, 1 / 298.257223563, 3.986004418e14
    e2, b, s2 = f * (2 - f), a * (1 - f), np.sin(latitude) ** 2
    R_N = a / np.sqrt(1 - e2 * s2)
    k = b * 9.8321849378 / (a * 9.7803253359) - 1
    m = OMEGA_IE**2 * a * a * b / gm
    g = 9.7803253359 * (1 + k * s2) / np.sqrt(1 - e2 * s2)
    down = g * (1 - 2 / a * (1 + f + m - 2 * f * s2) * height + 3 * (height / a) ** 2)
    x = height / a
    series = (2 * k + e2) / (1 - e2) - k * e2 / (1 - e2) * s2 + (4 * f - (2 * k + e2) * (2 + f + m)) * x
    north = -9.7803253359 * np.sin(latitude) * np.cos(latitude) * x * series
    return R_N * (1 - e2) / (1 - e2 * s2), R_N, np.array([north, 0.0, down])


def increments(t0: float, h: float, position: np.ndarray, law) -> np.ndarray:
    """Change of position (rad, rad, m) and the two increments by an ODE of order 8; law: as of `sway`."""
    R_M, R_N, _ = earth(position[0], position[2])
    metres = np.array([R_M + position[2], (R_N + position[2]) * np.cos(position[0]), -1.0])

    def derivative(t: float, y: np.ndarray) -> np.ndarray:
        latitude, _, height = position + y[:3] / metres
        R_M, R_N, g = earth(latitude, height)
        C, rate, v, a = law(t)
        ie = OMEGA_IE * np.array([np.cos(latitude), 0, -np.sin(latitude)])
        en = np.array([v[1] / (R_N + height), -v[0] / (R_M + height), -v[1] * np.tan(latitude) / (R_N + height)])
        force = a + np.cross(2 * ie + en, v) - g
        geodetic = np.array([v[0] / (R_M + height), v[1] / (R_N + height) / np.cos(latitude), -v[2]])
        return np.concatenate([geodetic * metres, rate + C.T @ (ie + en), C.T @ force])

    steps = np.linspace(t0, t0 + h, 5)
    y = np.zeros(9)
    for a, b in pairwise(steps):
        y = solve_ivp(derivative, (a, b), y, method="DOP853", rtol=1e-13, atol=1e-17).y[:, -1]
    y[:3] /= metres
    return y


def position_of(rows: dict, i: int) -> np.ndarray:
    return np.array([rows[name][i] for name in ("latitude", "longitude", "height")])


@pytest.mark.parametrize("rate", [50, 200])
def test_ship_increments_are_those_of_an_independent_integration(rate: int) -> None:
    h, motion = 1 / rate, sway(LEVER)
    rows = history("ship", ship_parameters(sample_interval=h), 25 * rate)
    for i in range(0, 25 * rate, 5 * rate + 7):
        expected = increments(i * h, h, position_of(rows, i), lambda t: [value.full().squeeze() for value in motion(t)])
        np.testing.assert_allclose(rows["true_delta_angle"][i + 1], expected[3:6], rtol=0, atol=2e-13 * h)
        np.testing.assert_allclose(rows["true_delta_velocity"][i + 1], expected[6:], rtol=0, atol=4e-13 * 10 * h)
        moved = position_of(rows, i + 1) - position_of(rows, i)
        np.testing.assert_allclose(moved * [6.4e6, 6.4e6, 1], expected[:3] * [6.4e6, 6.4e6, 1], rtol=0, atol=3e-9)


@pytest.mark.parametrize("name", ["ship", "car", "aircraft", "multirotor"])
@pytest.mark.parametrize("latitude", [-70.0, 0.0, 45.0])
def test_at_rest_increments_are_earth_rate_and_gravity(name: str, latitude: float) -> None:
    """The gravity is normal gravity plus the disturbance."""
    h, disturbance = 0.01, np.array([-3e-4, 2e-4, 5e-4])
    place = {"start_latitude": latitude * DEG, "start_height": 250.0, "start_heading": 40 * DEG}
    tilt = {"mean_roll": 2 * DEG, "mean_pitch": -3 * DEG}
    values = {**place, **tilt, "sample_interval": h, "imu_lever_arm_b": LEVER, "gravity_disturbance_n": disturbance}
    rows = history(name, values, 30)
    C = Rotation.from_euler("ZYX", [40.0, -3.0, 2.0], degrees=True).as_matrix()
    rate = C.T @ (OMEGA_IE * np.array([np.cos(latitude * DEG), 0, -np.sin(latitude * DEG)]))
    force = -C.T @ (earth(latitude * DEG, 250.0)[2] + disturbance)
    np.testing.assert_allclose(rows["true_delta_angle"][1:], np.tile(rate * h, (30, 1)), rtol=1e-13, atol=1e-21)
    np.testing.assert_allclose(rows["true_delta_velocity"][1:], np.tile(force * h, (30, 1)), rtol=1e-13, atol=1e-17)
    assert np.all(rows["latitude"] == latitude * DEG) and np.all(rows["height"] == 250.0)


@pytest.mark.parametrize("name", VEHICLES)
def test_derivative_is_that_of_the_flow_and_operations_are_exact(name: str) -> None:
    """Against the derivative of the polynomial through start, nodes and end of a short sample, from a random state."""
    h, model, vehicle, rng = 2e-4, plant(name), VEHICLES[name], np.random.default_rng(1)
    native_source(model)  # which refuses others
    values = {}
    for row in model.parameters:
        if row.name.endswith("_amplitude"):
            values[row.name] = rng.uniform(0.5, 1.0, row.shape)
        elif row.name.endswith("angular_frequency"):
            values[row.name] = rng.uniform(0.5, 3.0, row.shape)
    runner = make_runner(model, {"sample_interval": h, **values})
    state = runner.state
    p = model.parameters.symbols(ca.SX(ca.DM(runner.p)))
    moving = list(vehicle.derivative(p, vehicle.state.symbols(ca.SX.sym("x", vehicle.state.size))))
    phasor = ("_sine", "_cosine", "_half_weight")
    flat = [state[row.name].ravel() if row.name.endswith(phasor) else rng.uniform(0.1, 1.0, row.size) for row in vehicle.state]
    x = vehicle.state.symbols(ca.SX(ca.DM(np.concatenate(flat))))
    places = vehicle.along(p, x)
    assert all(set(rows) == set(moving) for rows in places)
    t = np.array([0.0, *PLACES])
    for name in moving:
        points = np.stack([np.array(ca.DM(getattr(x, name))).ravel()] + [np.array(ca.DM(r[name])).ravel() for r in places])
        fit = [np.polynomial.Polynomial.fit(t * h, points[:, k], 3, domain=[0, h]) for k in range(points.shape[1])]
        for place, rows in zip(PLACES, places, strict=True):
            at = SimpleNamespace(**{**vars(x), **rows})
            exact = np.array(ca.DM(vehicle.derivative(p, at)[name])).ravel()
            np.testing.assert_allclose([f.deriv()(place * h) for f in fit], exact, rtol=0, atol=1e-10)


FLIGHT = {"start_speed": 220.0, "start_height": 3e3, "start_latitude": 1.2, "start_heading": 1.0}


@pytest.mark.parametrize(("name", "start"), [("aircraft", FLIGHT), ("ship", ship_parameters())], ids=["aircraft", "ship"])
def test_instant_is_the_derivative_of_the_state(name: str, start: dict) -> None:
    """Acceleration: of the velocity in n. Rate over the Earth: of the attitude in n, and the transport rate. Its change."""
    h, now, model = 1e-3, 700, plant(name)
    values = start | {"sample_interval": h, "imu_lever_arm_b": np.array([8.0, -3.0, -5.0])}
    rows = history(name, values, now + 2)
    p = model.parameters.symbols(ca.SX(ca.DM(model.parameters.pack(values))))
    x = ca.SX.sym("x", model.state.size)
    function = ca.Function("instant", [x], list(truth_instant(VEHICLES[name])(p, model.state.symbols(x))))

    def instant(k: int) -> list:
        return [value.full().ravel() for value in function(model.state.pack({name: row[k] for name, row in rows.items()}))]

    (before, *_), (rate, change, acceleration), (after, *_) = map(instant, (now - 1, now, now + 1))
    step = (rows["velocity_n"][now + 1] - rows["velocity_n"][now - 1]) / (2 * h)
    np.testing.assert_allclose(acceleration, step, rtol=0, atol=2e-5 * (1 + np.abs(step).max()))
    latitude, height, (north, east, _) = rows["latitude"][now], rows["height"][now], rows["velocity_n"][now]
    R_M, R_N, _ = earth(latitude, height)
    transport = np.array([east / (R_N + height), -north / (R_M + height), -east * np.tan(latitude) / (R_N + height)])
    turn = [Rotation.from_quat(rows["q_nb"][k], scalar_first=True) for k in (now - 1, now, now + 1)]
    rate_nb = (turn[0].inv() * turn[2]).as_rotvec() / (2 * h)
    np.testing.assert_allclose(rate - rate_nb, turn[1].inv().apply(transport), rtol=0, atol=2e-6)
    # without the change of the transport rate in n, acceleration / R
    np.testing.assert_allclose(change, (after - before) / (2 * h), rtol=0, atol=2e-5)
