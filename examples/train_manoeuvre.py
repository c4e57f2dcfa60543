"""Train PPO to drive a car so that its filter finds the heading, and compare it with fixed patterns on held-out seeds.

    pip install -e '.[rl,plot]'
    python examples/train_manoeuvre.py --steps 800000 --out manoeuvre

The best fixed pattern is chosen on seeds of its own.  The bound is that of the fixes alone: a perfect inertial unit, a start
known without error, and the largest change of velocity that the commands allow.
"""

import argparse
import sys
from pathlib import Path

import gymnasium
import numpy as np

import insenv
from insenv.base.errors import InputError

ID = "insenv/Manoeuvre-v0"
HELD_OUT, SEARCH, TRAINING = 1_000_000, 500_000, 0  # first seeds of the comparison, the choice of a pattern, training
ROWS = 48
EVERY = 100_000  # steps of training between two points of the learning curve


def wave(period, k):
    """Return +1 in the first half of each period of some steps and -1 in the second."""
    return 1.0 if k % period < period / 2 else -1.0


PATTERNS = {  # (acceleration, turn) in step k of 2 s
    "no command": lambda k: (0.0, 0.0),
    "circle": lambda k: (0.0, 1.0),
    "S-turns of 16 s": lambda k: (0.0, wave(8, k)),
    "S-turns of 24 s": lambda k: (0.0, wave(12, k)),
    "accelerate and brake, 8 s": lambda k: (wave(4, k), 0.0),
    "accelerate and brake, 16 s": lambda k: (wave(8, k), 0.0),
    "accelerate, S-turns of 16 s": lambda k: (1.0, wave(8, k)),
    "accelerate, S-turns of 24 s": lambda k: (1.0, wave(12, k)),
    "accelerate, S-turns of 32 s": lambda k: (1.0, wave(16, k)),
    "accelerate and brake of 16 s, S-turns of 24 s": lambda k: (wave(8, k), wave(12, k)),
    "accelerate and brake of 16 s, S-turns of 32 s": lambda k: (wave(8, k), wave(16, k)),
    "accelerate and brake of 24 s, S-turns of 32 s": lambda k: (wave(12, k), wave(16, k)),
    "accelerate and brake of 32 s, S-turns of 16 s": lambda k: (wave(16, k), wave(8, k)),
}


def always(pattern):
    """Return the policy of a pattern, which does not look at its observations."""
    return lambda k, observation: np.tile(pattern(k), (len(observation), 1))


def at_random(seed=1):
    """Return the policy of random commands."""
    generator = np.random.default_rng(seed)
    return lambda k, observation: generator.uniform(-1.0, 1.0, (len(observation), 2))


def episodes(policy, seeds, **options):
    """Run one episode per seed in one batch; return the return, the steps and the last heading error (deg), (seeds,) each."""
    venv = gymnasium.make_vec(ID, len(seeds), **options)
    observation, info = venv.reset(seed=[int(seed) for seed in seeds])
    total, steps, running = np.zeros(len(seeds)), np.zeros(len(seeds)), np.ones(len(seeds), dtype=bool)
    last = np.zeros(len(seeds))
    while running.any():
        observation, reward, terminated, truncated, info = venv.step(policy(int(steps.max()), observation))
        total += reward * running
        steps += running
        last[running] = np.degrees(np.abs(info["heading_error"][running]))
        running &= ~(terminated | truncated)
    return total, steps, last


def bound(seeds, **options):
    """Return an upper bound of the mean return over seeds, (seeds,).

    The heading shows only where the velocity changes, and in the motion of the antenna about the unit.  A heading error
    turns that change of velocity, and the change of position that follows from it; a fix measures each with the
    receiver's white noise.  No driver changes the velocity faster than by both accelerations at once, or further than
    from the start speed to the opposite of the top speed.  If start and unit are known without error, the heading then
    has this standard deviation; a normal posterior has the least mean of any loss that grows with the error (Anderson's
    lemma).
    """
    from insenv.vehicles.car import AGENT_ACCELERATION, SLOW, TOP_SPEED

    venv = gymnasium.make_vec(ID, len(seeds), **options)
    _, info = venv.reset(seed=[int(seed) for seed in seeds])
    model, setup = venv.unwrapped.setup.task.model, venv.unwrapped.setup
    p = model.parameters.unpack(venv.unwrapped.snapshot().parameters)
    goal, limit = info["goal"][0], setup.decisions
    step = setup.samples * setup.interval
    started = np.log(np.hypot(info["heading_error"], goal))
    speed = np.linalg.norm(info["velocity_n"], axis=1)[:, None]
    fixes = np.arange(1, round(limit * step / p["gnss_interval"][0]) + 1) * p["gnss_interval"][0]
    arm = np.linalg.norm(p["antenna_lever_arm_b"][0])
    driven = np.minimum(np.sqrt(2.0) * AGENT_ACCELERATION * fixes, TOP_SPEED + speed)  # (seeds, fixes)
    changed = driven + arm * AGENT_ACCELERATION / SLOW
    moved = np.cumsum(driven, axis=1) * p["gnss_interval"][0] + arm
    seen = changed**2 / p["gnss_velocity_noise"].min() ** 2 + moved**2 / p["gnss_position_noise"].min() ** 2
    sigma = 1.0 / np.sqrt(p["known_heading_sigma"].reshape(-1, 1) ** -2 + np.cumsum(seen, axis=1))
    ends = np.searchsorted(fixes, np.arange(1, limit + 1) * step, side="right") - 1  # the last fix of each step
    z = np.linspace(-8.0, 8.0, 1601)
    weight = np.exp(-0.5 * z**2)
    left = np.log(np.hypot(sigma[:, ends, None] * z, goal)) @ (weight / weight.sum())
    return started - np.min(left + np.arange(1, limit + 1) / limit, axis=1)


