"""Starts of many episodes at once: every row is that of its own episode, from the contract of the filter; its limit."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from scipy.stats import spearmanr

import insenv
from insenv import attitude
from insenv.base.errors import InputError
from insenv.envs import ManoeuvreEnv, TuningEnv, knowledge_of
from insenv.envs.knowledge import KNOWN
from insenv.envs.starts import InnerStarts, episode_limit
from insenv.envs.units import UNITS
from insenv.scenario import build, load, plant_of
from insenv.sensors.imu_tables import IMU_PARAMETERS

IDS = ("insenv/Tuning-v0", "insenv/Manoeuvre-v0")
SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}


def test_no_constant_attitude_is_an_estimate():
    """Heading, sway phases and mounting differ between episodes, unless options keep the scenario's."""
    venv = gymnasium.make_vec(SHIP, 64, **SHORT)
    _, info = venv.reset(seed=1)
    roll, pitch, heading = attitude.numeric.to_euler(info["q_nb"])
    # half the width of the mounting draws, 11.5 deg RMS, with a sway of 7 and 3.5 deg RMS
    assert np.std(roll) > np.radians(10.0) and np.std(pitch) > np.radians(8.0) and np.std(heading) > 1.4
    as_told = {"heading_deg": None, "sway_phases": False, "mounting_deg": None}
    _, info = venv.reset(seed=1, options=as_told)
    assert np.ptp(attitude.numeric.to_euler(info["q_nb"]), axis=1) == pytest.approx(0.0, abs=1e-12)


def test_options_hold_for_one_episode():
    env = gymnasium.make(SHIP, **SHORT)
    plain, _ = env.reset(seed=1)
    turned, info = env.reset(seed=1, options={"heading_deg": 200.0, "imu": "tactical", "initial_error": (2.0, 45.0)})
    seen = env.unwrapped.named(turned)
    # the option replaces the mean heading of the scenario; sway adds up to 3 deg at time 0
    assert np.degrees(attitude.numeric.to_euler(info["q_nb"])[2]) % 360.0 == pytest.approx(200.0, abs=3.1)
    assert seen["known_heading_sigma"] == pytest.approx(np.radians(45.0))
    assert seen["known_gyro_bias_sigma"] > env.unwrapped.named(plain)["known_gyro_bias_sigma"]
    assert np.array_equal(env.reset(seed=1)[0], plain)


@pytest.mark.parametrize(("id", "given", "low", "high"), [
    (SHIP, {"imu": "random"}, 0.001, 4.0),
    (SHIP, {"imu": "random", "imu_range": ("navigation", "tactical")}, 0.01, 4.0),
    (IDS[1], {}, 4.0, 720.0),
])  # fmt: skip
def test_a_random_unit_is_drawn_between_the_given_grades(id, given, low, high):
    """The standard deviation of the turn-on bias, for the default range and a given one: uniform in its logarithm."""
    env = gymnasium.make(id, **SHORT, **given).unwrapped
    place, generators = env.setup.task.model.parameters.slice("gyro_bias_sigma"), map(np.random.default_rng, range(256))
    drawn = np.degrees(env.setup.starts.draw(list(generators))[:, place][:, 0]) * 3600.0
    assert low * 0.999 <= drawn.min() < low * (high / low) ** 0.1 and high * (low / high) ** 0.1 < drawn.max() <= high * 1.001
    # half of the logarithmic draws lie below the geometric mean; 256 draws, 4 sigma
    assert 50 < len(np.unique(drawn)) <= UNITS and abs(np.mean(drawn < np.sqrt(low * high)) - 0.5) < 4 * 0.5 / 16


def test_the_figures_of_random_units_are_independent():
    starts = gymnasium.make(SHIP, **SHORT, imu="random").unwrapped.setup.starts
    parameters = starts._plant.parameters
    names = [row.name for row in IMU_PARAMETERS if np.ptp(starts._pool[:, parameters.slice(row.name)], axis=0).any()]
    pool = np.array([starts._pool[:, parameters.slice(name)].max(axis=1) for name in names])
    assert len(names) > 10 and all(len(np.unique(figure)) == UNITS for figure in pool)
    assert np.abs(spearmanr(pool.T).statistic - np.eye(len(pool))).max() < 0.05


@pytest.mark.parametrize("sheet", ["drawn", "middle"])
def test_the_data_sheet_of_a_random_unit_is_told_or_hidden(sheet):
    """Hidden, the filter of every episode has the sheet between the grades, whatever its unit is."""
    starts, p, x = _made(IDS[1], imu_sheet=sheet)
    told = starts.complete(p.copy(), x)[:, starts.task.model.parameters.slice("known_gyro_bias_sigma")]
    graded = starts.with_options({"imu": "tactical"}), _made(IDS[1], imu="tactical")[0]  # a sheet that is always told
    one, other = (each.complete(each.draw([np.random.default_rng(1)]), x[:1]) for each in graded)
    assert np.array_equal(one, other)
    units = len(np.unique(p[:, starts.task.model.parameters.slice("gyro_bias_sigma")][:, 0]))
    assert units > 6 and len(np.unique(told)) == (1 if sheet == "middle" else units)


