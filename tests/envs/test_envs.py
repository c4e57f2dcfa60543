"""Every environment keeps Gymnasium's contract, inside wrappers too; the kit finds environments that do not."""

import copy
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import peers
import pytest
from gymnasium.error import ResetNeeded

from insenv.base.errors import InputError
from insenv.envs import IDS, testing
from insenv.sensors.registry import instruments

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
LEVEL = np.array([1.0, 0.0, 0.0, 0.0, -1.0])
RANDOM = {"imu": "random", "heading_deg": (0.0, 360.0), "sea_state": (0.5, 1.5), "initial_error": (1.0, 90.0)}
COMPACT = {"observation": "compact", "action": "correction"}


@pytest.mark.parametrize(
    ("id", "more"),
    [(id, {}) for id in IDS]
    + [(SHIP, RANDOM), (SHIP, COMPACT), (SHIP, {**COMPACT, "dtype": "float32"}), (SHIP, {"observation": "compact"})],
)
def test_every_environment_conforms(id, more):
    testing.check_id(id, **SHORT, **more)


@pytest.mark.slow
@pytest.mark.parametrize("id", IDS)
def test_every_compiled_environment_conforms_and_is_bit_identical_to_the_interpreter(id):
    testing.check_id(id, **SHORT, backend="native")
    envs = [gymnasium.make(id, backend=backend, **SHORT) for backend in ("native", "interpreter")]
    testing.assert_same(*(testing.episodes(env, 3) for env in envs), "native and interpreter")


def test_the_kit_finds_environments_that_ignore_seeds():
    class Deaf(gymnasium.Wrapper):
        def reset(self, *, seed=None, options=None):
            return self.env.reset(seed=None if seed is None else 1, options=options)

    with pytest.raises(AssertionError, match="the seed is not used"):
        testing.check_deterministic(lambda: Deaf(gymnasium.make(SHIP, **SHORT)))


def test_import_registers_and_the_specification_knows_the_steps_of_an_episode():
    from insenv.envs import register

    before = dict(gymnasium.envs.registration.registry)
    register()
    assert gymnasium.envs.registration.registry == before
    env = gymnasium.make("insenv:insenv/ShipAlignment-v0", **SHORT)
    assert env.spec.id == SHIP and env.spec.max_episode_steps == 8
    assert gymnasium.make_vec(SHIP, 2, **SHORT).spec.max_episode_steps == 8


def test_an_argument_that_a_library_tries_is_a_type_error_in_the_words_of_python():
    """TorchRL passes frameskip first and reads the message; Gymnasium makes an error of the same type with one argument."""
    with pytest.raises(TypeError, match="got an unexpected keyword argument 'frameskip'") as raised:
        gymnasium.make(SHIP, frameskip=1, **SHORT)
    assert isinstance(raised.value, InputError)


TORCHRL = """
import gymnasium, numpy as np, insenv
from torchrl.envs.libs.gym import GymEnv, GymWrapper
SHIP, SHORT = "insenv/ShipAlignment-v0", {"samples_per_step": 7, "duration_s": 0.3}
batch = GymWrapper(gymnasium.make_vec(SHIP, 3, autoreset_mode="Disabled", **SHORT))
for env, plain in ((GymEnv(SHIP, **SHORT), gymnasium.make(SHIP, **SHORT)), (batch, gymnasium.make_vec(SHIP, 3, **SHORT))):
    env.set_seed(4)
    plain.reset(seed=4)
    found, expected = env.rollout(12, break_when_any_done=False), plain.reset()[0]
    for k in range(12):
        seen = found[..., k]
        assert np.array_equal(seen["observation"].numpy(), expected), k
        expected, _, terminated, truncated, _ = plain.step(seen["action"].numpy())
        if np.any(terminated | truncated):
            break
    assert found["next", "done"].any(dim=-2).all()
"""


@pytest.mark.slow
def test_torchrl_takes_an_environment_and_a_batch():
    peers.package("torchrl", "pip install -e '.[rl]'")
    done = subprocess.run([sys.executable, "-c", TORCHRL], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_step_before_reset_and_after_the_end():
    env = gymnasium.make(SHIP, **SHORT).unwrapped
    with pytest.raises(ResetNeeded, match="before reset"):
        env.step(LEVEL)
    env.reset(seed=1)
    env.step(np.array([1.0, 0, 0, 0, 1.0]))
    with pytest.raises(ResetNeeded, match="after the end"):
        env.step(LEVEL)


def test_a_wrong_action_is_an_error_and_changes_nothing():
    env, other = (gymnasium.make(SHIP, **SHORT) for _ in range(2))
    for e in (env, other):
        e.reset(seed=1)
    with pytest.raises(InputError, match=r"shape \(4,\): allowed is \(5,\)"):
        env.step(np.zeros(4))
    testing.assert_same([env.step(LEVEL)], [other.step(LEVEL)], "after a wrong action")


def test_observations_show_the_measurements_of_instruments_and_no_truth():
    scenario = {
        "title": "Car", "duration_s": 20.0, "rate_hz": 100.0, "start": {"latitude_deg": 48.0, "longitude_deg": 11.0},
        "vehicle": {"kind": "car", "legs": [{"accelerate_to_mps": 15.0}, {"drive_s": 60.0}]}, "imu": {"grade": "tactical"},
        "gnss": {"grade": "rtk"}, **{id: {} for id in instruments()},
    }  # fmt: skip
    env = gymnasium.make(DRIVE, scenario=scenario, samples_per_step=10)
    names = env.unwrapped.setup.task.watched.names
    for instrument in instruments().values():
        assert set(instrument.measurement.names) <= set(names)
    assert not [name for name in names if "true" in name]


def test_copies_pickles_and_snapshots_of_batches_continue_bit_identically():
    for id in (SHIP, DRIVE):
        venv = gymnasium.make_vec(id, 3, **SHORT)
        venv.reset(seed=2)
        actions = np.zeros(venv.action_space.shape)
        actions[:, 0], actions[:, -1] = 1.0, -1.0
        for _ in range(4):
            venv.step(actions)
        restored = gymnasium.make_vec(id, 3, **SHORT)
        restored.restore(venv.snapshot())
        copies = [pickle.loads(pickle.dumps(venv)), copy.deepcopy(venv), restored]
        for _ in range(10):  # beyond the end of an episode
            expected = testing.row_of(venv.step(actions), slice(3))
            for other in copies:
                testing.assert_same([expected], [testing.row_of(other.step(actions), slice(3))], "a copy")
