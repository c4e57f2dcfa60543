"""Train a tuner: PPO of Stable-Baselines3 learns to scale a filter's noises and is compared on held-out seeds.

    pip install -e '.[rl,plot,workbench]'    # torch's wheel for processors without a GPU is enough
    python examples/train_tuner.py           # some minutes
    python examples/train_tuner.py --steps 40000 --out tuner
    python examples/train_tuner.py --steps 0 # without PPO: about a minute, and neither torch nor Stable-Baselines3

The filter is the 15-state filter in a city drive with two GNSS outages.  It is mistuned on purpose: each episode multiplies its
noise parameters by random factors of up to 30 either way, which the agent does not know.  The agent observes innovations,
covariance and sensors, and chooses factors that correct the filter.  It is compared with the untuned filter (as mistuned), with
the best fixed factors of two searches (along the axes, and by CMA-ES as `insenv tune` does), and with the filter that has the
correct data sheets.
"""

import argparse
import sys
from pathlib import Path

import gymnasium
import numpy as np

import insenv
from insenv.base.errors import InputError
from insenv.base.installing import need

ID = "insenv/Tuning-v0"
EPISODE = {"duration_s": 240.0, "gnss_outages_s": ((90.0, 120.0), (180.0, 210.0)), "samples_per_step": 2000}
HELD_OUT, TRAINING, SEARCH = 1_000_000, 0, 500_000  # first seeds of evaluation, training, search
ROWS = 16  # environments that are trained on at once


def episodes(policy, seeds, **options):
    """Run one episode per seed in one batch; return the rewards (seeds,) and the infos by name, (steps, seeds, ...)."""
    venv = gymnasium.make_vec(ID, len(seeds), **EPISODE, **options)
    observations, _ = venv.reset(seed=[int(seed) for seed in seeds])
    total, running, infos = np.zeros(len(seeds)), np.ones(len(seeds), bool), []
    while running.any():
        observations, reward, terminated, truncated, info = venv.step(policy(observations))
        total += reward * running
        running &= ~(terminated | truncated)
        infos.append({name: info[name] for name in ("measure", "consistency", "error_rms", "nees", "scale")})
    return total, {name: np.array([info[name] for info in infos]) for name in infos[0]}


def fixed(action):
    """Return the policy of a constant action, or of one constant action per environment."""
    return lambda observations: np.broadcast_to(action, (len(observations), 6))


def undone(seeds, **options):
    """Return the policy that undoes the mistuning of these seeds from the second step on; it takes it from the parameters."""
    venv = gymnasium.make_vec(ID, len(seeds), **EPISODE, **options)
    venv.reset(seed=[int(seed) for seed in seeds])
    parameters = venv.unwrapped.setup.task.model.parameters.unpack(venv.unwrapped.snapshot().parameters)
    action = -parameters["mistuning"] / parameters["decades"].reshape(-1, 1)
    return lambda observations: action * (observations[:, :1] > 0.0)  # the time


def best_fixed(seeds, passes, **options):
    """Search along the axes: set each component in turn to the best of five values by mean reward over the seeds."""
    best, grid = np.zeros(6), np.linspace(-0.6, 0.6, 5)
    for _ in range(passes):
        for axis in (4, 1, 5, 0, 3, 2):
            tried = np.tile(best, (len(grid), 1))
            tried[:, axis] = grid
            reward, _ = episodes(fixed(np.repeat(tried, len(seeds), axis=0)), np.tile(seeds, len(grid)), **options)
            best = tried[np.argmax(reward.reshape(len(grid), -1).mean(axis=1))]
    return best


def best_by_cma_es(seeds, evaluations, **options):
    """Search all components at once, by CMA-ES, for the best mean reward over the seeds."""
    from insenv.studies.tune import search

    def objective(logs):  # of the factors 10^(2 action)
        actions = np.repeat(logs / np.log(100.0), len(seeds), axis=0)
        reward, _ = episodes(fixed(actions), np.tile(seeds, len(logs)), **options)
        return -reward.reshape(len(logs), -1).mean(axis=1)

    return np.log10(search(objective, 6, evaluations, SEARCH, None).factors) / 2.0


