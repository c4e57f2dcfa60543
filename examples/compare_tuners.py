"""Compare classical ways to adapt a filter to instruments that are worse than their data sheets and fail for a while.

    pip install -e '.[workbench]'                    # CMA-ES, for the best fixed factors
    python examples/compare_tuners.py                # some minutes
    python examples/compare_tuners.py --seeds 8 --evaluations 9

Once a second each policy sets the noises and the gate of the 15-state filter in a city drive, and whether it uses the positions
and velocities of fixes (`insenv/FaultTuning-v0`).  None sees the truth but the last one, which knows what has failed.
"""

import argparse
import sys

import gymnasium
import numpy as np

import insenv
from insenv.base.errors import InputError
from insenv.base.installing import need

ID = "insenv/FaultTuning-v0"
HELD_OUT, SEARCH = 1_000_000, 500_000  # first seeds of the comparison, and of every choice
ARW, VRW, POSITION, VELOCITY, GATE, TRUST_POSITION = 0, 1, 4, 5, 6, 7  # components of an action
DECADES = 2.0  # of an action of 1
STUCK_LEVEL = -2.5  # an axis below it does not scatter at all


class Fixed:
    """One action for all time: (9,), or one for each row."""

    def __init__(self, action=(0.0,) * 9):
        self.action = np.asarray(action)

    def start(self, venv):
        """Begin the episodes of a vector environment, which has been reset."""

    def act(self, seen):
        """Return the actions (rows, 9) for observations by name."""
        return np.broadcast_to(self.action, (len(seen["fixes"]), 9)).copy()


class FromScatter(Fixed):
    """White noises of the unit from the scatter of its samples; an axis that does not scatter is stuck."""

    def act(self, seen):
        action = super().act(seen)
        for place, name in ((ARW, "gyro_level"), (VRW, "accel_level")):
            stuck = seen[name] < STUCK_LEVEL
            stuck &= ~stuck.all(axis=1, keepdims=True)  # before the first sample no axis scatters
            # motion and engine add to the scatter: the quietest axis shows the noise best
            level = np.where(stuck, np.inf, np.where(seen[name] < STUCK_LEVEL, 0.0, seen[name])).min(axis=1)
            action[:, place] = np.where(stuck.any(axis=1), 1.0, np.clip(level / DECADES, -0.5, 1.0))
        return action


class InnovationBased(FromScatter):
    """Noise of the fixes from their innovations, with a forgetting factor; the unit's as `FromScatter`.

    An innovation has the variance S = H P H' + R: the mean of its square less H P H' estimates R.  The sigma stays below `most`
    times the reported one, or the filter's own error would be taken for it.  Sources: Mehra, "On the identification of
    variances and adaptive Kalman filtering", IEEE Trans. Automatic Control 15 (1970), 175-184; Sage and Husa, "Adaptive
    filtering with unknown prior statistics", Joint Automatic Control Conference (1969), 760-769.
    """

    forgetting, least, most = 0.2, 0.3, 16.0

    def start(self, venv):
        self.square, self.used = np.ones((2, venv.num_envs, 2))
        self.fixes = np.zeros(venv.num_envs)

    def act(self, seen):
        action, some = super().act(seen), seen["fixes"] > 0.0
        innovation, ratio = 10.0 ** seen["innovation_level"], 10.0 ** seen["ratio_level"]
        predicted = (innovation / ratio) ** 2 - np.repeat(self.used, 3, axis=1) ** 2  # H P H' over the reported variance
        found = np.maximum(innovation**2 - np.maximum(predicted, 0.0), 0.0).reshape(-1, 2, 3).mean(axis=2)
        self.fixes += some
        gain = np.where(some, np.maximum(self.forgetting, 1.0 / (self.fixes + 5.0)), 0.0)
        self.square = np.maximum(self.square + gain[:, None] * (found - self.square), self.least**2)
        self.used = np.minimum(np.sqrt(self.square), self.most)
        action[:, POSITION : VELOCITY + 1] = np.log10(self.used) / DECADES
        return action


class Bank(FromScatter):
    """Multiple models: filters that assume other noises of the fixes run beside; their innovations say how likely each is.

    The filter takes the assumed noises, weighted in their logarithm; the unit's as `FromScatter`.  Source: Magill, "Optimal
    adaptive estimation of sampled stochastic processes", IEEE Trans. Automatic Control 10 (1965), 434-439; a model may change,
    with the probability 1 - stay at each fix, as in Blom and Bar-Shalom, same journal 33 (1988), 780-783, without their mixing.
    """

    models, stay = np.log10([0.6, 2.0, 10.0]) / DECADES, 0.8

    def start(self, venv):
        count, seeds = len(self.models), list(venv.unwrapped.np_random_seed)
        self.beside = gymnasium.make_vec(ID, venv.num_envs * count).unwrapped  # the same drives
        self.seen = self.beside.named(self.beside.reset(seed=seeds * count)[0])
        self.probability = np.full((count, venv.num_envs), 1.0 / count)

    def act(self, seen):
        action, count = super().act(seen), len(self.models)
        ratio, innovation = (10.0 ** self.seen[f"{name}_level"].reshape(count, -1, 6) for name in ("ratio", "innovation"))
        likelihood = np.exp(-0.5 * np.minimum(ratio**2, 60.0)) * ratio / innovation  # of each component, times the same for all
        prior = self.stay * self.probability + (1.0 - self.stay) / count
        posterior = prior * np.where(self.seen["fixes"].reshape(count, -1) > 0.0, likelihood.prod(axis=2) + 1e-300, 1.0)
        self.probability = posterior / posterior.sum(axis=0)
        assumed = np.tile(action, (count, 1))
        assumed[:, POSITION : VELOCITY + 1] = np.repeat(self.models, len(action))[:, None]
        self.seen = self.beside.named(self.beside.step(assumed)[0])
        action[:, POSITION : VELOCITY + 1] = (self.models @ self.probability)[:, None]
        return action


