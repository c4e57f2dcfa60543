"""The conformance kit: the properties that every environment of insenv has, as checks that raise `AssertionError`.

The kit also checks user-defined environments: ``check(MyEnv, lambda n, **options: MyVectorEnv(n, **options))``, or by a
registered id ``check_id("my/Env-v0")``.  Each check is independent; `check` runs all of them.
"""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from insenv.base.errors import InputError

Make = Callable[..., Any]


def check_id(id: str, **kwargs: Any) -> None:
    """Run all checks on a registered environment made with `kwargs`."""
    check_spec(id, **kwargs)

    def vector(num_envs: int, **more: Any) -> Any:
        return gymnasium.make_vec(id, num_envs, **kwargs, **more)

    check(partial(gymnasium.make, id, **kwargs), vector)


def check(make: Make, make_vector: Make | None = None) -> None:
    """Run all checks on environments from `make()` and on batches from `make_vector(num_envs, autoreset_mode=...)`."""
    check_contract(make)
    check_misuse(make)
    check_deterministic(make)
    check_snapshot(make)
    check_pickling(make)
    if make_vector is not None:
        check_rows(make, make_vector)
        check_disabled_autoreset(make_vector)
        check_batch_copies(make_vector)


def check_contract(make: Make) -> None:
    """Run Gymnasium's checker with warnings as errors; check bounds, the action space and the keys of info."""
    env = make()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # rendering is tested separately
        check_env(env.unwrapped, skip_render_check=True)
    for space in (env.action_space, env.observation_space):
        assert isinstance(space, gymnasium.spaces.Box), f"space {space}: a Box is expected"
        assert np.isfinite(space.low).all() and np.isfinite(space.high).all(), f"space {space} has bounds that are not finite"
        assert space.dtype in (np.float64, np.float32), f"space {space} is neither of float64 nor of float32"
    assert np.all(env.action_space.low == -1.0) and np.all(env.action_space.high == 1.0), "actions are not in [-1, 1]"
    observation, info = env.reset(seed=0)
    keys, inside = set(info), env.observation_space.contains(observation)
    for action in _actions(env.action_space, 20):
        observation, reward, terminated, truncated, info = env.step(action)
        inside = inside and env.observation_space.contains(observation)
        assert set(info) == keys, f"info has {sorted(info)} after step and {sorted(keys)} after reset"
        assert np.isfinite(reward), f"reward {reward}"
        if terminated or truncated:
            env.reset()
    assert inside, "an observation lies outside its space"


def check_misuse(make: Make) -> None:
    """Check that steps outside an episode and actions of another shape are refused, and that these change nothing."""
    env, other = make(), make()
    _refused(env.unwrapped.step, env.action_space.sample(), ResetNeeded, "a step before the first reset")
    for each in (env, other):
        each.reset(seed=1)
    _refused(env.step, np.zeros(env.action_space.shape[0] + 1), InputError, "an action of another shape")
    action, over = _actions(env.action_space, 1)[0], False
    assert_same([env.step(action)], [other.step(action)], "after a refused action")
    while not over:
        *_, terminated, truncated, _ = env.unwrapped.step(action)
        over = terminated or truncated
    _refused(env.unwrapped.step, action, ResetNeeded, "a step after the end")


def _refused(step: Callable[[Any], Any], action: Any, error: type[Exception], what: str) -> None:
    try:
        step(action)
    except error:
        return
    raise AssertionError(f"{what} raises no {error.__name__}")


def check_deterministic(make: Make) -> None:
    """Check that equal seeds give bit-identical episodes, other seeds differ, and seed None continues the sequence."""
    one, other = (episodes(make(), 7) for _ in range(2))
    assert_same(one, other, "two environments with one seed")
    assert not _same(one, episodes(make(), 8)), "seeds 7 and 8 give the same episodes: the seed is not used"
    env = make()
    env.reset(seed=3)
    first = _rollout(env, 5)
    env.reset()
    assert not _same(first, _rollout(env, 5)), "reset() without a seed repeats the episode"


def check_snapshot(make: Make) -> None:
    """Check that a snapshot restored here or in another environment continues bit-identically."""
    env, other = make(), make()
    env.reset(seed=5)
    _rollout(env, 3)
    snapshot = env.unwrapped.snapshot()
    expected = _rollout(env, 6), episodes(env, None)
    other.reset(seed=99)
    for restored in (env, other):
        restored.unwrapped.restore(pickle.loads(pickle.dumps(snapshot)))
        assert_same(expected[0], _rollout(restored, 6), "a restored environment")
        assert_same(expected[1], episodes(restored, None), "the episodes after a restored one")


def check_pickling(make: Make) -> None:
    """Check that a pickled environment continues bit-identically."""
    env = make()
    env.reset(seed=11)
    _rollout(env, 2)
    copied = pickle.loads(pickle.dumps(env.unwrapped))
    assert_same(_rollout(env, 6), _rollout(copied, 6), "a pickled environment")


