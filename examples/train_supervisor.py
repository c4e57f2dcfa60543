"""Train a supervisor: a recurrent network that says how noisy fixes are while instruments fail, for a filter to use.

    pip install -e '.[rl,plot]'                           # torch's wheel for processors without a GPU is enough
    python examples/train_supervisor.py --out supervisor  # five training seeds, a few minutes of processor time each
    python examples/train_supervisor.py --load supervisor/supervisor-1.npz

`insenv/FaultTuning-v0`.  The network learns by imitation from an expert that knows the truth.  In each round the policy, as
it is, runs new episodes; the expert says what it would have done in every state that the policy has reached; and the network is
fitted to all answers so far.  Source: Ross, Gordon and Bagnell, "A reduction of imitation learning and structured prediction to
no-regret online learning", AISTATS (2011), 627-635 (DAgger).  In use the policy sees what the filter sees.  It is compared with
the best classical method of `examples/compare_tuners.py` on held-out seeds, on which nothing is trained or chosen.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from compare_tuners import (
    HELD_OUT,
    ID,
    POSITION,
    TRUST_POSITION,
    VELOCITY,
    Fixed,
    FromScatter,
    InnovationBased,
    Oracle,
    episodes,
)

import insenv
from insenv.base.errors import InputError
from insenv.base.installing import need

TRAINING, CURVE = 10_000_000, 300_000  # first seeds: of a training (times its own seed), of the curve
FIXES = slice(POSITION, VELOCITY + 1)
HIDDEN, BATCH, RATE, CLIP = 48, 48, 3e-3, 5.0


class Supervisor(FromScatter):
    """The noises of the fixes by a network with one gated recurrent unit (GRU); those of the unit as `FromScatter`.

    weights: arrays by name.  mean, scale (inputs,): of the inputs.  input, recurrent: weights of the three gates (3 hidden,
    inputs or hidden) and their offsets, in torch's order reset, update, new.  output: (2, hidden) and (2,).
    Source: Cho et al., "Learning phrase representations using RNN encoder-decoder", EMNLP (2014), 1724-1734.
    """

    def __init__(self, weights):
        super().__init__()
        self.weights = weights

    @classmethod
    def load(cls, path):
        """Return the policy that `save` wrote."""
        with np.load(path) as file:
            return cls(dict(file))

    def save(self, path):
        np.savez(path, **self.weights)

    def start(self, venv):
        self.hidden = np.zeros((venv.num_envs, self.weights["output"].shape[1]))
        self.latest = np.zeros((venv.num_envs, 6))

    def raw(self, seen):
        """Return the inputs of the network (rows, inputs): what is observed, signed innovations and how they have changed."""
        some = seen["fixes"][:, None] > 0.0
        innovation = np.sign(seen["ratio"]) * 10.0 ** seen["innovation_level"] * some
        change = np.where(some, innovation - self.latest, 0.0)
        self.latest = np.where(some, innovation, self.latest)
        observed = [np.reshape(value, (len(some), -1)) for value in seen.values()]
        return np.concatenate([*observed, np.arcsinh(innovation), np.arcsinh(change)], axis=1)

    def act(self, seen):
        action, w = super().act(seen), self.weights
        self.x = np.clip((self.raw(seen) - w["mean"]) / w["scale"], -CLIP, CLIP)
        given = np.split(self.x @ w["input"].T + w["input_offset"], 3, axis=1)
        held = np.split(self.hidden @ w["recurrent"].T + w["recurrent_offset"], 3, axis=1)
        reset, update = (1.0 / (1.0 + np.exp(-(a + b))) for a, b in zip(given[:2], held[:2], strict=True))
        self.hidden += (1.0 - update) * (np.tanh(given[2] + reset * held[2]) - self.hidden)
        action[:, FIXES] = np.clip(self.hidden @ w["output"].T + w["output_offset"], -1.0, 1.0)
        return action


class Asked(Fixed):
    """A policy, whose inputs are kept, with the answers of the expert: positions that are drawn away have a factor of 100."""

    def __init__(self, policy):
        super().__init__()
        self.policy, self.expert = policy, Oracle()

    def start(self, venv):
        self.policy.start(venv)
        self.expert.start(venv)
        self.inputs, self.answers = [], []

    def act(self, seen):
        action, expert = self.policy.act(seen), self.expert.act(seen)
        answer = expert[:, FIXES]
        answer[expert[:, TRUST_POSITION] < 0.0, 0] = 1.0
        self.inputs.append(self.policy.x.astype(np.float32))
        self.answers.append(answer.astype(np.float32))
        return action


class Untrained(Supervisor):
    """What acts in the first round: `InnovationBased`; the inputs of the network are kept, not yet normalised."""

    def __init__(self):
        super().__init__({"output": np.zeros((2, 1))})
        self.teacher = InnovationBased()

    def start(self, venv):
        super().start(venv)
        self.teacher.start(venv)

    def act(self, seen):
        self.x = self.raw(seen)
        return self.teacher.act(seen)


def train(seed, rounds, rows, batches):
    """Return the policy of one training seed, and its curve (points, 2): minutes of processor time, score on `CURVE`."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    generator, begin, curve, policy = np.random.default_rng(seed), time.process_time(), [], Untrained()
    inputs, answers, steps = [], [], rounds * batches
    for k in range(rounds):
        asked = Asked(policy)
        score, _ = episodes(asked, TRAINING * seed + k * rows + np.arange(rows))
        inputs.append(np.array(asked.inputs))
        answers.append(np.array(asked.answers))
        if k == 0:
            every = inputs[0].reshape(-1, inputs[0].shape[2])
            mean, scale = every.mean(axis=0), every.std(axis=0) + 0.01
            gru, output = torch.nn.GRU(len(mean), HIDDEN), torch.nn.Linear(HIDDEN, 2)
            learner = torch.optim.Adam([*gru.parameters(), *output.parameters()], lr=RATE)
            inputs[0] = np.clip((inputs[0] - mean) / scale, -CLIP, CLIP)
        x, y = (np.concatenate(each, axis=1).astype(np.float32) for each in (inputs, answers))
        for batch in range(k * batches, (k + 1) * batches):
            learner.param_groups[0]["lr"] = RATE * max(1.0 - batch / steps, 0.03)
            chosen = generator.choice(x.shape[1], min(BATCH, x.shape[1]), replace=False)
            loss = (output(gru(torch.from_numpy(x[:, chosen]))[0]) - torch.from_numpy(y[:, chosen])).abs().mean()
            learner.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_([*gru.parameters(), *output.parameters()], 1.0)
            learner.step()
        policy = Supervisor({"mean": mean, "scale": scale, **weights_of(gru, output)})
        if k % 3 == 0 or k + 1 == rounds:
            score, _ = episodes(policy, CURVE + np.arange(64))
            curve.append(((time.process_time() - begin) / 60.0, score.mean()))
            print(
                f"  seed {seed}, round {k + 1:2d}, {curve[-1][0]:4.1f} min, loss {loss.item():.3f}: {score.mean():.3f}",
                flush=True,
            )
    policy.weights["curve"] = np.array(curve)
    return policy


