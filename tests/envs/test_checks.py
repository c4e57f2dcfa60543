"""Wrong arguments: every error names the argument, its value and what is allowed (for type checkers: tests/typed)."""

import inspect
import re

import gymnasium
import numpy as np
import pytest

from insenv.base.errors import InputError
from insenv.base.resources import scenario_folder
from insenv.base.toml import read_toml
from insenv.envs import (
    AlignmentEnv,
    AlignmentVectorEnv,
    FaultTuningEnv,
    FaultTuningVectorEnv,
    ManoeuvreEnv,
    ManoeuvreVectorEnv,
    NavigationEnv,
    NavigationVectorEnv,
    TuningEnv,
    TuningVectorEnv,
    estimate_action,
)

SHIP = read_toml(scenario_folder() / "ship-swaying.toml")
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
PAIRS = [
    (AlignmentEnv, AlignmentVectorEnv), (NavigationEnv, NavigationVectorEnv), (TuningEnv, TuningVectorEnv),
    (FaultTuningEnv, FaultTuningVectorEnv), (ManoeuvreEnv, ManoeuvreVectorEnv),
]  # fmt: skip
COMMON = [
    ({"scenario": 3}, "scenario = 3: allowed is a name, the path"),
    ({"scenario": "car-parked"}, "kind 'car': this environment is for 'ship'"),
    ({"scenario": "ship-underway"}, "needs a vehicle in place"),
    ({"vehicle": 3}, "vehicle = 3: allowed is a kind of vehicle or ''"),
    ({"duration_s": "60"}, "duration_s = '60': allowed is a number from one step, "),
    ({"duration_s": 1e-9}, "duration_s = 1e-09 s"),
    ({"samples_per_step": True}, "samples_per_step = True: allowed is a whole number from 1"),
    ({"imu": "gold"}, "gold"),
    ({"imu": "navigation", "imu_range": ("marine", "tactical")}, "('marine', 'tactical') with imu = 'navigation': "),
    ({"imu_sheet": "middle"}, "imu_sheet = 'middle' with imu = None: a unit is drawn only with imu="),
    ({"imu": "random", "imu_range": ("tactical", "marine")}, "imu_range = ('tactical', 'marine'): allowed is two grades"),
    ({"heading_deg": (10.0, 5.0)}, "heading_deg = (10.0, 5.0)"),
    ({"initial_error": (0.0, 5.0)}, "initial_error = (0.0, 5.0)"),
    ({"gnss_outages_s": ((1, 2), (3,))}, "gnss_outages_s = ((1, 2), (3,)): allowed is a sequence of pairs (begin, end)"),
    ({"gnss_outages_s": tuple((i, i + 0.5) for i in range(100))}, "gnss_outages_s has 100 outages: allowed are at most "),
    ({"gnss_outages_s": ((1.0, 2.0),)}, "no [gnss]"),
    ({"backend": "quantum"}, "quantum"),
    ({"dtype": "float16"}, "dtype = 'float16': allowed is 'float64' or 'float32'"),
]  # fmt: skip
SINGLE = [({"render_mode": "x"}, "render_mode = 'x': allowed is 'rgb_array' or 'ansi'")]
VECTOR = [
    ({"num_envs": 0}, "num_envs = 0: allowed is a whole number from 1"),
    ({"autoreset_mode": "nosuch"}, "autoreset_mode = 'nosuch': allowed is 'NextStep' or 'SameStep' or 'Disabled'"),
    ({"render_mode": "rgb_array"}, "render_mode = 'rgb_array': allowed is None"),
]
OWN = [
    (AlignmentEnv, {"sway_phases": 1}, "sway_phases = 1: allowed is True or False"),
    (AlignmentEnv, {"mounting_deg": -1.0}, "mounting_deg = -1.0 deg: allowed is a number from 0 to 80 deg"),
    (NavigationEnv, {"scenario": "aircraft-free-inertial", "vehicle": "aircraft"}, "needs GNSS fixes: scenario 'aircraft-free"),
    (ManoeuvreEnv, {"start_speed_mps": 3.0}, "start_speed_mps = 3.0: allowed is a pair (low, high) of numbers from 0 to 340"),
    (ManoeuvreEnv, {"goal_deg": 0}, "goal_deg = 0 deg: allowed is a number above 0 up to 180 deg"),
    (ManoeuvreEnv, {"reward": ["dense"]}, "reward = ['dense']: allowed is 'final', 'dense', 'uncertainty' or a function"),
    (TuningEnv, {"reward": "uncertainty"}, "reward = 'uncertainty': allowed is 'final', 'dense' or a function of the info"),
    (ManoeuvreEnv, {"estimator": "wander-sins"}, "loosely-coupled, aqe-ekf, aqe-sukf"),
    (ManoeuvreEnv, {"scenario": "ship-underway"}, "a vehicle that an agent steers (car, aircraft"),
    (FaultTuningEnv, {"faults": 1}, "faults = 1: allowed is True or False"),
    (FaultTuningEnv, {"spread_decades": 3.0}, "spread_decades = 3.0: allowed is a number from 0 to 2"),
    (TuningEnv, {"estimator": "nothing"}, "estimator = 'nothing': allowed are filters that can run inside this environment: "),
    (TuningEnv, {"scenario": "ship-swaying"}, "has no [gnss]"),
    (TuningEnv, {"mistuning_decades": np.nan}, "mistuning_decades = nan"),
    (TuningEnv, {"reward": lambda: 3}, "allowed is 'final', 'dense' or a function of the info that returns a number"),
    (TuningEnv, {"vehicle": "boat"}, "vehicle = 'boat': no such kind (allowed: ship, car, aircraft"),
    (TuningEnv, {"backend": "nosuch"}, "backend = 'nosuch': allowed is native or interpreter"),
    (TuningEnv, {"vary": {"gnss.grde": (0, 1)}}, "vary gnss.grde=uniform(0, 1): no key 'grde'; did you mean 'grade'? (allowed"),
    (TuningEnv, {"vary": {"gnns.grade": (0, 1)}}, "such as 'imu.gyro_bias_deg_h'; did you mean 'gnss'?"),
    (TuningEnv, {"consistency_weight": np.zeros(2)}, "consistency_weight = array([0., 0.]): allowed is a number"),
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
        wrong = "got an unexpected keyword argument 'samples_per_stepp'; did you mean 'samples_per_step'? (allowed: "
        refuses(lambda kind=kind: kind(samples_per_stepp=3), f"{kind.__name__} {wrong}")
    with pytest.raises(TypeError, match="got an unexpected keyword argument 'frameskip'"):  # TorchRL tries it, and reads this
        gymnasium.make("insenv/ShipAlignment-v0", frameskip=1)


@pytest.mark.filterwarnings("error")
def test_what_methods_refuse():
    envs = single, vector = AlignmentEnv(**SHORT), AlignmentVectorEnv(2, **SHORT)
    options = {
        "options = 3: allowed is a mapping": 3,
        "options: unknown option 'heading'; did you mean 'heading_deg'? (allowed: imu": {"heading": 3.0},
        "gold": {"imu": "gold"},
        "sea_state = (11, 11)": {"sea_state": 11},
        "heading_deg = [10, 20]: allowed is a number for all episodes of this reset, or a tuple": {"heading_deg": [10, 20]},
        "run_seed = -1": {"run_seed": -1},
    }
    for env in envs:
        for message, given in options.items():
            refuses(lambda env=env, given=given: env.reset(options=given), message)
        refuses(lambda env=env: env.set_ranges(dtype="float32"), "set_ranges: 'dtype' is not an argument that can vary")
        refuses(lambda env=env: env.set_ranges(imu="gold"), "gold")
        assert env.imu is None
        for wrong in ("a", 3.0, [1.0, 2.0]):
            refuses(lambda env=env, wrong=wrong: env.named(wrong), "observation = 'a'" if wrong == "a" else "vector of shape")
        refuses(lambda env=env: env.restore("x"), "snapshot = 'x': allowed is a Snapshot")
        env.reset(seed=1)
        action = np.zeros(env.action_space.shape).astype(complex)
        refuses(lambda env=env, action=action: env.step(action), "action = array(")
    for seed in (2.5, [1]):
        refuses(lambda seed=seed: vector.reset(seed=seed), f"seed = {seed!r}: allowed is a whole number from 0")
    refuses(lambda: vector.restore(single.snapshot()), "snapshot")
    wrong = "estimate_q_nb = array([0., 0., 0.]): allowed is numbers of shape (4,)"
    refuses(lambda: estimate_action(single.setup.task, np.zeros(3)), wrong)
