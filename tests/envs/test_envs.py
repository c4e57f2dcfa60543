"""Every environment keeps Gymnasium's contract, inside wrappers too; the kit finds environments that do not."""

import sys

import gymnasium
import peers
import pytest

from insenv.envs import IDS, testing
from insenv.sensors.registry import instruments

SHIP, DRIVE = "insenv/ShipAlignment-v0", "insenv/VehicleNavigation-v0"
SHORT = {"samples_per_step": 7, "duration_s": 0.3}
RANDOM = {"imu": "random", "heading_deg": (0.0, 360.0), "sea_state": (0.5, 1.5), "initial_error": (1.0, 90.0)}
OWN = (SHIP, DRIVE, "insenv/FaultTuning-v0")
"""The others are these with another vehicle, without faults, or in test_manoeuvre.py."""
COMPACT = {"observation": "compact", "action": "correction"}


@pytest.mark.parametrize(
    ("id", "more"),
    [pytest.param(id, {}, marks=() if id in OWN else pytest.mark.slow) for id in IDS]
    + [
        (SHIP, RANDOM), (SHIP, {**COMPACT, "dtype": "float32"}),
        *(pytest.param(SHIP, more, marks=pytest.mark.slow) for more in (COMPACT, {"observation": "compact"})),
    ],
)  # fmt: skip
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
    peers.ran(sys.executable, "-c", TORCHRL)


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