def check_spec(id: str, **kwargs: Any) -> None:
    """Check that the spec survives JSON and then makes the same environment."""
    env = gymnasium.make(id, **kwargs)
    assert env.spec is not None
    spec = gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert_same(episodes(env, 2), episodes(gymnasium.make(spec), 2), "an environment made of its spec's JSON")


def check_rows(make: Make, make_vector: Make, num_envs: int = 5, steps: int = 12) -> None:
    """Check that row i of a batch and row i of a SyncVectorEnv are bit-identical, for batches of two widths.

    The comparison continues over the ends of episodes.  SyncVectorEnv resets its single environments with seed + i.
    """
    interfaces = {
        "make_vec": make_vector(num_envs),
        "make_vec, one row more": make_vector(num_envs + 1),
        "SyncVectorEnv": SyncVectorEnv([make] * num_envs, autoreset_mode=AutoresetMode.NEXT_STEP),
    }
    space = interfaces["make_vec"].single_action_space
    actions = np.stack([_actions(space, steps, seed) for seed in range(num_envs + 1)], axis=1)
    compared = {}
    for name, interface in interfaces.items():
        rows = interface.num_envs
        observations, infos = interface.reset(seed=40)
        results = [(observations, np.zeros(rows), np.zeros(rows), np.zeros(rows), infos)]
        results += [interface.step(action[:rows]) for action in actions]
        compared[name] = [row_of(step, slice(0, num_envs)) for step in results]
        interface.close()
    assert_same(compared["make_vec"], compared["SyncVectorEnv"], "make_vec and SyncVectorEnv")
    assert_same(compared["make_vec"], compared["make_vec, one row more"], "batches of other widths")


def check_disabled_autoreset(make_vector: Make, num_envs: int = 4) -> None:
    """Check that with autoreset DISABLED a mask restarts ended rows and leaves the others unchanged."""
    venv = make_vector(num_envs, autoreset_mode=AutoresetMode.DISABLED)
    venv.reset(seed=1)
    action = np.stack([_actions(venv.single_action_space, 1, seed)[0] for seed in range(num_envs)])
    for _ in range(100_000):
        _, _, terminated, truncated, _ = venv.step(action)
        if np.any(over := terminated | truncated):
            break
    before = venv.snapshot()
    venv.reset(options={"reset_mask": over})
    after = venv.snapshot()
    assert np.array_equal(before.state[~over], after.state[~over]), "reset_mask changed rows outside the mask"
    assert not np.array_equal(before.state[over], after.state[over]), "reset_mask left rows of the mask as they were"
    venv.step(action)


def check_batch_copies(make_vector: Make, num_envs: int = 3, steps: int = 10) -> None:
    """Check that a pickled, a copied and a restored batch continue bit-identically, over the ends of episodes."""
    venv, restored = make_vector(num_envs), make_vector(num_envs)
    venv.reset(seed=2)
    actions = np.stack([_actions(venv.single_action_space, steps, seed) for seed in range(num_envs)], axis=1)
    venv.step(actions[0])
    restored.unwrapped.restore(venv.unwrapped.snapshot())
    batches = [venv.unwrapped, pickle.loads(pickle.dumps(venv.unwrapped)), copy.deepcopy(venv.unwrapped), restored.unwrapped]
    expected, *others = ([row_of(each.step(action), slice(num_envs)) for action in actions] for each in batches)
    for other in others:
        assert_same(expected, other, "a copy of a batch")


def _actions(space: Any, count: int, seed: int = 0) -> Any:
    """Return actions inside the space, of which few end an episode."""
    generator = np.random.default_rng(seed)
    actions = generator.uniform(-1.0, 1.0, (count, *space.shape))
    actions[..., -1] = -np.abs(actions[..., -1])
    return actions


def _rollout(env: Any, steps: int) -> list[Any]:
    results = []
    for action in _actions(env.action_space, steps):
        results.append(env.step(action))
        if results[-1][2] or results[-1][3]:
            results.append(env.reset())
    return results


def episodes(env: Any, seed: int | None) -> list[Any]:
    """Return the results of a few steps after `reset(seed=seed)` and after a reset without a seed."""
    results: list[Any] = []
    for again in (seed, None):
        results += [env.reset(seed=again), *_rollout(env, 4)]
    return results


def row_of(step: tuple[Any, ...], rows: slice) -> list[Any]:
    """Return some rows of a result of a vector environment's `reset` or `step`."""
    *arrays, infos = step
    info = {key: value[rows] for key, value in infos.items() if not key.startswith("_") and not key.startswith("final_")}
    return [np.asarray(array)[rows] for array in arrays] + [info]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return set(one) == set(other) and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(_same(a, b) for a, b in zip(one, other, strict=True))
    return bool(np.array_equal(np.asarray(one, dtype=float), np.asarray(other, dtype=float)))


def assert_same(one: list[Any], other: list[Any], what: str) -> None:
    """Raise `AssertionError` unless two lists of results are bit-identical; `what` begins the message."""
    assert len(one) == len(other), f"{what}: {len(one)} and {len(other)} steps"
    for k, (a, b) in enumerate(zip(one, other, strict=True)):
        assert _same(a, b), f"{what}: step {k} differs: {a} and {b}"
