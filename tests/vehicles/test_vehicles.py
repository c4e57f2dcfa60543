"""Laws of motion: flows and their derivatives, response to commands, scripts, gusts, waves, and the builders of scripts."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from lone_vehicle import DEG, history, plant
from scipy.integrate import quad

from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles import (
    Hull,
    Vehicle,
    aircraft,
    car,
    car_route,
    flight_plan,
    irregular_sea,
    multirotor,
    regular_sway,
    ship,
    ship_course,
    survey_pattern,
)
from insenv.vehicles.car import SCRIPT as CAR_SCRIPT
from insenv.vehicles.nodes import PLACES
from insenv.vehicles.script import N_SEGMENTS
from insenv.vehicles.tracker import Tracker
from insenv.vehicles.waves import response, spectrum, wave_components

VEHICLES = [ship(2), ship(1, 3, under_way=True), car(2), aircraft(), multirotor(2)]


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda v: v.title)
def test_derivative_is_that_of_the_flow(vehicle: Vehicle) -> None:
    """Against the derivative of the polynomial through start, nodes and end of a short sample, from a random state."""
    h = 2e-4
    model = plant(vehicle)
    rng = np.random.default_rng(1)
    values = {}
    for row in model.parameters:
        if row.name.endswith("_amplitude"):
            values[row.name] = rng.uniform(0.5, 1.0, row.shape)
        elif row.name.endswith("angular_frequency"):
            values[row.name] = rng.uniform(0.5, 3.0, row.shape)
    runner = make_runner(model, {"sample_interval": h, **values}, backend="interpreter")
    state = runner.state
    p_flat = ca.SX(ca.DM(runner.p))
    p = model.parameters.symbols(p_flat)
    moving = list(vehicle.derivative(p, vehicle.state.symbols(ca.SX.sym("x", vehicle.state.size))))
    phasor = ("_sine", "_cosine", "_half_weight")
    flat = np.concatenate([
        state[row.name].ravel() if row.name.endswith(phasor) else rng.uniform(0.1, 1.0, row.size) for row in vehicle.state
    ])  # fmt: skip
    x = vehicle.state.symbols(ca.SX(ca.DM(flat)))
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


# --- trackers -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("h", [0.0025, 0.02, 0.5])
def test_tracker_follows_without_overshoot_or_breaking_its_limit(h: float) -> None:
    tracker, x, rng = Tracker(("s", "v", "a"), "speed", "m/s"), SimpleNamespace(s=0.0, v=0.0, a=0.0), np.random.default_rng(3)
    for _ in range(40):
        target, low, high = rng.choice([0.0, 0.0, rng.uniform(0, 20)]), x.s, x.s
        settle = round(rng.choice([1.0, 40.0]) / h)
        for _ in range(settle):
            vars(x).update(tracker.hold(x, h, target, 1.5, 2.0))
            middle = tracker.along(x, 0.5 * h)["s"]
            vars(x).update(tracker.along(x, h))
            low, high = min(low, x.s, middle), max(high, x.s, middle)
            assert x.s > -1e-12 and middle > -1e-12
            assert abs(x.v) <= 2.0 + 1e-12
        if settle * h > 30:
            assert abs(x.s - target) < 1e-3


def test_tracker_integral_of_a_pulse_is_exact() -> None:
    """Despite the lag, a command of 0.3 for 5 s changes the integral by 1.5."""
    tracker, x, total = Tracker(("s", "v", "a"), "rate", "rad/s"), SimpleNamespace(s=0.0, v=0.0, a=0.0), 0.0
    for k in range(4000):
        vars(x).update(tracker.hold(x, 0.01, 0.3 if k < 500 else 0.0, 2.0))
        total += tracker.integral(x, 0.01)
        vars(x).update(tracker.along(x, 0.01))
    assert total == pytest.approx(1.5, abs=1e-12)


# --- scripts and commands -------------------------------------------------------------------------------------------------


def test_segments_follow_one_another_and_the_last_is_held() -> None:
    table = CAR_SCRIPT.table(
        [{"duration": 1.0, "speed": 3.0}, {"duration": 0.5, "speed": 5.0}, {"duration": 2.0, "yaw_rate": 0.1}]
    )
    rows = history(car(), {"segments": table, "sample_interval": 0.01}, 600)
    commanded = rows["commanded_speed"][1:]
    assert set(commanded[:100]) == {3.0} and set(commanded[100:]) == {5.0}
    assert set(rows["commanded_yaw_rate"][1:151]) == {0.0} and set(rows["commanded_yaw_rate"][151:]) == {0.1}


def test_script_repeats() -> None:
    table = CAR_SCRIPT.table([{"duration": 0.105, "speed": 3.0}, {"duration": 0.2, "speed": 5.0}])
    rows = history(car(), {"segments": table, "segments_repeat": 1, "sample_interval": 0.01}, 6100)
    assert (rows["commanded_speed"][1:] == 3.0).mean() == pytest.approx(0.105 / 0.305, abs=1e-3)


def test_commands_from_outside_replace_the_script() -> None:
    table = CAR_SCRIPT.table([{"duration": 1.0, "speed": 3.0}, {"duration": 1.0, "speed": 9.0}])
    runner = make_runner(plant(car()), {"segments": table, "sample_interval": 0.01})
    runner.run(50)
    runner.advance({"command_speed": 6.0, "command_acceleration": 2.0, "command_valid": 1.0})
    runner.advance({"command_valid": 0.0})
    runner.run(1500)
    assert runner.state["commanded_speed"] == 6.0 and runner.state["speed"] == pytest.approx(6.0, abs=1e-6)
    runner.advance({"command_acceleration": -3.0, "command_speed": 6.0, "command_valid": 1.0})
    runner.run(2000, every=0)
    assert runner.state["speed"] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("segments", "said"),
    [
        ([{"speed": 3.0}], "segment 1: duration is missing"),
        ([{"duration": 0.0}], "segment 1: duration = 0 s"),
        ([{"duration": 1.0, "sped": 3.0}], "did you mean 'speed'"),
        ([{"duration": 1.0}, {"duration": 1.0, "speed": float("nan")}], "segment 2: speed = nan m/s"),
        ([{"duration": 1.0}] * (N_SEGMENTS + 1), "at most 64"),
    ],
)
def test_bad_segments(segments: list, said: str) -> None:
    with pytest.raises(InputError, match=said):
        CAR_SCRIPT.table(segments)


# --- car ------------------------------------------------------------------------------------------------------------------

ROUTE = [
    {"wait_s": 5, "load_roll_deg": 0.5, "load_down_m": 0.01},
    {"accelerate_to_mps": 15, "acceleration_mps2": 2.5},
    {"drive_s": 5, "grade_percent": 4},
    {"turn_deg": 90, "duration_s": 6},
    {"turn_deg": -45, "radius_m": 60},
    {"drive_s": 3, "grade_percent": 0},
    {"stop_s": 10},
]


def test_car_route_is_driven_smoothly() -> None:
    h = 0.01
    start = {"start_latitude": 0.6, "start_heading": 0.2, "sample_interval": h, "imu_lever_arm_b": [0.5, 0.3, -0.6]}
    rows = history(car(), {"segments": car_route(ROUTE), **start}, 7000)
    assert rows["speed"].max() == pytest.approx(15, abs=1e-3)
    assert rows["speed"].min() > -1e-12 and abs(rows["speed"][-1]) < 1e-6
    assert rows["path_heading"][-1] == pytest.approx(0.2 + 45 * DEG, abs=0.3 * DEG)
    assert rows["height"].max() > 3 and np.abs(rows["velocity_n"][-1]).max() < 1e-5
    # rate and velocity are continuous, also between segments
    assert np.abs(np.diff(rows["velocity_n"], axis=0)).max() < 6 * h
    assert np.abs(np.diff(rows["rate_ib_b"], axis=0)).max() < 2 * h
    # velocity is the integral of acceleration, and its differences agree with the increments
    middle = np.diff(rows["height"]) / h
    np.testing.assert_allclose(middle, -0.5 * (rows["velocity_n"][1:, 2] + rows["velocity_n"][:-1, 2]), atol=1e-3)
    # people got in
    early = history(car(), {"segments": car_route(ROUTE), **start}, 450)
    assert 2 * np.arcsin(early["q_nb"][-1]) @ [0, np.cos(0.1), np.sin(0.1), 0] == pytest.approx(0.5 * DEG, rel=1e-3)


def test_car_leans_out_of_a_turn_and_noses_up_when_accelerating() -> None:
    rows = history(car(), {"segments": car_route([{"accelerate_to_mps": 12}, {"turn_deg": 180, "duration_s": 15}])}, 3400)
    assert rows["suspension_pitch"][300] > 0.005  # 1.5 s into the acceleration
    assert rows["suspension_roll"][-800:].min() < -0.01 and rows["curvature"].max() > 0.01


def test_parked_car_sways_in_the_wind_with_the_given_sigma_and_repeats_with_the_seed() -> None:
    parameters = {
        "wind_roll_sigma": 0.002, "wind_pitch_sigma": 0.001, "wind_time_constant": 0.5, "engine_angular_frequency": 157.0,
        "engine_down_amplitude": 1e-5, "sample_interval": 0.02, "seed": 5,
    }  # fmt: skip
    rows = history(car(), parameters, 100_000)
    process = rows["wind_roll_target"]
    assert process.std() == pytest.approx(0.002, rel=0.05)
    lag = np.corrcoef(process[:-25], process[25:])[0, 1]
    assert lag == pytest.approx(np.exp(-1), abs=0.05)
    a, b = 9.0, 2.0  # bandwidth, 1 / time constant: variance after two poles at a
    assert rows["wind_pitch"].std() == pytest.approx(0.001 * np.sqrt(a * (b + 2 * a) / 2) / (a + b), rel=0.05)
    again = history(car(), parameters, 200)
    other = history(car(), parameters | {"seed": 6}, 200)
    assert np.array_equal(again["wind_roll"], rows["wind_roll"][:201]) and other["wind_roll"][100] != again["wind_roll"][100]
    np.testing.assert_allclose(rows["latitude"], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("legs", "said"),
    [
        ([{"turn_deg": 90, "duration_s": 5}], "leg 1: turn_deg = 90: a stationary car cannot turn"),
        ([{"accelerate_to_mps": 5}, {"turn_deg": 90}], "leg 2: turn_deg needs either"),
        ([{"drive_s": 5, "wait_s": 5}], "exactly one of"),
        ([{"drive": 5}], "did you mean 'drive_s'"),
        ([{"drive_s": -5}], "drive_s = -5"),
        ([{"stop_s": "long"}], "stop_s = 'long'"),
        ([{"accelerate_to_mps": 5, "acceleration_mps2": 0}], "acceleration_mps2 = 0"),
    ],
)
def test_bad_routes(legs: list, said: str) -> None:
    with pytest.raises(InputError, match=said):
        car_route(legs)


# --- aircraft -------------------------------------------------------------------------------------------------------------


def test_flight_from_the_ground_to_survey_lines() -> None:
    h = 0.02
    legs = [
        {"wait_s": 20}, {"speed_mps": 8}, {"turn_deg": 90, "bank_deg": 4}, {"speed_mps": 80, "acceleration_mps2": 3},
        {"climb_to_m": 600, "climb_mps": 10}, *survey_pattern(3, 4000),
    ]  # fmt: skip
    plan = flight_plan(legs, start_height_m=100)
    time = plan[:, 0].sum()
    start = {"start_latitude": 0.7, "start_height": 100.0, "sample_interval": h, "segments": plan}
    rows = history(aircraft(), start, round(time / h))
    assert rows["height"][-1] == pytest.approx(600, abs=1.0)
    assert rows["track"][-1] == pytest.approx(90 * DEG, abs=0.1 * DEG)
    assert rows["track"].max() == pytest.approx(270 * DEG, abs=0.1 * DEG)
    assert rows["speed"].min() > -1e-12 and rows["speed"][-1] == pytest.approx(80, abs=1e-6)
    on_ground = rows["airborne"] == 0.0
    assert on_ground.sum() * h > 30 and np.abs(rows["height"][on_ground] - 100).max() < 1e-4
    # coordinated: the rate follows from bank and speed, with no force across the wings
    flying = rows["airborne"] > 0.999
    expected = STANDARD_GRAVITY * np.tan(rows["bank"]) / rows["speed"].clip(1)
    np.testing.assert_allclose(rows["turn_rate"][flying], expected[flying], atol=1e-12)
    force = rows["true_delta_velocity"] / h
    assert np.abs(force[flying, 1]).max() < 0.1 and rows["bank"].max() > 19 * DEG and rows["bank"].min() < -19 * DEG
    assert np.abs(np.diff(rows["rate_ib_b"], axis=0)).max() < 1.0 * h and np.abs(np.diff(force, axis=0)[2:]).max() < 8 * h


@pytest.mark.parametrize("vehicle", [ship(1, 0, True), car(), aircraft()], ids=lambda v: v.id)
def test_no_command_makes_a_speed_negative(vehicle: Vehicle) -> None:
    model = plant(vehicle)
    runner = make_runner(model, {"sample_interval": 0.02, "start_speed": 20.0})
    commands = np.random.default_rng(0).uniform(-30, 30, (3000, model.inputs.size))
    commands[:, model.inputs.slice("command_valid")] = np.repeat(np.random.default_rng(1).random(30) > 0.5, 100)[:, None]
    speeds = model.outputs.unpack(runner.run(3000, commands))["speed"]
    assert np.isfinite(speeds).all() and speeds.min() > -1e-12


def test_aircraft_commands() -> None:
    runner = make_runner(plant(aircraft()), {"start_speed": 80.0, "start_height": 1000.0, "sample_interval": 0.02})
    runner.advance({"command_speed": 90.0, "command_acceleration": 1.0, "command_bank": 0.3, "command_climb_rate": 4.0,
                    "command_valid": 1.0})  # fmt: skip
    runner.run(2000, every=0)
    state = runner.state
    assert state["speed"] == pytest.approx(90, abs=1e-3) and state["bank"] == pytest.approx(0.3, abs=1e-9)
    assert state["velocity_n"][2] == pytest.approx(-4.0, abs=1e-3)


def test_turbulence_moves_attitude_and_velocity() -> None:
    sigmas = {f"gust_{name}_sigma": 0.01 for name in ("roll", "pitch", "yaw")}
    sigmas |= {f"gust_{name}_sigma": 0.5 for name in ("north", "east", "down")}
    rows = history(aircraft(), {**sigmas, "start_speed": 80.0, "start_height": 1e3, "sample_interval": 0.02}, 20_000)
    assert 0.3 < rows["velocity_n"][:, 2].std() < 0.6 and 0.005 < rows["gust_yaw"].std() < 0.015
    assert np.abs(np.corrcoef([rows[f"gust_{n}_target"] for n in ("roll", "pitch", "yaw", "north", "east", "down")])
                  - np.eye(6)).max() < 0.3  # fmt: skip


@pytest.mark.parametrize(
    ("legs", "said"),
    [
        ([{"turn_deg": 90}], "leg 1: turn_deg = 90 at 0 m/s"),
        ([{"speed_mps": 20}, {"climb_to_m": 500}], "leg 2: climb_to_m = 500 at 20 m/s: allowed is above 45"),
        ([{"speed_mps": 80}, {"turn_deg": 5, "bank_deg": 30}], "before the bank has settled"),
        ([{"speed_mps": 80}, {"turn_deg": 90, "bank_deg": 60}], "bank 1.0472 rad"),
        ([{"speed_mps": -1}], "speed_mps = -1"),
    ],
)
def test_bad_plans(legs: list, said: str) -> None:
    with pytest.raises(InputError, match=said):
        flight_plan(legs)


# --- ship -----------------------------------------------------------------------------------------------------------------


def test_ship_under_way_keeps_speed_and_turns() -> None:
    course = ship_course(
        [{"hold_s": 20}, {"speed_mps": 6, "duration_s": 100}, {"turn_deg": -120, "duration_s": 100}, {"hold_s": 60}]
    )
    _, values = regular_sway([{"motion": "roll", "amplitude_deg": 5, "period_s": 9}])
    start = {"segments": course, "start_heading": 1.0, "start_speed": 2.0, "start_latitude": 0.5}
    rows = history(ship({"roll": 1}, 0, True), {**values, **start}, 56_000, 100)
    assert rows["speed"][-1] == pytest.approx(6.0, abs=1e-3)
    assert rows["way_heading"][-1] == pytest.approx(1.0 - 120 * DEG, abs=1e-3)
    way = rows["way_heading"]
    np.testing.assert_allclose(rows["velocity_n"][:, 0], rows["speed"] * np.cos(way), atol=1e-12)
    np.testing.assert_allclose(rows["velocity_n"][:, 1], rows["speed"] * np.sin(way), atol=1e-12)


def test_seeded_phases_differ_by_seed_and_keep_the_amplitude() -> None:
    _, values = regular_sway([{"motion": "pitch", "amplitude_deg": 5, "period_s": 7}])
    runs = [history(ship({"pitch": 1}, seeded=True), values | {"seed": seed}, 2000)["pitch_sine"][:, 0] for seed in (1, 2)]
    assert all(run.max() == pytest.approx(5 * DEG, rel=1e-4) for run in runs) and abs(runs[0][0] - runs[1][0]) > 1e-3


def test_phasors_keep_their_radius() -> None:
    _, values = regular_sway([{"motion": "roll", "amplitude_deg": 10, "frequency_hz": 1.7}])
    rows = history(ship({"roll": 1}), values, 1_000_000, 100_000)
    radius = np.hypot(rows["roll_sine"], rows["roll_cosine"])
    np.testing.assert_allclose(radius, 10 * DEG, rtol=1e-15)
    np.testing.assert_allclose(
        rows["roll_sine"][:, 0], 10 * DEG * np.sin(2 * np.pi * 1.7 * np.arange(11) * 500.0), rtol=0, atol=1e-10
    )


# --- waves ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("enhancement", [1.0, 3.3])
def test_spectrum_has_the_moments_of_the_sea(enhancement: float) -> None:
    zeroth = quad(lambda w: float(spectrum(w, 3.0, 9.0, enhancement)), 0.2, 20.0, limit=200)[0]
    assert 4 * np.sqrt(zeroth) == pytest.approx(3.0, rel=0.01)
    first = quad(lambda w: w * float(spectrum(w, 3.0, 9.0, enhancement)), 0.2, 20.0, limit=200)[0]
    w, amplitude = wave_components(3.0, 9.0, 24, enhancement)
    assert np.sum(amplitude**2) / 2 == pytest.approx(zeroth, rel=0.005)
    assert np.sum(w * amplitude**2) / 2 == pytest.approx(first, rel=0.015)
    if enhancement == 1.0:  # closed form: mean period 0.772 Tp (DNV-RP-C205, sec. 3.5.5.4: T1 = 0.7719 Tp)
        assert 2 * np.pi * zeroth / first == pytest.approx(0.772 * 9.0, rel=0.01)


def test_response_in_long_and_short_waves() -> None:
    hull = Hull(length=100, beam=16, draught=5)
    for direction in (0.0, 0.7, np.pi / 2, np.pi):
        long = response([0.05], hull, direction)
        k = 0.05**2 / 9.80665
        assert long["down"][0] == pytest.approx(-1.0, abs=0.01)  # rides the wave
        assert abs(long["pitch"][0]) == pytest.approx(k * abs(np.cos(direction)), rel=0.02, abs=1e-9)  # follows its slope
        assert abs(long["roll"][0]) == pytest.approx(k * abs(np.sin(direction)), rel=0.02, abs=1e-9)
        short = response([3.0], hull, direction)
        assert all(abs(value[0]) < 0.1 for value in short.values())
    at = 2 * np.pi / hull.roll_period
    assert abs(response([at], hull, np.pi / 2)["roll"][0]) > 2.5 * at**2 / 9.80665


@pytest.mark.parametrize("speed", [0.0, 8.0])
def test_motion_in_an_irregular_sea_has_the_variance_of_spectrum_and_response(speed: float) -> None:
    hull, height, period, heading, direction = Hull(length=60), 2.5, 9.0, 0.4, 2.5
    sea = irregular_sea(height, period, 16, hull=hull, wave_direction=direction, heading=heading, speed=speed)
    rows = history(ship(0, 16), {**sea, "sample_interval": 0.25, "seed": 3}, 20_000, backend="interpreter")
    w = np.linspace(0.15, 4.0, 4000)
    motions = response(w, hull, direction - heading, speed)
    for channel, name in (("down", "down"), ("pitch", "pitch"), ("roll", "roll")):
        density = spectrum(w, height, period) * np.abs(motions[name]) ** 2
        expected = np.sqrt(np.trapezoid(density, w))
        got = rows[f"wave_{channel}_sine"].sum(axis=1).std()
        assert got == pytest.approx(expected, rel=0.1)
    down = rows["wave_down_sine"].sum(axis=1)
    np.testing.assert_allclose(rows["height"], rows["height"][0] - (down - down[0]), atol=1e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"significant_height": -1.0}, "significant_height = -1"),
        ({"enhancement": 0.5}, "enhancement = 0.5"),
        ({"components": 0}, "components"),
    ],
)
def test_bad_seas(change: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        irregular_sea(**{"significant_height": 2.0, "peak_period": 8.0, **change})
    with pytest.raises(InputError, match="length = 0"):
        Hull(length=0)


@pytest.mark.parametrize(
    ("sway", "said"),
    [
        ({"motion": "rol"}, "did you mean 'roll'"),
        ({"motion": "roll", "amplitude_m": 1, "period_s": 8}, "no key 'amplitude_m'"),
        ({"motion": "roll", "amplitude_deg": 1}, "needs amplitude_deg and either"),
        ({"motion": "roll", "amplitude_deg": 1, "period_s": 0}, "above 0"),
    ],
)
def test_bad_sway(sway: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        regular_sway([sway])
