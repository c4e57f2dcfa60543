"""Wrong arguments: every error names the argument, its value and what is allowed (for type checkers: tests/typed)."""

import inspect

import gymnasium
import numpy as np
import pytest

from insenv.envs import (
    AlignmentEnv,
    AlignmentVectorEnv,
    ManoeuvreEnv,
    ManoeuvreVectorEnv,
    NavigationEnv,
    NavigationVectorEnv,
    TuningEnv,
    TuningVectorEnv,
    agents,
    estimate_action,
)
from insenv.errors import InputError
from insenv.files.resources import scenario_folder
from insenv.files.toml import read_toml

SHIP = read_toml(scenario_folder() / "ship-swaying.toml")
SHORT = {"samples_per_step": 7, "duration_s": 0.3, "backend": "interpreter"}
PAIRS = [
    (AlignmentEnv, AlignmentVectorEnv),
    (NavigationEnv, NavigationVectorEnv),
    (TuningEnv, TuningVectorEnv),
    (ManoeuvreEnv, ManoeuvreVectorEnv),
]
COMMON = [
    ({"scenario": 3}, "scenario = 3: allowed is a name, the path of a .toml file, a Scenario or its values"),
    ({"scenario": {**SHIP, "colour": 1}}, "scenario: colour: unknown key (allowed: "),
    ({"vehicle": 3}, "vehicle = 3: allowed is a kind of vehicle or ''"),
    ({"duration_s": "60"}, "duration_s = '60': allowed is a number from one step, "),
    ({"duration_s": float("nan")}, "duration_s = nan s: allowed is a number from one step, "),
    ({"samples_per_step": 2.5}, "samples_per_step = 2.5: allowed is a whole number from 1"),
    ({"samples_per_step": True}, "samples_per_step = True: allowed is a whole number from 1"),
    ({"imu": 3}, 'imu = 3: allowed is a grade of the catalogue, "random" or None'),
    ({"imu_range": 3}, "imu_range = 3: allowed is two grades of the catalogue"),
    ({"imu_range": ("marine", 3)}, "imu_range = ('marine', 3): allowed is two grades of the catalogue"),
    ({"imu": None, "imu_range": ("marine", "tactical")}, "imu_range = ('marine', 'tactical') with imu = None: the range is "),
    (
        {"imu": "navigation", "imu_range": ("marine", "tactical")},
        "imu_range = ('marine', 'tactical') with imu = 'navigation': ",
    ),
    (
        {"imu": "random", "imu_range": ("tactical", "marine")},
        "imu_range = ('tactical', 'marine'): allowed is two grades of the ",
    ),
    ({"heading_deg": 5}, "heading_deg = 5: allowed is a pair (low, high) of numbers from -360 to 360 deg"),
    ({"heading_deg": ("0", "90")}, "heading_deg = ('0', '90'): allowed is a pair (low, high) of numbers"),
    ({"sea_state": "rough"}, "sea_state = 'rough': allowed is a pair (low, high) of numbers from 0 to 10"),
    ({"initial_error": "x"}, "initial_error = 'x': allowed is two numbers (tilt, heading) above 0 up to 360 deg"),
    ({"gnss_outages_s": (1, 2)}, "gnss_outages_s = (1, 2): allowed is a sequence of pairs (begin, end)"),
    ({"gnss_outages_s": ((1, 2), (3,))}, "gnss_outages_s = ((1, 2), (3,)): allowed is a sequence of pairs (begin, end)"),
    ({"gnss_outages_s": "x"}, "gnss_outages_s = 'x': allowed is a sequence of pairs (begin, end)"),
    ({"gnss_outages_s": tuple((i, i + 0.5) for i in range(100))}, "gnss_outages_s has 100 outages: allowed are at most "),
    ({"backend": 3}, "backend 3: allowed is "),
]
SINGLE = [
    *COMMON,
    ({"render_mode": "x"}, "render_mode = 'x': allowed is 'rgb_array' or 'ansi'"),
    ({"render_mode": 3}, "render_mode = 3"),
]
VECTOR = [
    *COMMON,
    ({"num_envs": 0}, "num_envs = 0: allowed is a whole number from 1"),
    ({"num_envs": "4"}, "num_envs = '4': allowed is a whole number from 1"),
    ({"threads": "2"}, "threads = '2': allowed is a whole number from 1"),
    ({"max_episode_steps": 2.5}, "max_episode_steps = 2.5: allowed is a whole number from 1"),
    ({"autoreset_mode": 3}, "autoreset_mode = 3: allowed is "),
    ({"autoreset_mode": "nosuch"}, "autoreset_mode = 'nosuch': allowed is 'NextStep' or 'SameStep' or 'Disabled'"),
    ({"render_mode": "x"}, "render_mode = 'x': allowed is None"),
]
OWN = [
    (AlignmentEnv, {"sway_phases": 1}, "sway_phases = 1: allowed is True or False"),
    (AlignmentEnv, {"mounting_deg": -1.0}, "mounting_deg = -1.0 deg: allowed is a number from 0 to 80 deg"),
    (
        ManoeuvreEnv,
        {"start_speed_mps": 3.0},
        "start_speed_mps = 3.0: allowed is a pair (low, high) of numbers from 0 to 340",
    ),
    (AlignmentEnv, {"time_weight": "1"}, "time_weight = '1': allowed is a number from 0 to 1e+06"),
    (ManoeuvreEnv, {"time_weight": "1"}, "time_weight = '1': allowed is a number from 0 to 1e+06"),
    (ManoeuvreEnv, {"goal_deg": "1"}, "goal_deg = '1': allowed is a number above 0 up to 180 deg"),
    (ManoeuvreEnv, {"goal_deg": 0}, "goal_deg = 0 deg: allowed is a number above 0 up to 180 deg"),
    (ManoeuvreEnv, {"reward": ["error"]}, "reward = ['error']: allowed is 'error' or 'uncertainty'"),
    (ManoeuvreEnv, {"estimator": ["aqe-ekf"]}, "estimator = ['aqe-ekf']: allowed is the id of an estimator"),
    (TuningEnv, {"estimator": 3}, "estimator = 3: allowed is the id of an estimator"),
    (TuningEnv, {"decades": "2"}, "decades = '2': allowed is a number from 0 to 4"),
    (TuningEnv, {"mistuning_decades": None}, "mistuning_decades = None: allowed is a number from 0 to 4"),
    (
        TuningEnv,
        {"consistency_weight": np.zeros(2)},
        "consistency_weight = array([0., 0.]): allowed is a number from 0 to 1000",
    ),
]