def weights_of(gru, output):
    """Return the weights of the network by the names of `Supervisor`."""
    arrays = {
        "input": gru.weight_ih_l0, "input_offset": gru.bias_ih_l0, "recurrent": gru.weight_hh_l0,
        "recurrent_offset": gru.bias_hh_l0, "output": output.weight, "output_offset": output.bias,
    }  # fmt: skip
    return {name: array.detach().numpy().astype(float) for name, array in arrays.items()}


def draw(path, curves, lines):
    """Draw the curve of each training seed, and the scores of other policies on the same seeds."""
    from insenv.base import style

    with style.page(6.5, 4.0) as figure:
        axes = figure.subplots()
        for k, curve in enumerate(curves):
            axes.plot(*curve.T, ".-", color=style.COLOURS[0], label="" if k else f"network, {len(curves)} training seeds")
        for (name, score), colour in zip(lines.items(), style.COLOURS[1:], strict=False):
            axes.axhline(score, color=colour, linestyle="--", label=name)
        axes.set(xlabel="processor time of training [min]", title=f"Score of {ID}, 64 seeds beside those of training")
        style.legend(figure, axes)
        style.save(figure, {"png": path})
    print(f"figure: {path}")


def main():
    parser = argparse.ArgumentParser(description="Train a network to adapt a filter, and compare it on held-out seeds")
    parser.add_argument("--training-seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--rounds", type=int, default=14)
    parser.add_argument("--rows", type=int, default=96, help="episodes of a round")
    parser.add_argument("--batches", type=int, default=32, help="steps of the optimizer in a round")
    parser.add_argument("--seeds", type=int, default=512, help="held-out seeds to compare on; 0: no comparison")
    parser.add_argument("--out", type=Path, help="folder for the policies and a figure")
    parser.add_argument("--load", type=Path, nargs="+", help="policies to compare, instead of training")
    given = parser.parse_args()
    print(f"insenv {insenv.__version__}: {'comparison' if given.load else 'training'} on {ID}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
    if given.load:
        policies = [Supervisor.load(path) for path in given.load]
    else:
        need("training", "torch", extra="rl")
        policies = []
        for seed in given.training_seeds:
            policies.append(train(seed, given.rounds, given.rows, given.batches))
            if given.out:
                policies[-1].save(given.out / f"supervisor-{seed}.npz")
    if given.seeds:
        compare(policies, HELD_OUT + np.arange(given.seeds))
    if given.out:
        lines = {name: episodes(p, CURVE + np.arange(64))[0].mean() for name, p in others().items()}
        draw(given.out / "supervisor.png", [policy.weights["curve"] for policy in policies], lines)


def others():
    return {"innovation-based": InnovationBased(), "oracle": Oracle()}


def compare(policies, seeds):
    """Print the scores on held-out seeds, and what the networks gain on the innovation-based policy, seed by seed."""
    root, networks = np.sqrt(len(seeds)), {f"network {k}": policy for k, policy in enumerate(policies, 1)}
    print(f"\n{len(seeds)} held-out seeds      score +- 1 s.e.  measure  consistency  position [m]")
    scores = {}
    for name, policy in {**others(), **networks}.items():
        scores[name], infos = episodes(policy, seeds)
        position = np.sqrt(np.mean(np.sum(infos["error_rms"][..., 6:9] ** 2, axis=2)))
        print(
            f"{name:20s} {scores[name].mean():9.3f} +- {scores[name].std() / root:.3f} {infos['measure'].mean():8.3f} "
            f"{infos['consistency'].mean():12.3f} {position:13.2f}"
        )
    learnt, classical = np.array([scores[name] for name in networks]), scores["innovation-based"]
    gain = learnt.mean(axis=0) - classical
    print(
        f"networks minus innovation-based, seed by seed: {gain.mean():+.3f} +- {gain.std() / root:.3f}, "
        f"{-gain.mean() / classical.mean():.1%} of the score; by training seed "
        f"{learnt.mean(axis=1).min():.3f} to {learnt.mean(axis=1).max():.3f}"
    )


if __name__ == "__main__":
    try:
        main()
    except InputError as error:  # such as a missing package
        sys.exit(f"train_supervisor.py: {error}")
