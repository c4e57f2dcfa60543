"""Wrong arguments: every error names the argument, its value and what is allowed (for type checkers: tests/typed)."""

import inspect
import re

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
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
PAIRS = [
    (AlignmentEnv, AlignmentVectorEnv),
    (NavigationEnv, NavigationVectorEnv),
    (TuningEnv, TuningVectorEnv),
    (ManoeuvreEnv, ManoeuvreVectorEnv),
]
OUTAGES = "allowed is a sequence of pairs (begin, end)"
COMMON = [
    ({"scenario": 3}, "scenario = 3: allowed is a name, the path"),
    ({"scenario": {**SHIP, "colour": 1}}, "scenario: colour: unknown key (allowed: "),
    ({"scenario": "car-parked"}, "kind 'car': this environment is for 'ship'"),
    ({"scenario": "ship-underway"}, "needs a vehicle in place"),
    ({"scenario": "nowhere"}, "nowhere"),
    ({"vehicle": 3}, "vehicle = 3: allowed is a kind of vehicle or ''"),
    ({"duration_s": "60"}, "duration_s = '60': allowed is a number from one step, "),
    ({"duration_s": 1e-9}, "duration_s = 1e-09 s"),
    ({"samples_per_step": 0}, "samples_per_step = 0"),
    ({"samples_per_step": True}, "samples_per_step = True: allowed is a whole number from 1"),
    ({"imu": 3}, 'imu = 3: allowed is a grade of the catalogue, "random" or None'),
    ({"imu": "gold"}, "gold"),
    ({"imu_range": 3}, "imu_range = 3: allowed is two grades of the catalogue"),
    ({"imu": None, "imu_range": ("marine", "tactical")}, "('marine', 'tactical') with imu = None: the range is "),
    ({"imu": "navigation", "imu_range": ("marine", "tactical")}, "('marine', 'tactical') with imu = 'navigation': "),
    ({"imu": "random", "imu_range": ("tactical", "marine")}, "imu_range = ('tactical', 'marine'): allowed is two grades"),
    ({"heading_deg": ("0", "90")}, "heading_deg = ('0', '90'): allowed is a pair (low, high) of numbers"),
    ({"heading_deg": (10.0, 5.0)}, "heading_deg = (10.0, 5.0)"),
    ({"sea_state": (0.0, 99.0)}, "sea_state = (0.0, 99.0)"),
    ({"initial_error": "x"}, "initial_error = 'x': allowed is two numbers (tilt, heading) above 0 up to 360 deg"),
    ({"initial_error": (0.0, 5.0)}, "initial_error = (0.0, 5.0)"),
    ({"gnss_outages_s": (1, 2)}, f"gnss_outages_s = (1, 2): {OUTAGES}"),
    ({"gnss_outages_s": ((1, 2), (3,))}, f"gnss_outages_s = ((1, 2), (3,)): {OUTAGES}"),
    ({"gnss_outages_s": tuple((i, i + 0.5) for i in range(100))}, "gnss_outages_s has 100 outages: allowed are at most "),
    ({"gnss_outages_s": ((1.0, 2.0),)}, "no [gnss]"),
    ({"time_weight": -1.0}, "time_weight = -1"),
    ({"backend": 3}, "backend 3: allowed is "),
    ({"backend": "quantum"}, "quantum"),
    ({"observation": "short"}, "observation = 'short': allowed is 'samples' or 'compact'"),
    ({"action": "gain"}, "action = 'gain': allowed is 'attitude' or 'correction'"),
    ({"dtype": "float16"}, "dtype = 'float16': allowed is 'float64' or 'float32'"),
]  # fmt: skip
SINGLE = [({"render_mode": "x"}, "render_mode = 'x': allowed is 'rgb_array' or 'ansi'")]
VECTOR = [
    ({"num_envs": 0}, "num_envs = 0: allowed is a whole number from 1"),
    ({"threads": "2"}, "threads = '2': allowed is a whole number from 1"),
    ({"max_episode_steps": 0}, "max_episode_steps = 0"),
    ({"autoreset_mode": 3}, "autoreset_mode = 3: allowed is "),
    ({"autoreset_mode": "nosuch"}, "autoreset_mode = 'nosuch': allowed is 'NextStep' or 'SameStep' or 'Disabled'"),
    ({"render_mode": "rgb_array"}, "render_mode = 'rgb_array': allowed is None"),
]
OWN = [
    (AlignmentEnv, {"sway_phases": 1}, "sway_phases = 1: allowed is True or False"),
    (AlignmentEnv, {"mounting_deg": -1.0}, "mounting_deg = -1.0 deg: allowed is a number from 0 to 80 deg"),
    (AlignmentEnv, {"time_weight": "1"}, "time_weight = '1': allowed is a number from 0 to 1e+06"),
    (NavigationEnv, {"scenario": "aircraft-free-inertial", "vehicle": "aircraft"}, "needs GNSS fixes: the scenario has no"),
    (ManoeuvreEnv, {"start_speed_mps": 3.0}, "start_speed_mps = 3.0: allowed is a pair (low, high) of numbers from 0 to 340"),
    (ManoeuvreEnv, {"time_weight": "1"}, "time_weight = '1': allowed is a number from 0 to 1e+06"),
    (ManoeuvreEnv, {"goal_deg": 0}, "goal_deg = 0 deg: allowed is a number above 0 up to 180 deg"),
    (ManoeuvreEnv, {"reward": ["error"]}, "reward = ['error']: allowed is 'error' or 'uncertainty'"),
    (ManoeuvreEnv, {"estimator": ["aqe-ekf"]}, "estimator = ['aqe-ekf']: allowed is the id of an estimator"),
    (ManoeuvreEnv, {"estimator": "wander-sins"}, "loosely-coupled, aqe-ekf, aqe-sukf"),
    (ManoeuvreEnv, {"scenario": "ship-underway"}, "needs a car or an aircraft"),
    (ManoeuvreEnv, {"scenario": "car-parked"}, "has no [gnss]"),
    (TuningEnv, {"estimator": 3}, "estimator = 3: allowed is the id of an estimator"),
    (TuningEnv, {"estimator": "q-method"}, "loosely-coupled, aqe-ekf, aqe-sukf"),
    (TuningEnv, {"estimator": "nothing"}, "no estimator 'nothing'"),
    (TuningEnv, {"scenario": "ship-swaying"}, "has no [gnss]"),
    (TuningEnv, {"decades": -1.0}, "decades = -1"),
    (TuningEnv, {"mistuning_decades": np.nan}, "mistuning_decades = nan"),
    (TuningEnv, {"consistency_weight": np.zeros(2)}, "consistency_weight = array([0., 0.]): allowed is a number"),
    (TuningEnv, {"consistency_weight": 1e9}, "consistency_weight = 1000000000"),
]  # fmt: skip


