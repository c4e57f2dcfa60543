"""Speed of the environments: one through `gymnasium.make`, many in a batch, with an estimator in the loop, and their creation.

Floors: an environment with the same spaces that returns a copy of a constant observation; a batch of the empty model.  Peers,
stepped by the same loops: Gymnasium's CartPole and Pendulum, and EnvPool's CartPole if it is installed.
"""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np

from insenv.bench.figure import EMPTY, Figure, median_time
from insenv.core.batch import make_batch
from insenv.envs import AlignmentEnv, agents

ID = "insenv/ShipAlignment-v0"
REPETITIONS = 9
ROWS = 1024
FEW = 8
STARTED = 64
SAMPLES = 100
LEVEL = np.array([1.0, 0.0, 0.0, 0.0, -1.0])
LONG = 3600.0
"""Length of an episode, s: no episode ends during a measurement.  Its limit, computed at the first reset, takes the longer the
longer it is."""


class Constant(gymnasium.Env[Any, Any]):
    """An environment with the spaces of another that does nothing."""

    def __init__(self, like: Any) -> None:
        self.action_space, self.observation_space = like.action_space, like.observation_space
        self._shown = np.zeros(like.observation_space.shape)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """A copy of the constant observation."""
        super().reset(seed=seed)
        return self._shown.copy(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """A copy of the constant observation."""
        return self._shown.copy(), 0.0, False, False, {}


def _step_time(env: Any, action: Any, count: int) -> float:
    env.reset(seed=1)
    return median_time(lambda: env.step(action), REPETITIONS, count)


def single() -> Figure:
    """One inertial sample per step, native, flat observation."""
    env = gymnasium.make(ID, samples_per_step=1, duration_s=LONG)
    floor = gymnasium.wrappers.OrderEnforcing(Constant(env))
    value, least, peer = _step_time(env, LEVEL, 4000), _step_time(floor, LEVEL, 4000), _classic("CartPole-v1", 0)
    note = "gym.make, 1 sample per step; floor: an empty environment"
    return Figure(1 / value, 1 / least, REPETITIONS, note, ("CartPole-v1", 1 / peer))


def hundred() -> Figure:
    """A hundred inertial samples per step."""
    env = gymnasium.make(ID, samples_per_step=SAMPLES, duration_s=LONG)
    floor = gymnasium.wrappers.OrderEnforcing(Constant(env))
    value, least = (_step_time(e, LEVEL, 300) * 1e6 for e in (env, floor))
    peer = _classic("Pendulum-v1", np.zeros(1, dtype=np.float32)) * 1e6
    return Figure(value, least, REPETITIONS, "gym.make, 100 samples per step", ("Pendulum-v1", peer))


DRAWN = 40
"""Steps that are drawn."""


def frame() -> Figure:
    """An image of each step of a drive, those with which bounds grow included; the floor is a copy of the pixels."""
    env = gymnasium.make("insenv/VehicleNavigation-v0", render_mode="rgb_array", samples_per_step=200).unwrapped
    ahead = np.eye(env.action_space.shape[0])[0]  # type: ignore[index]

    def episode() -> None:
        env.reset(seed=1)
        for _ in range(DRAWN):
            env.step(ahead)
            env.render()

    episode()
    value = median_time(episode, 5, 1) / DRAWN * 1e3
    image: Any = env.render()
    least = median_time(image.copy, 5, 100) * 1e3
    return Figure(value, least, 5, f"render, {DRAWN} steps of VehicleNavigation-v0, a step; floor: a copy of the pixels")


DRAWN_BY_A_RESET = "a whole number and three uniforms of its generator"


def _drawn(generator: np.random.Generator) -> object:
    return generator.integers(0, 2**53), generator.random(3)


def reset() -> Figure:
    """The start of one environment; the floor is what its own random generator takes."""
    env = gymnasium.make(ID)
    env.reset(seed=1)
    generator = np.random.default_rng(1)
    value, least = (median_time(call, REPETITIONS, 30) * 1e6 for call in (env.reset, lambda: _drawn(generator)))
    return Figure(value, least, REPETITIONS, f"reset of {ID}; floor: {DRAWN_BY_A_RESET}")


def _classic(id: str, action: Any) -> float:
    """Time of a step of a classic environment, including its resets."""
    env = gymnasium.make(id)
    env.reset(seed=1)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return median_time(step, REPETITIONS, 3000)


def small() -> Figure:
    """A step of few rows and one sample: what is the same for any number of rows."""
    venv, actions = _vector(1, FEW), np.tile(LEVEL, (FEW, 1))
    cart = gymnasium.make_vec("CartPole-v1", FEW, vectorization_mode="vector_entry_point")
    cart.reset(seed=1)
    push = np.zeros(FEW, dtype=np.int64)
    empty, _ = make_batch(EMPTY, FEW).cycle("sample", EMPTY.state.names, 1)
    value, peer, least = (
        median_time(call, REPETITIONS, 1000) * 1e6 for call in (lambda: venv.step(actions), lambda: cart.step(push), empty)
    )
    note = f"make_vec, {FEW} rows, 1 sample per step; floor: the batch of an empty model"
    return Figure(value, least, REPETITIONS, note, ("CartPole-v1 of Gymnasium", peer))


def resetting(id: str) -> Figure:
    """The start of a row of a batch; the floor is what its own random generator takes."""
    venv = gymnasium.make_vec(id, STARTED)
    venv.reset(seed=1)
    generators = [np.random.default_rng(seed) for seed in range(STARTED)]
    value = median_time(venv.reset, REPETITIONS, 3) / STARTED * 1e6
    least = median_time(lambda: list(map(_drawn, generators)), REPETITIONS) / STARTED * 1e6
    note = f"reset of {STARTED} rows of {id}, a row; floor: {DRAWN_BY_A_RESET}"
    return Figure(value, least, REPETITIONS, note)


def _vector(samples: int, rows: int = ROWS) -> Any:
    venv = gymnasium.make_vec(ID, rows, samples_per_step=samples, duration_s=LONG)
    venv.reset(seed=1)
    return venv


def plant() -> Figure:
    """1024 rows on one core, no estimator."""
    venv, actions = _vector(SAMPLES), np.tile(LEVEL, (ROWS, 1))
    value = ROWS * SAMPLES / median_time(lambda: venv.step(actions), REPETITIONS)
    empty = make_batch(EMPTY, ROWS)
    least = ROWS * SAMPLES / median_time(lambda: empty.run(SAMPLES), REPETITIONS)
    cart = gymnasium.make_vec("CartPole-v1", ROWS, vectorization_mode="vector_entry_point")
    cart.reset(seed=1)
    push = np.zeros(ROWS, dtype=np.int64)
    peer = (
        "CartPole-v1 of Gymnasium, one step counted as a sample",
        ROWS / median_time(lambda: cart.step(push), REPETITIONS, 30),
    )
    note = f"make_vec, {ROWS} rows, {SAMPLES} samples per step, one core" + _envpool()
    return Figure(value, least, REPETITIONS, note, peer)


def _envpool() -> str:
    if find_spec("envpool") is None:
        return ""
    import envpool

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about its spaces
        pool = envpool.make("CartPole-v1", env_type="gymnasium", num_envs=ROWS, num_threads=1)
    pool.reset()
    push = np.zeros(ROWS, dtype=np.int32)
    return f"; EnvPool CartPole-v1: {ROWS / median_time(lambda: pool.step(push), REPETITIONS, 10):.3g} steps/s"


def q_method() -> Figure:
    """1024 rows on one core, the q-method agent in the loop."""
    venv = _vector(SAMPLES)
    agent = agents.make("q-method", venv)
    observation, _ = venv.reset(seed=1)
    seen = [observation]

    def step() -> None:
        seen[0] = venv.step(agent.act(seen[0]))[0]

    value = ROWS * SAMPLES / median_time(step, REPETITIONS)
    least = plant().value
    return Figure(value, least, REPETITIONS, f"{ROWS} rows, {SAMPLES} samples per step; floor: no agent")


def making() -> Figure:
    """Creation of 1024 rows whose code is compiled already."""
    value = median_time(lambda: gymnasium.make_vec(ID, ROWS), REPETITIONS)
    least = median_time(lambda: AlignmentEnv("ship-swaying"), REPETITIONS)
    note = f"make_vec of {ROWS} rows, warm; floor: one single environment"
    return Figure(value, least, REPETITIONS, note)