def train(steps, seed):
    """Return the policy trained for some steps, and the learning curve: steps, mean return."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    from insenv.envs.sb3 import BatchVecEnv

    torch.set_num_threads(1)
    # the stated sigma is a reward with less noise than the true error, by which the policies are compared
    rows = BatchVecEnv(ID, ROWS, seed=TRAINING, reward="uncertainty", time_is_terminal=True)
    batch = VecNormalize(rows, gamma=0.98, clip_obs=5.0)
    model = PPO(
        "MlpPolicy", batch, n_steps=60, batch_size=480, n_epochs=8, gamma=0.98, gae_lambda=0.95, learning_rate=7e-4,
        policy_kwargs={"net_arch": [64, 64], "log_std_init": -0.3}, seed=seed, device="cpu",
    )  # fmt: skip

    def policy(k, observation):
        return model.predict(batch.normalize_obs(observation), deterministic=True)[0].astype(float)

    curve = []

    class Curve(BaseCallback):
        def _on_rollout_start(self):
            if self.num_timesteps >= len(curve) * EVERY:
                curve.append((self.num_timesteps, episodes(policy, SEARCH + np.arange(64))[0].mean()))
                print(f"{self.num_timesteps:8d} steps: return {curve[-1][1]:6.2f}", flush=True)

        def _on_step(self):
            return True

    model.learn(steps, callback=Curve())
    return policy, np.array(curve)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=800_000, help="environment steps to train for; 0: the fixed patterns only")
    parser.add_argument("--seeds", type=int, default=256, help="held-out seeds to compare on")
    parser.add_argument("--seed", type=int, default=1, help="of the training")
    parser.add_argument("--out", type=Path, default=None, help="folder of the figure")
    given = parser.parse_args()
    if given.steps > 0:
        from insenv.envs import sb3  # noqa: F401

    held_out, search = HELD_OUT + np.arange(given.seeds), SEARCH + np.arange(64)

    tried = {name: episodes(always(pattern), search)[0].mean() for name, pattern in PATTERNS.items()}
    best = max(tried, key=tried.get)
    print(f"insenv {insenv.__version__}: {ID}")
    print(f"best of {len(PATTERNS)} fixed patterns on {len(search)} seeds of the choice: {best} ({tried[best]:.2f})")
    policies = {"random commands": at_random(), **{name: always(pattern) for name, pattern in PATTERNS.items()}}
    curve = np.zeros((0, 2))
    if given.steps > 0:
        policies["PPO"], curve = train(given.steps, given.seed)
    found = {name: episodes(policy, held_out) for name, policy in policies.items()}
    print(f"{given.seeds} held-out seeds: return +- standard error, mean steps, median heading error at the end [deg]")
    for name, (total, steps, error) in sorted(found.items(), key=lambda item: item[1][0].mean()):
        shown = f"{total.mean():6.2f} +- {total.std() / np.sqrt(len(total)):.2f}"
        print(f"{name:46} {shown} {steps.mean():5.0f} {np.median(error):7.2f}")
    most = bound(held_out)
    print(f"{'bound of the fixes':46} {most.mean():6.2f} +- {most.std() / np.sqrt(len(most)):.2f}")
    if "PPO" in found:
        hindsight = max(PATTERNS, key=lambda name: found[name][0].mean())
        for what, name in (("chosen", best), ("best on these seeds", hindsight)):
            gain = found["PPO"][0] - found[name][0]
            print(f"PPO minus the pattern {what}, seed by seed: {gain.mean():+.3f} +- {gain.std() / np.sqrt(len(gain)):.3f}")
    if given.out is not None and len(curve):
        from insenv.base import style

        given.out.mkdir(parents=True, exist_ok=True)
        with style.page(7.5, 4.2) as figure:
            axes = figure.subplots()
            axes.plot(curve[:, 0], curve[:, 1], "o-", markersize=3, color=style.COLOURS[0], label="PPO")
            axes.axhline(tried[best], linestyle="--", color=style.COLOURS[1], label=best)
            axes.set(xlabel="steps of training", title="Return, mean of the 64 seeds on which the pattern is chosen")
            style.legend(figure, axes)
            style.save(figure, {"png": given.out / "manoeuvre-curve.png"})


if __name__ == "__main__":
    try:
        main()
    except InputError as error:  # such as a missing package
        sys.exit(f"train_manoeuvre.py: {error}")