def refuses(call, message):
    with pytest.raises(InputError, match=re.escape(message)):
        call()


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [(AlignmentEnv, *each) for each in COMMON + SINGLE] + [(AlignmentVectorEnv, *each) for each in COMMON + VECTOR] + OWN,
)
def test_an_argument_is_refused(kind, given, message):
    ship = {"scenario": "ship-swaying", "vehicle": "ship"} if kind in PAIRS[0] else {}
    several = {"num_envs": 2} if kind is AlignmentVectorEnv else {}
    refuses(lambda: kind(**{**SHORT, **ship, **several, **given}), message)


@pytest.mark.parametrize(("single", "vector"), PAIRS)
def test_both_interfaces_take_the_same_arguments_with_the_same_defaults(single, vector):
    own = {"num_envs", "autoreset_mode", "threads", "max_episode_steps"}
    parameters = inspect.signature(vector.__init__).parameters
    assert own <= set(parameters)
    ours = {name: (p.default, p.annotation) for name, p in inspect.signature(single.__init__).parameters.items()}
    assert ours == {name: (p.default, p.annotation) for name, p in parameters.items() if name not in own}
    for kind in (single, vector):
        wrong = f"{kind.__name__}: unknown argument 'samples_per_stepp'; did you mean 'samples_per_step'? (allowed: "
        refuses(lambda kind=kind: kind(samples_per_stepp=3), wrong)


def test_gymnasium_passes_the_message_on():
    for make in (gymnasium.make, lambda id, **given: gymnasium.make_vec(id, 2, **given)):
        refuses(lambda make=make: make("insenv/ShipAlignment-v0", duration=3.0), "did you mean 'duration_s'")


def test_a_subclass_may_take_arguments_of_its_own():
    class Mine(AlignmentEnv):
        def __init__(self, colour, **given):
            super().__init__(**given)
            self.colour = colour

    assert Mine("red", **SHORT).colour == "red"
    refuses(lambda: AlignmentEnv(colour="red"), "AlignmentEnv: unknown argument 'colour'")


@pytest.fixture(scope="module")
def envs():
    return AlignmentEnv(**SHORT), AlignmentVectorEnv(2, **SHORT)


@pytest.mark.filterwarnings("error")
def test_what_methods_refuse(envs):
    single, vector = envs
    options = {
        "options = 3: allowed is a mapping": 3,
        "options: unknown option 'heading'; did you mean 'heading_deg'? (allowed: imu": {"heading": 3.0},
        "heading_deg = 'x': allowed is a pair (low, high) of numbers": {"heading_deg": "x"},
        "imu = 3: allowed is a grade": {"imu": 3},
        "gold": {"imu": "gold"},
        "sea_state = (11, 11)": {"sea_state": 11},
        "run_seed = 'x': allowed is a whole number from 0": {"run_seed": "x"},
        "run_seed = -1": {"run_seed": -1},
    }
    for env in envs:
        for message, given in options.items():
            refuses(lambda env=env, given=given: env.reset(options=given), message)
        refuses(lambda env=env: env.restore("x"), "snapshot = 'x': allowed is a Snapshot")
        refuses(lambda env=env: agents.make("q-method", env, threads="2"), "threads = '2': allowed is a whole number from 1")
        late = "declare_after_s = '2': allowed is a number"
        refuses(lambda env=env: agents.make("q-method", env, declare_after_s="2"), late)
        env.reset(seed=1)
        for kind in (complex, str):
            action = np.zeros(env.action_space.shape).astype(kind)
            refuses(lambda env=env, action=action: env.step(action), "action = array(")
    for seed in ("x", 2.5, -1, [1], [1, "x"], [1, 2, 3]):
        refuses(lambda seed=seed: vector.reset(seed=seed), f"seed = {seed!r}: allowed is a whole number from 0")
    task = single.setup.task
    refuses(lambda: estimate_action(task, np.zeros(3)), "estimate_q_nb = array([0., 0., 0.]): allowed is numbers of shape (4,)")
    refuses(lambda: estimate_action(task, "north"), "estimate_q_nb = 'north'")