def train(steps, **options):
    """Return the trained policy and the curve of mean episode rewards over the steps."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from insenv.envs.sb3 import BatchVecEnv

    class Curve(BaseCallback):
        points = []

        def _on_step(self):
            return True

        def _on_rollout_end(self):
            if self.model.ep_info_buffer:
                mean = np.mean([episode["r"] for episode in self.model.ep_info_buffer])
                self.points.append((self.num_timesteps, mean))
                print(f"  {self.num_timesteps:6d} steps, reward of an episode {mean:.2f}", flush=True)

    torch.set_num_threads(1)
    rows = BatchVecEnv(ID, ROWS, seed=TRAINING, reward="dense", **EPISODE, **options)
    venv = VecNormalize(VecMonitor(rows), gamma=0.9, clip_obs=5.0)
    episode = round(EPISODE["duration_s"] * 200.0 / EPISODE["samples_per_step"])
    model = PPO(
        "MlpPolicy", venv, n_steps=episode, batch_size=96, n_epochs=10, gamma=0.9, gae_lambda=0.9, learning_rate=1e-3,
        policy_kwargs={"log_std_init": -1.0, "net_arch": [32, 32]}, seed=1, device="cpu",
    )  # fmt: skip
    curve = Curve()
    model.learn(steps, callback=curve)
    venv.training = False

    def policy(observations):
        return model.predict(venv.normalize_obs(observations), deterministic=True)[0].astype(float)

    return policy, np.array(curve.points)


def draw(path, found, curve):
    """Draw the learning curve, and the consistency over an episode by policy."""
    from insenv.base import style

    path.mkdir(parents=True, exist_ok=True)
    with style.page(9.0, 4.8) as figure:
        left, right = figure.subplots(1, 2)
        left.plot(*curve.T, color=style.COLOURS[2], label="PPO during training (with exploration)")
        colours = (style.COLOURS[0], style.COLOURS[1], style.COLOURS[3], style.COLOURS[2], style.LIMIT)
        drawn = [(name, each) for name, each in found.items() if not name.startswith("undone")]
        for (name, (reward, infos)), colour in zip(drawn, colours, strict=True):
            left.axhline(reward.mean(), color=colour, linestyle="--", label=f"{name}, held-out seeds")
            time = np.arange(1, len(infos["nees"]) + 1) * EPISODE["samples_per_step"] / 200.0
            right.plot(time, np.median(infos["nees"], axis=1), color=colour)
        style.shade(right, EPISODE["gnss_outages_s"])
        right.axhline(9.0, color="black", linewidth=0.8, label="NEES of a consistent filter, 9")
        left.set(xlabel="steps", title="Reward of an episode")
        right.set(
            xlabel="time [s]", title="NEES of 9 states, median of the seeds", yscale="log", xlim=(0, EPISODE["duration_s"])
        )
        style.log(right)
        style.legend(figure, (left, right), columns=3)
        style.save(figure, {"png": path / "tuner.png"})
    print(f"figure: {path / 'tuner.png'}")


def main():
    parser = argparse.ArgumentParser(description="Train a tuner with PPO and compare it on held-out seeds")
    parser.add_argument("--steps", type=int, default=24_000, help="environment steps to train for; 0: no PPO")
    parser.add_argument("--seeds", type=int, default=64, help="held-out seeds to compare on")
    parser.add_argument("--passes", type=int, default=1, help="passes of the search for the best fixed factors")
    parser.add_argument("--evaluations", type=int, default=144, help="sets of factors that CMA-ES tries")
    parser.add_argument("--mistuned", type=float, default=1.5, help="half-width of the random mistuning, decades")
    parser.add_argument("--out", type=Path, help="folder for a figure")
    given = parser.parse_args()
    if given.steps:
        from insenv.envs import sb3  # noqa: F401
    elif given.out:
        parser.error("--out draws the learning curve: allowed with --steps above 0")
    need("CMA-ES", "cma", extra="workbench")
    options = {"mistuning_decades": given.mistuned}
    held_out = HELD_OUT + np.arange(given.seeds)

    print(f"insenv {insenv.__version__}: {'training on' if given.steps else 'comparison on'} {ID}")
    policy, curve = train(given.steps, **options) if given.steps else (None, None)
    seeds = SEARCH + np.arange(48)
    best = {
        "best fixed factors": best_fixed(seeds, given.passes, **options),
        "those by CMA-ES": best_by_cma_es(seeds, given.evaluations, **options),
    }
    policies = {"untuned": fixed(np.zeros(6)), **{name: fixed(action) for name, action in best.items()}}
    policies |= {"PPO": policy} if policy else {}
    policies["undone from step 2 on"] = undone(held_out, **options)
    found = {name: episodes(policy, held_out, **options) for name, policy in policies.items()}
    found["correct data sheets"] = episodes(fixed(np.zeros(6)), held_out, mistuning_decades=0.0)

    print(f"\n{given.seeds} held-out seeds       reward  +- 1 s.e.  measure  consistency  position [m]  heading [deg]")
    for name, (reward, infos) in found.items():
        square = np.mean(infos["error_rms"] ** 2, axis=(0, 1))
        print(
            f"{name:22s} {reward.mean():9.3f} {reward.std() / np.sqrt(given.seeds):10.3f} {infos['measure'].mean():8.3f} "
            f"{infos['consistency'].mean():12.3f} {np.sqrt(square[6:9].sum()):13.2f} {np.degrees(np.sqrt(square[2])):14.3f}"
        )
    for name, action in best.items():
        print(f"{name}:", " ".join(f"{10 ** (2 * a):.2g}" for a in action))
    if not policy:
        return
    difference = found["PPO"][0] - found["untuned"][0]
    error = difference.std() / np.sqrt(given.seeds)
    print(
        f"\nPPO minus untuned, seed by seed: {difference.mean():+.3f} +- {error:.3f}; better on {np.mean(difference > 0):.0%}"
    )
    mean = np.exp(np.log(found["PPO"][1]["scale"]).mean(axis=(0, 1)))
    print("factors of PPO, geometric mean:", " ".join(f"{scale:.2g}" for scale in mean))
    if given.out:
        draw(given.out, found, curve)


if __name__ == "__main__":
    try:
        main()
    except InputError as error:  # such as a missing package
        sys.exit(f"train_tuner.py: {error}")