def refuses(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(("given", "message"), SINGLE)
def test_a_single_environment_refuses(given, message):
    refuses(lambda: AlignmentEnv(**{**SHORT, **given}), message)


@pytest.mark.parametrize(("given", "message"), VECTOR)
def test_a_vector_environment_refuses(given, message):
    refuses(lambda: AlignmentVectorEnv(**{"num_envs": 2, **SHORT, **given}), message)


@pytest.mark.parametrize(("kind", "given", "message"), OWN)
def test_an_argument_of_one_task_is_refused(kind, given, message):
    refuses(lambda: kind(**{**SHORT, **given}), message)


@pytest.mark.parametrize("kind", [kind for pair in PAIRS for kind in pair])
def test_a_misspelt_name_is_refused_with_the_nearest(kind):
    refuses(
        lambda: kind(samples_per_stepp=3),
        f"{kind.__name__}: unknown argument 'samples_per_stepp'; did you mean 'samples_per_step'? (allowed: ",
    )


def test_gymnasium_passes_the_message_on():
    for make in (gymnasium.make, lambda id, **given: gymnasium.make_vec(id, 2, **given)):
        with pytest.raises(InputError, match="did you mean 'duration_s'"):
            make("insenv/ShipAlignment-v0", duration=3.0)


@pytest.mark.parametrize(("single", "vector"), PAIRS)
def test_both_interfaces_take_the_same_arguments_with_the_same_defaults(single, vector):
    own = {"num_envs", "autoreset_mode", "threads", "max_episode_steps"}
    parameters = inspect.signature(vector.__init__).parameters
    assert own <= set(parameters)
    ours = {name: (p.default, p.annotation) for name, p in inspect.signature(single.__init__).parameters.items()}
    theirs = {name: (p.default, p.annotation) for name, p in parameters.items() if name not in own}
    assert ours == theirs


def test_a_subclass_may_take_arguments_of_its_own():
    class Mine(AlignmentEnv):
        def __init__(self, colour, **given):
            super().__init__(**given)
            self.colour = colour

    assert Mine("red", **SHORT).colour == "red"
    refuses(lambda: AlignmentEnv(colour="red"), "AlignmentEnv: unknown argument 'colour'")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (3, "options = 3: allowed is a mapping"),
        ({"heading": 3.0}, "options: unknown option 'heading'; did you mean 'heading_deg'? (allowed: "),
        ({"heading_deg": "x"}, "heading_deg = 'x': allowed is a pair (low, high) of numbers"),
        ({"imu": 3}, "imu = 3: allowed is a grade"),
        ({"run_seed": "x"}, "run_seed = 'x': allowed is a whole number from 0"),
    ],
)
def test_a_reset_refuses(options, message):
    for env in (AlignmentEnv(**SHORT), AlignmentVectorEnv(2, **SHORT)):
        refuses(lambda env=env: env.reset(options=options), message)


