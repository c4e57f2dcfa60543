"""An environment's batch as a `VecEnv` of Stable-Baselines3: one call steps all rows in compiled code.

    from insenv.envs.sb3 import BatchVecEnv
    venv = BatchVecEnv("insenv/ShipAlignment-v0", 48, observation="compact", action="correction", dtype="float32")
    PPO("MlpPolicy", venv).learn(400_000)

Ended rows restart within the step.  At the end of the time an alignment is over, and its score is complete, as is that of every
episode with final rewards: a learner should not add the value of what would have come next.  `time_is_terminal` says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from insenv.base.errors import InputError
from insenv.base.installing import need
from insenv.envs.single import Interface

need("insenv.envs.sb3", "stable_baselines3", package="Stable-Baselines3", extra="rl")
from stable_baselines3.common.vec_env import VecEnv  # type: ignore[import-not-found,unused-ignore]  # noqa: E402

Indices = int | Iterable[int] | None


class BatchVecEnv(VecEnv):
    """The batch of an environment id for Stable-Baselines3.

    id: a registered id; further arguments are those of `gymnasium.make_vec`.  num_envs: number of rows.  time_is_terminal:
    whether the end of the time counts as the end of the task (None: for alignments and with final rewards).  seed:
    of the first reset: row i has seed + i.
    """

    def __init__(
        self, id: str, num_envs: int, *, time_is_terminal: bool | None = None, seed: int | None = None, **kwargs: Any
    ) -> None:
        self.venv: Any = gymnasium.make_vec(id, num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **kwargs)
        if not isinstance(self.venv.unwrapped, Interface):
            raise InputError(f"id = {id!r}: allowed is an environment of insenv")
        complete = "declared" in self.venv.unwrapped.setup.task.info or self.venv.unwrapped.reward == "final"
        self.time_is_terminal = complete if time_is_terminal is None else time_is_terminal
        self.render_mode = None
        super().__init__(num_envs, self.venv.single_observation_space, self.venv.single_action_space)
        self._actions = np.zeros((num_envs, self.venv.unwrapped.setup.task.actions.size))
        if seed is not None:
            self.seed(seed)

    def reset(self) -> Any:
        """Start all rows; the seeds of `seed` count once, as in Stable-Baselines3."""
        observations, _ = self.venv.reset(seed=list(self._seeds))
        self.reset_infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Any) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = np.asarray(actions)

    def step_wait(self) -> Any:
        """Step all rows: observations, rewards, whether rows have ended, and an info for each row.

        The info of an ended row has "terminal_observation" and "TimeLimit.truncated", and the last info of the episode.
        """
        observations, reward, terminated, truncated, step_infos = self.venv.step(self._actions)
        over: Any = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(over):
            last = {name: value[row] for name, value in step_infos["final_info"].items() if not name.startswith("_")}
            cut = bool(truncated[row] and not terminated[row] and not self.time_is_terminal)
            infos[row] = {**last, "terminal_observation": step_infos["final_obs"][row], "TimeLimit.truncated": cut}
        return observations, reward.astype(np.float32), over, infos

    def close(self) -> None:
        """Close the batch."""
        self.venv.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return an attribute of the batch, once for each row of `indices`."""
        return [getattr(self, attr_name, None) if attr_name == "render_mode" else getattr(self.venv, attr_name)] * len(
            self._rows(indices)
        )

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Change an argument that says what varies between episodes, for all rows (`set_ranges` of the environment)."""
        self._check_all(f"set_attr({attr_name!r})", indices)
        self.venv.unwrapped.set_ranges(**{attr_name: value})

    def env_method(self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the batch, such as `set_ranges`, once for all rows; return its result for each row."""
        self._check_all(f"env_method({method_name!r})", indices)
        return [getattr(self.venv.unwrapped, method_name)(*method_args, **method_kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:
        """Return False for each row."""
        return [False] * len(self._rows(indices))

    def _check_all(self, what: str, indices: Indices) -> None:
        if sorted(self._rows(indices)) != list(range(self.num_envs)):
            raise InputError(f"{what} of rows {self._rows(indices)}: the rows share one batch; allowed is all of them")

    def _rows(self, indices: Indices) -> Sequence[int]:
        return list(self._get_indices(indices))