class Oracle(Fixed):
    """The filter with the true noises; positions that are drawn away are not used, and a stuck axis is known."""

    def start(self, venv):
        setup = venv.unwrapped.setup
        self.p = setup.task.model.parameters.unpack(venv.unwrapped.snapshot().parameters)
        self.time, self.interval = 0.0, setup.samples * setup.interval

    def act(self, seen):
        p, action = self.p, super().act(seen)
        inside = (p["fault_begin"] <= self.time + self.interval) & (self.time < p["fault_end"])
        self.time += self.interval
        street, jamming, _, vibration, _ = np.where(inside, p["fault_factor"], 1.0).prod(axis=2).T
        _, _, drag, _, stuck = inside.any(axis=2).T
        factor = p["noise_factor"] * np.stack([vibration, vibration, street * jamming, street * jamming], axis=1)
        action[:, [ARW, VRW, POSITION, VELOCITY]] = np.clip(np.log10(factor) / DECADES, -1.0, 1.0)
        gyro = p["fault_axis"][:, :3].any(axis=1)
        action[stuck & gyro, ARW] = action[stuck & ~gyro, VRW] = 1.0
        action[drag, TRUST_POSITION] = -1.0
        return action


def episodes(policy, seeds, **options):
    """Run one episode per seed in one batch; return the scores (seeds,) and the infos by name, (steps, seeds, ...)."""
    venv = gymnasium.make_vec(ID, len(seeds), **options)
    observation, _ = venv.reset(seed=[int(seed) for seed in seeds])
    policy.start(venv)
    total, running, infos = np.zeros(len(seeds)), np.ones(len(seeds), bool), []
    while running.any():
        observation, reward, terminated, truncated, info = venv.step(policy.act(venv.unwrapped.named(observation)))
        total += reward * running
        running &= ~(terminated | truncated)
        infos.append({name: info[name] for name in ("measure", "consistency", "error_rms", "fault_now")})
    return total, {name: np.array([info[name] for info in infos]) for name in infos[0]}


def best_fixed(seeds, evaluations):
    """Search by CMA-ES, as `insenv tune` does, for the factors with the best mean score over the seeds."""
    from insenv.studies.tune import search

    def actions_of(logs):
        return np.concatenate([np.clip(logs / np.log(10.0) / DECADES, -1.0, 1.0), np.zeros((len(logs), 2))], axis=1)

    def objective(logs):
        score, _ = episodes(Fixed(np.repeat(actions_of(logs), len(seeds), axis=0)), np.tile(seeds, len(logs)))
        return -score.reshape(len(logs), -1).mean(axis=1)

    found = search(objective, 7, evaluations, SEARCH, None)
    return actions_of(np.log(np.array(found.factors))[None])[0]


def main():
    parser = argparse.ArgumentParser(description="Compare classical ways to adapt a filter")
    parser.add_argument("--seeds", type=int, default=64, help="held-out seeds to compare on")
    parser.add_argument("--evaluations", type=int, default=180, help="sets of factors that CMA-ES tries on 24 other seeds")
    options = parser.parse_args()
    for name in ("seeds", "evaluations"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} {getattr(options, name)}: allowed is a whole number from 1")
    need("CMA-ES", "cma", extra="workbench")
    best = best_fixed(SEARCH + np.arange(24), options.evaluations)
    policies = {
        "the filter as it is": Fixed(),
        "best fixed factors": Fixed(best),
        "unit's noises from its scatter": FromScatter(),
        "bank of three filters": Bank(),
        "innovation-based": InnovationBased(),
        "oracle": Oracle(),
    }
    print(
        f"insenv {insenv.__version__}, {ID}, {options.seeds} held-out seeds: "
        "score, +- 1 s.e., measure, consistency, position [m]"
    )
    scores = {}
    for name, policy in policies.items():
        score, infos = episodes(policy, HELD_OUT + np.arange(options.seeds))
        position = np.sqrt(np.mean(np.sum(infos["error_rms"][..., 6:9] ** 2, axis=2)))
        scores[name], error = score, score.std() / np.sqrt(options.seeds)
        print(
            f"{name:32s} {score.mean():7.3f} +- {error:.3f} {infos['measure'].mean():7.2f} {infos['consistency'].mean():6.2f} "
            f"{position:7.1f}"
        )
    left = scores["oracle"] - scores["innovation-based"]
    print(f"oracle minus innovation-based, seed by seed: {left.mean():+.3f} +- {left.std() / np.sqrt(options.seeds):.3f}")
    print("best fixed factors:", " ".join(f"{10 ** (DECADES * a):.2g}" for a in best[:7]))


if __name__ == "__main__":
    try:
        main()
    except InputError as error:  # such as a missing package
        sys.exit(f"compare_tuners.py: {error}")
