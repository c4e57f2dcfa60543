"""Train PPO to align a swaying ship from twelve moments of gravity, and compare it with estimators on held-out seeds.

pip install -e '.[rl,plot]'
python examples/train_aligner.py --steps 720000 --out aligner
"""

import argparse
import sys
from pathlib import Path

import gymnasium
import numpy as np

from insenv.base.errors import InputError
from insenv.envs import agents

ID = "insenv/ShipAlignment-v0"
EPISODE = {"samples_per_step": 1000, "initial_error": (20.0, 180.0)}  # 60 steps of 5 s
COMPACT = {"observation": "compact", "action": "correction", "dtype": "float32"}
HELD_OUT, CHOICE, SEEDS, ROWS = 1_000_000, 500_000, 64, 48
EVERY = 50_000  # steps of training between two points of the learning curve


def scores(policy, seed=HELD_OUT, **options):
    """Return the scores of the seeds from `seed` on, -(m of the last estimate + share of the time used)."""
    venv = gymnasium.make_vec(ID, SEEDS, **EPISODE, **options)
    observation, _ = venv.reset(seed=seed)
    total, over = np.zeros(SEEDS), np.zeros(SEEDS, dtype=bool)
    act = policy(venv)
    while not over.all():
        observation, reward, terminated, truncated, _ = venv.step(act(observation))
        total += np.where(over, 0.0, reward)
        over |= terminated | truncated
    return total


def by_hand(venv):
    """Turn by what gravity shows, and declare at 150 s: the gain of 1.1 and the time are the best on other seeds."""

    def act(observation):
        seen = venv.unwrapped.named(observation)
        (north, east), slope = seen["vertical_level"].T, seen["slope_level"][:, 0]
        return np.stack([-east, north, 1.1 * slope, 2.0 * (seen["time_share"] >= 0.5) - 1.0], axis=1).clip(-1.0, 1.0)

    return act


def q_method(declare_after_s=None):
    """Return the policy of the q-method that declares after a time, or at the end."""
    return lambda venv: agents.make("q-method", venv, declare_after_s=declare_after_s).act


def train(steps, seed):
    """Return the policy trained for some steps, and the learning curve: steps, mean score."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    from insenv.envs.sb3 import BatchVecEnv

    torch.set_num_threads(1)
    # dense rewards for training alone: the policy does not see them, and is scored by its returns without them
    batch = VecNormalize(BatchVecEnv(ID, ROWS, seed=0, reward="dense", **EPISODE, **COMPACT), gamma=0.95)
    model = PPO(
        "MlpPolicy", batch, n_steps=60, batch_size=480, n_epochs=8, gamma=0.95, gae_lambda=0.95, learning_rate=1e-3,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -0.7}, seed=seed, device="cpu",
    )  # fmt: skip

    def policy(venv):
        def act(observation):
            return model.predict(batch.normalize_obs(observation), deterministic=True)[0]

        return act

    curve = []

    class Curve(BaseCallback):
        def _on_rollout_start(self):
            if self.num_timesteps >= len(curve) * EVERY:
                curve.append((self.num_timesteps, scores(policy, **COMPACT).mean()))
                print(f"{self.num_timesteps:8d} steps: score {curve[-1][1]:7.2f}", flush=True)

        def _on_step(self):
            return True

    model.learn(steps, callback=Curve())
    return policy, np.array(curve)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=720_000, help="environment steps to train for")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=None, help="folder of the figure")
    arguments = parser.parse_args()
    from insenv.envs import sb3  # noqa: F401

    policy, curve = train(arguments.steps, arguments.seed)
    best = max(range(75, 166, 15), key=lambda time: scores(q_method(time), CHOICE).mean())
    found = {
        "analytic": scores(lambda venv: agents.make("analytic", venv).act),
        "PPO": scores(policy, **COMPACT),
        "by hand": scores(by_hand, **COMPACT),
        "q-method": scores(q_method()),
        f"q-method, {best} s": scores(q_method(best)),
    }
    for name, values in found.items():
        print(f"{name:15} {values.mean():7.2f} +- {values.std() / np.sqrt(SEEDS):.2f}")
    if arguments.out is not None:
        from insenv.base import style

        arguments.out.mkdir(parents=True, exist_ok=True)
        with style.page(7.5, 4.2) as figure:
            axes = figure.subplots()
            axes.plot(curve[:, 0], curve[:, 1], "o-", markersize=3, color=style.COLOURS[0], label="PPO")
            for name, colour in (("analytic", style.COLOURS[1]), ("q-method", style.COLOURS[2])):
                axes.axhline(found[name].mean(), linestyle="--", color=colour, label=f"{name}, whole time")
            axes.set(xlabel="steps of training", title=f"Score, mean of {SEEDS} held-out seeds")
            style.legend(figure, axes)
            style.save(figure, {"png": arguments.out / "aligner.png"})


if __name__ == "__main__":
    try:
        main()
    except InputError as error:  # such as a missing package
        sys.exit(f"train_aligner.py: {error}")
