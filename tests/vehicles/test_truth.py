"""Truth against independent references: analytic sway, an ODE in SciPy, vehicles at rest and in a circle."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from exactness import inexact_operations
from lone_vehicle import DEG, history, plant
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from insenv.core.runner import make_runner
from insenv.core.tables import Row, Table
from insenv.vehicles import Vehicle, aircraft, car, multirotor, regular_sway, ship, truth_instant

OMEGA_IE = 7.292115e-5


# --- the same sway in NumPy -----------------------------------------------------------------------------------------------

SWAY = {  # amplitude (rad or m), period (s), phase (rad)
    "roll": (10 * DEG, 8.0, 0.3),
    "pitch": (5 * DEG, 6.0, 0.0),
    "yaw": (3 * DEG, 10.0, -0.4),
    "north": (0.5, 7.0, 0.0),
    "east": (0.5, 6.0, 1.1),
    "down": (1.0, 8.0, 0.0),
}
LEVER = np.array([3.0, -1.0, -2.0])
PLACE = {"start_latitude": 30 * DEG, "start_longitude": 114 * DEG, "start_height": 10.0, "start_heading": 30 * DEG}


def ship_parameters(**others: object) -> dict:
    values: dict = {**PLACE, "imu_lever_arm_b": LEVER, **others}
    for motion, (amplitude, period, phase) in SWAY.items():
        values |= {f"{motion}_amplitude": amplitude, f"{motion}_phase": phase}
        values[f"{motion}_angular_frequency"] = 2 * np.pi / period
    return values


def motion(name: str, t: float, derivative: int = 0) -> float:
    amplitude, period, phase = SWAY[name]
    w = 2 * np.pi / period
    return amplitude * w**derivative * np.sin(w * t + phase + derivative * np.pi / 2)


def attitude(t: float) -> np.ndarray:
    return Rotation.from_euler("ZYX", [30 * DEG + motion("yaw", t), motion("pitch", t), motion("roll", t)]).as_matrix()


def body_rate(t: float) -> tuple[np.ndarray, np.ndarray]:
    """omega_nb^b and its derivative."""
    (r, p, _), (dr, dp, dy), (ddr, ddp, ddy) = ([motion(n, t, d) for n in ("roll", "pitch", "yaw")] for d in range(3))
    sr, cr, sp, cp = np.sin(r), np.cos(r), np.sin(p), np.cos(p)
    rate = np.array([dr - dy * sp, dp * cr + dy * cp * sr, dy * cp * cr - dp * sr])
    change = np.array([
        ddr - ddy * sp - dy * cp * dp,
        ddp * cr - dp * sr * dr + ddy * cp * sr - dy * sp * dp * sr + dy * cp * cr * dr,
        ddy * cp * cr - dy * sp * dp * cr - dy * cp * sr * dr - ddp * sr - dp * cr * dr,
    ])  # fmt: skip
    return rate, change


def imu_motion(t: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration of the IMU in n."""
    rate, change = body_rate(t)
    v, a = (np.array([motion(n, t, d) for n in ("north", "east", "down")]) for d in (1, 2))
    C = attitude(t)
    return v + C @ np.cross(rate, LEVER), a + C @ (np.cross(change, LEVER) + np.cross(rate, np.cross(rate, LEVER)))


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
    """Change of position (m, north east down of the start) and the two increments by an ODE of order 8.

    law(t) -> C_nb, omega_nb^b, velocity, acceleration, all of the IMU and in n but for the rate.
    """
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


def sway_law(t: float) -> tuple:
    return attitude(t), body_rate(t)[0], *imu_motion(t)


def position_of(rows: dict, i: int) -> np.ndarray:
    return np.array([rows["latitude"][i], rows["longitude"][i], rows["height"][i]])


@pytest.mark.parametrize("rate", [50, 200])
def test_ship_increments_are_those_of_an_independent_integration(rate: int) -> None:
    h = 1 / rate
    rows = history(ship(), ship_parameters(sample_interval=h), 30 * rate)
    for i in range(0, 30 * rate, 3 * rate + 7):
        expected = increments(i * h, h, position_of(rows, i), sway_law)
        np.testing.assert_allclose(rows["true_delta_angle"][i + 1], expected[3:6], rtol=0, atol=2e-13 * h)
        np.testing.assert_allclose(rows["true_delta_velocity"][i + 1], expected[6:], rtol=0, atol=4e-13 * 10 * h)
        moved = position_of(rows, i + 1) - position_of(rows, i)
        np.testing.assert_allclose(moved * [6.4e6, 6.4e6, 1], expected[:3] * [6.4e6, 6.4e6, 1], rtol=0, atol=3e-9)