def _made(id: str, **given) -> tuple[InnerStarts, np.ndarray, np.ndarray]:
    """The starts of an environment, and parameters and states of 12 episodes."""
    starts = gymnasium.make(id, **given).unwrapped.setup.starts
    p = starts.draw([np.random.default_rng(seed) for seed in range(12)])
    model = starts.task.model
    functions = model.kernels["start"].function
    x = np.array([np.asarray(functions(row, np.full(model.start_uniforms, 0.3))).ravel() for row in p])
    return starts, p, x


@pytest.mark.parametrize("id", IDS)
def test_the_filter_of_each_row_starts_from_the_knowledge_of_that_row(id):
    """One that computes its parameters is asked row by row."""
    starts, p, x = _made(id)
    parameters, filter = starts.task.model.parameters, starts._estimator
    done = starts.complete(p.copy(), x)
    assert len(np.unique(done[:, starts._place], axis=0)) == len(p)
    for i, row in enumerate(done):
        known = knowledge_of(parameters.unpack(row, KNOWN.names), starts._same)
        told = filter.model.parameters.pack(filter.parameters(known, starts._tunings))
        assert np.array_equal(row[starts._place], told)
        assert np.array_equal(row, starts.complete(p[i : i + 1].copy(), x[i : i + 1])[0])
    calls = []
    asking = replace(filter, prepare=lambda known: calls.append(known) or known.rows_of(filter.model.parameters))
    assert asking.copied({}) is None
    starts._estimator, starts._copied = asking, None
    assert np.array_equal(starts.complete(p.copy(), x), done) and len(calls) == len(p)


@pytest.mark.parametrize(("kind", "given"),
    [(ManoeuvreEnv, {}), pytest.param(TuningEnv, {"scenario": "ship-underway"}, marks=pytest.mark.slow)])  # fmt: skip
def test_the_filter_knows_what_that_of_a_run_knows(kind, given):
    """Also the errors of the unit that grow with motion, and the part of a fix's error that lasts."""
    env = kind(**given)
    env.reset(seed=0, options={"run_seed": 3})
    starts, plant = env.setup.starts, build(env.setup.scenario, seed=3, driven=True)
    wanted = plant.parameters_of(starts._estimator, offline=False)
    assert np.all(wanted["rotation_error"] > 0.0) and np.all(wanted["fix_wander_sigma"] > 0.0)
    found = env.setup.task.model.parameters.unpack(env.snapshot().parameters)
    for name, value in wanted.items():
        assert found[f"estimator_{name}"] == pytest.approx(value, rel=1e-12), name


def test_a_value_that_the_filter_does_not_take_is_named():
    starts, p, x = _made("insenv/Tuning-v0")
    place = starts.task.model.state.slice("velocity_n")
    x[5, place] = 1e9
    with pytest.raises(InputError, match=r"start_velocity_n\[0\] = .* m/s: allowed is"):
        starts.complete(p, x)


def test_the_limit_is_that_of_the_scenario_at_the_end_or_over_the_episode():
    _, info = gymnasium.make_vec(SHIP, 3, duration_s=10.0, initial_error=None).reset(seed=4)
    assert np.array_equal(info["limit"], np.tile(insenv.limit("ship-swaying", duration_s=10.0).rotation[-1], (3, 1)))
    _, info = gymnasium.make_vec(DRIVE, 2, duration_s=10.0).reset(seed=4)
    found = insenv.limit("car-city-drive", duration_s=10.0).rms(np.arange(1.0, 11.0))
    assert np.array_equal(info["limit"][0], info["limit"][1])
    names = ("vn_mps", "ve_mps", "vd_mps", "north_m", "east_m", "down_m")
    assert info["limit"][0, 3:] == pytest.approx([found[name] for name in names], rel=1e-12)


def test_the_limit_of_a_random_unit_is_that_of_the_unit():
    """Also with its data sheet hidden; nothing else is drawn here."""
    plain = {"heading_deg": None, "sway_phases": False, "mounting_deg": None, "initial_error": None}
    env = gymnasium.make_vec(SHIP, 4, samples_per_step=100, duration_s=10.0, imu="random", imu_sheet="middle", **plain)
    info, task, scenario = env.reset(seed=4)[1], env.unwrapped.setup.task, load("ship-swaying")
    plant = plant_of(scenario)[0]
    for row, limit in zip(env.unwrapped.snapshot().parameters[:, : plant.parameters.size], info["limit"], strict=True):
        assert np.array_equal(limit, episode_limit(task, plant, scenario, row, 10.0))
    assert len(np.unique(info["limit"][:, 2])) == 4


def test_no_value_of_the_data_sheet_is_lost_on_the_way_to_the_filter():
    """Nor those that no observation has, as the correlation times of scale factors."""
    plant = build(load("car-survey"), seed=1)
    same, rows = plant.knowledge, {}
    for row in KNOWN:
        name = row.name.removeprefix("known_")
        value = getattr(same.sensors, name, None)
        rows[row.name] = row.flat_start().reshape(row.shape) if value is None else np.array(value)
    assert knowledge_of(rows, same).sensors == same.sensors