@pytest.mark.filterwarnings("error")
def test_an_action_is_of_real_numbers():
    for env in (AlignmentEnv(**SHORT), AlignmentVectorEnv(2, **SHORT)):
        env.reset(seed=1)
        for kind in (complex, str):
            action = np.zeros(env.action_space.shape).astype(kind)
            refuses(lambda env=env, action=action: env.step(action), "action = array(")


def test_a_random_unit_is_drawn_between_the_given_grades():
    """The standard deviation of the turn-on bias, for the default range and a given one."""
    for env, low, high in (
        (AlignmentEnv(imu="random", **SHORT), 0.001, 4.0),
        (AlignmentEnv(imu="random", imu_range=("navigation", "tactical"), **SHORT), 0.01, 4.0),
        (ManoeuvreEnv(**SHORT), 4.0, 720.0),
    ):
        rows, drawn = env.setup.task.model.parameters, []
        for seed in range(20):
            p = env.setup.starts.draw([np.random.default_rng(seed)])[0]
            drawn.append(np.degrees(p[rows.slice("gyro_bias_sigma")][0]) * 3600.0)
        assert low <= min(drawn) < low * (high / low) ** 0.3, drawn
        assert high * (low / high) ** 0.3 < max(drawn) <= high, drawn


@pytest.mark.parametrize("seed", ["x", 2.5, -1, [1], [1, "x"], [1, 2, 3]])
def test_a_vector_environment_refuses_a_seed(seed):
    refuses(lambda: AlignmentVectorEnv(2, **SHORT).reset(seed=seed), f"seed = {seed!r}: allowed is a whole number from 0")


def test_restore_refuses_what_is_no_snapshot():
    for env in (AlignmentEnv(**SHORT), AlignmentVectorEnv(2, **SHORT)):
        refuses(lambda env=env: env.restore("x"), "snapshot = 'x': allowed is a Snapshot")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"threads": "2"}, "threads = '2': allowed is a whole number from 1"),
        ({"declare_after_s": "2"}, "declare_after_s = '2': allowed is a number"),
    ],
)
def test_an_agent_refuses(given, message):
    for env in (AlignmentEnv(**SHORT), AlignmentVectorEnv(2, **SHORT)):
        refuses(lambda env=env: agents.make("q-method", env, **given), message)


def test_an_estimate_of_a_wrong_shape_is_refused():
    task = AlignmentEnv(**SHORT).setup.task
    refuses(lambda: estimate_action(task, np.zeros(3)), "estimate_q_nb = array([0., 0., 0.]): allowed is numbers of shape (4,)")
    refuses(lambda: estimate_action(task, "north"), "estimate_q_nb = 'north'")