def test_ship_pose_over_ten_minutes_is_the_closed_form() -> None:
    every, h = 500, 0.005
    rows = history(ship(), ship_parameters(imu_lever_arm_b=[0, 0, 0], start_latitude=0.0), 120_000, every)
    times = np.arange(241) * every * h
    for i, t in enumerate(times):
        error = Rotation.from_matrix(attitude(t)).inv() * Rotation.from_quat(rows["q_nb"][i], scalar_first=True)
        assert np.abs(error.as_rotvec()).max() < 1e-11
    for axis, name in enumerate(("north", "east", "down")):
        moved = np.array([motion(name, t) - motion(name, 0.0) for t in times])
        speed = np.array([motion(name, t, 1) for t in times])
        np.testing.assert_allclose(rows["velocity_n"][:, axis], speed, rtol=0, atol=1e-11)
        R_M, R_N, _ = earth(0.0, 10.0)
        shown = {
            "north": (rows["latitude"] - rows["latitude"][0]) * (R_M + 10.0),
            "east": (rows["longitude"] - rows["longitude"][0]) * (R_N + 10.0),
            "down": rows["height"][0] - rows["height"],
        }[name]
        np.testing.assert_allclose(shown, moved, rtol=0, atol=1e-6)


def test_instant_rows_are_those_of_the_closed_form() -> None:
    model = plant(ship())
    instant = truth_instant(ship())
    names = ("rate_eb_b", "rate_change_b", "acceleration_n")
    shown = Table((*model.state, *(Row(name, "", shape=(3,)) for name in names)))

    def output(p, x):
        return {**vars(x), **dict(zip(names, instant(p, x), strict=True))}

    runner = make_runner(replace(model, outputs=shown, output=output), ship_parameters())
    first = runner.output()
    rows = shown.unpack(np.vstack([first, runner.run(2000, every=50)]))
    for i in range(41):
        velocity, acceleration = imu_motion(i * 0.25)
        np.testing.assert_allclose(rows["velocity_n"][i], velocity, rtol=0, atol=1e-12)
        np.testing.assert_allclose(rows["acceleration_n"][i], acceleration, rtol=0, atol=1e-12)
        R_M, R_N, _ = earth(rows["latitude"][i], rows["height"][i])
        north, east = velocity[0] / (R_M + rows["height"][i]), velocity[1] / (R_N + rows["height"][i])
        transport = attitude(i * 0.25).T @ [east, -north, -east * np.tan(rows["latitude"][i])]
        rate, change = body_rate(i * 0.25)
        np.testing.assert_allclose(rows["rate_eb_b"][i], rate + transport, rtol=0, atol=1e-14)
        # without the change of the transport rate in n, acceleration / R
        np.testing.assert_allclose(rows["rate_change_b"][i], change - np.cross(rate, transport), rtol=0, atol=1e-13)


# --- at rest, and in a circle ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [ship, car, aircraft, multirotor])
@pytest.mark.parametrize("latitude", [-70.0, 0.0, 45.0])
def test_at_rest_increments_are_earth_rate_and_gravity(make, latitude: float) -> None:
    h = 0.01
    place = {"start_latitude": latitude * DEG, "start_height": 250.0, "start_heading": 40 * DEG}
    tilt = {"mean_roll": 2 * DEG, "mean_pitch": -3 * DEG}
    rows = history(make(), {**place, **tilt, "sample_interval": h, "imu_lever_arm_b": LEVER}, 100)
    C = Rotation.from_euler("ZYX", [40.0, -3.0, 2.0], degrees=True).as_matrix()
    rate = C.T @ (OMEGA_IE * np.array([np.cos(latitude * DEG), 0, -np.sin(latitude * DEG)]))
    force = -C.T @ earth(latitude * DEG, 250.0)[2]
    np.testing.assert_allclose(rows["true_delta_angle"][1:], np.tile(rate * h, (100, 1)), rtol=1e-13, atol=1e-21)
    np.testing.assert_allclose(rows["true_delta_velocity"][1:], np.tile(force * h, (100, 1)), rtol=1e-13, atol=1e-17)
    assert np.all(rows["latitude"] == latitude * DEG) and np.all(rows["height"] == 250.0)


def test_car_in_a_circle_feels_the_centripetal_force() -> None:
    speed, yaw_rate, h = 12.0, 0.25, 0.01
    segment = np.zeros((64, 8))
    segment[0] = [100, speed, 2, yaw_rate, 0, 0, 0, 0]
    stiff = {"roll_per_acceleration": 0.0, "pitch_per_acceleration": 0.0, "engine_roll_amplitude": 0.0}
    rows = history(car(), {"start_speed": speed, "segments": segment, "sample_interval": h, **stiff}, 3000)
    late = slice(2000, None)
    np.testing.assert_allclose(rows["true_delta_velocity"][late, 1] / h, yaw_rate * speed, atol=4 * OMEGA_IE * speed)
    np.testing.assert_allclose(rows["true_delta_angle"][late, 2] / h, yaw_rate, atol=2 * OMEGA_IE)
    R_M, R_N, _ = earth(0.0, 0.0)
    north, east = rows["latitude"][late] * R_M, rows["longitude"][late] * R_N
    centre_n = north - speed / yaw_rate * np.sin(rows["path_heading"][late])
    centre_e = east + speed / yaw_rate * np.cos(rows["path_heading"][late])
    assert np.ptp(centre_n) < 1e-6 and np.ptp(centre_e) < 1e-6


def test_lever_arm_force_in_a_circle() -> None:
    """Two IMUs on one body: forces differ by omega x (omega x l) in steady rotation."""
    segment = np.zeros((64, 8))
    segment[0] = [100, 10.0, 2, 0.3, 0, 0, 0, 0]
    forces = []
    for lever in ([0, 0, 0], [2.0, 0.5, 0]):
        parameters = {"start_speed": 10.0, "segments": segment, "imu_lever_arm_b": lever, "roll_per_acceleration": 0.0}
        forces.append(history(car(), {**parameters, "pitch_per_acceleration": 0.0}, 6000)["true_delta_velocity"][-1] / 0.005)
    omega = np.array([0, 0, 0.3])
    np.testing.assert_allclose(
        forces[1] - forces[0], np.cross(omega, np.cross(omega, [2, 0.5, 0])), atol=3 * OMEGA_IE * 0.3 * 2.1
    )


def test_fast_level_flight_is_that_of_an_independent_integration() -> None:
    """Curvature, transport rate and gravity at 80 m/s and the lowest rate, integrated over two seconds."""
    h, heading = 0.02, 0.7
    place = {"start_latitude": 1.1, "start_height": 6000.0, "start_heading": heading, "start_speed": 80.0}
    rows = history(aircraft(), {**place, "sample_interval": h}, 100)
    C = Rotation.from_euler("ZYX", [heading, 0.035, 0.0]).as_matrix()
    velocity = 80.0 * np.array([np.cos(heading), np.sin(heading), 0.0])
    expected = increments(0.0, 2.0, position_of(rows, 0), lambda t: (C, np.zeros(3), velocity, np.zeros(3)))
    moved = position_of(rows, 100) - position_of(rows, 0)
    np.testing.assert_allclose(moved * [6.4e6, 6.4e6, 1], expected[:3] * [6.4e6, 6.4e6, 1], rtol=0, atol=2e-8)
    np.testing.assert_allclose(rows["true_delta_angle"][1:].sum(axis=0), expected[3:6], rtol=0, atol=2e-15)
    np.testing.assert_allclose(rows["true_delta_velocity"][1:].sum(axis=0), expected[6:], rtol=0, atol=1e-12)


# --- order of the quadrature, exactness -----------------------------------------------------------------------------------


def test_quadrature_error_is_of_sixth_order() -> None:
    """One sample against its two halves: below rounding for the sway; where visible, 64 times less for half the interval."""
    fast = {"engine_angular_frequency": 2 * np.pi * 5.0, "engine_roll_amplitude": 0.02, "engine_pitch_amplitude": 0.02}
    errors = []
    for rate in (50, 100, 200, 400):
        increments_of = []
        for divide in (1, 2):
            h = 1 / rate / divide
            rows = history(car(), {**fast, "sample_interval": h, "start_latitude": 0.5, "engine_pitch_phase": 1.0}, 40 * divide)
            sums = np.concatenate([rows["true_delta_angle"], rows["true_delta_velocity"]], axis=1)[1:]
            increments_of.append(sums.reshape(40, divide, 6).sum(axis=1))
        errors.append(np.abs(increments_of[0] - increments_of[1]).max())
    assert errors[0] < 2e-6 and errors[1] < errors[0] / 80 and errors[2] < errors[1] / 80  # h^7 in the increment
    assert errors[3] < 1e-13


@pytest.mark.parametrize(
    "vehicle", [ship(2), ship(0, 5), ship(1, 3, True, seeded=True), car(2), aircraft(), multirotor()], ids=lambda v: v.title
)
def test_only_exactly_rounded_operations(vehicle: Vehicle) -> None:
    for function in plant(vehicle).functions.values():
        assert not inexact_operations(function)


def test_regular_sway_from_a_description() -> None:
    counts, values = regular_sway([
        {"motion": "roll", "amplitude_deg": 10, "period_s": 8},
        {"motion": "roll", "amplitude_deg": 1, "frequency_hz": 0.5, "phase_deg": 90},
        {"motion": "down", "amplitude_m": 1, "period_s": 8},
    ])  # fmt: skip
    assert counts == {"roll": 2, "down": 1}
    rows = history(ship(counts), values, 400, 40)
    t = np.arange(11) * 0.2
    roll = 10 * DEG * np.sin(2 * np.pi * t / 8) + DEG * np.cos(np.pi * t)
    np.testing.assert_allclose(2 * np.arcsin(rows["q_nb"][:, 1]), roll, atol=1e-14)
