"""Train a corrector: a recurrent network that takes errors out of the estimate of a filter whose instruments fail.

    pip install -e '.[rl]'                # torch's wheel for processors without a GPU is enough
    python examples/train_corrector.py --out corrector    # three training seeds, some minutes of processor time each
    python examples/train_corrector.py --load corrector/corrector-1.pt

`insenv/Correction-v0`.  The network learns by imitation (DAgger, as in `examples/train_supervisor.py`): in each round the
policy, as it is, runs new episodes; the error that the filter has in each state is the answer; and the network is fitted to all
answers so far, in the mean of the absolute difference: it learns the median error, which is 0 while it knows nothing.  In use
it sees what the filter holds, and what it has taken out itself.  It is compared on held-out seeds, on which nothing is trained
or chosen.
"""

import argparse
import sys
import time
from pathlib import Path

import gymnasium
import numpy as np

import insenv
from insenv.base.errors import InputError
from insenv.base.installing import need

ID = "insenv/Correction-v0"
HELD_OUT, TRAINING = 1_000_000, 10_000_000  # first seeds of the comparison, and of a training (times its own seed)
HIDDEN, BATCH, RATE, CLIP = 64, 48, 3e-3, 5.0


class Nothing:
    """The filter as it is."""

    def start(self, venv):
        """Begin the episodes of a vector environment, which has been reset."""
        self.shape, self.reach = venv.action_space.shape, venv.unwrapped.reach

    def act(self, seen, info):
        """Return the actions (rows, 9) for observations by name."""
        return np.zeros(self.shape)

    def answer(self, info):
        """Return the actions that take the whole error out, as far as an action reaches."""
        return np.clip(info["error"] / (self.reach * np.maximum(info["sigma"], 1e-12)), -1.0, 1.0)


class Told(Nothing):
    """What is told the error each second."""

    def act(self, seen, info):
        return self.answer(info)


class Asked(Nothing):
    """A policy, whose inputs are kept, with the answers."""

    def __init__(self, network=None, mean=0.0, scale=1.0):
        self.network, self.mean, self.scale = network, mean, scale

    def start(self, venv):
        super().start(venv)
        self.state, self.latest, self.inputs, self.answers = None, np.zeros(self.shape), [], []

    @classmethod
    def load(cls, path):
        """Return the policy that `save` wrote."""
        import torch

        kept = torch.load(path, weights_only=True)
        network = network_of(len(kept["mean"]))
        network.load_state_dict(kept["network"])
        return cls(network, kept["mean"].numpy(), kept["scale"].numpy())

    def save(self, path):
        import torch

        arrays = {name: torch.from_numpy(getattr(self, name)) for name in ("mean", "scale")}
        torch.save({"network": self.network.state_dict(), **arrays}, path)

    def act(self, seen, info):
        ratio = seen["ratio"] / np.maximum(1.0 - np.abs(seen["ratio"]), 1e-3)
        innovation = np.sign(ratio) * np.log1p(np.abs(ratio) * 10.0 ** seen["sigma_level"])
        observed = [np.reshape(value, (len(ratio), -1)) for value in seen.values()]
        self.inputs.append(np.concatenate([*observed, innovation, self.latest], axis=1).astype(np.float32))
        self.answers.append(self.answer(info).astype(np.float32))
        if self.network is not None:
            self.latest, self.state = self.network.act(self.normalised(self.inputs[-1]), self.state)
        return self.latest

    def normalised(self, inputs):
        return np.clip((inputs - self.mean) / self.scale, -CLIP, CLIP).astype(np.float32)


def network_of(inputs):
    """Return a network with one gated recurrent unit (GRU)."""
    import torch

    class Network(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.gru, self.output = torch.nn.GRU(inputs, HIDDEN), torch.nn.Linear(HIDDEN, 9)

        def forward(self, x):
            return self.output(self.gru(x)[0])

        def act(self, x, state):
            with torch.no_grad():
                hidden, state = self.gru(torch.from_numpy(x)[None], state)
                return np.clip(self.output(hidden)[0].numpy().astype(float), -1.0, 1.0), state

    return Network()


def train(seed, rounds, rows, batches):
    """Return the policy of one training seed."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    generator, begin, policy = np.random.default_rng(seed), time.process_time(), Asked()
    inputs, answers, counted, steps = [], [], [], rounds * batches
    for k in range(rounds):
        score, _, alive = episodes(policy, TRAINING * seed + k * rows + np.arange(rows))
        fresh, answer = np.array(policy.inputs), np.array(policy.answers)
        if k == 0:
            every = fresh.reshape(-1, fresh.shape[2])
            mean, scale = every.mean(axis=0), every.std(axis=0) + 0.01
            mean[-9:], scale[-9:] = 0.0, 0.3  # of its own actions, of which there are none yet
            policy = Asked(network_of(len(mean)), mean, scale)
            learner = torch.optim.Adam(policy.network.parameters(), lr=RATE)
        inputs.append(policy.normalised(fresh))
        answers.append(answer)
        counted.append(alive[..., None].astype(np.float32))
        for batch in range(k * batches, (k + 1) * batches):
            learner.param_groups[0]["lr"] = RATE * max(1.0 - batch / steps, 0.03)
            chosen = [divmod(place, rows) for place in generator.integers((k + 1) * rows, size=BATCH).tolist()]
            x, y, w = (
                torch.from_numpy(np.stack([each[i][:, j] for i, j in chosen], axis=1)) for each in (inputs, answers, counted)
            )
            loss = ((policy.network(x) - y).abs() * w).mean()
            learner.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.network.parameters(), 1.0)
            learner.step()
        if k % 10 == 0 or k + 1 == rounds:
            minutes = (time.process_time() - begin) / 60.0
            print(f"  seed {seed}, round {k + 1:2d}, {minutes:4.1f} min: {score.mean():.3f}", flush=True)
    return policy


def episodes(policy, seeds):
    """Run one episode per seed in one batch: scores and rms errors of the positions (m), (seeds,), and whether the episode
    of a row was not over at a step (steps, seeds).
    """
    venv = gymnasium.make_vec(ID, len(seeds))
    observation, info = venv.reset(seed=[int(seed) for seed in seeds])
    policy.start(venv)
    total, running, squares, alive = np.zeros(len(seeds)), np.ones(len(seeds), bool), [], []
    while running.any():
        action = policy.act(venv.unwrapped.named(observation), info)
        observation, reward, terminated, truncated, info = venv.step(action)
        total += reward * running
        squares.append(np.sum(info["error_rms"][:, 6:9] ** 2, axis=1))
        alive.append(running.copy())
        running &= ~(terminated | truncated)
    alive = np.array(alive)
    return total, np.sqrt(np.average(squares, axis=0, weights=alive)), alive


def whole(text):
    """A whole number from 1, as an argument."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number}: allowed is a whole number from 1")
    return number


def main():
    parser = argparse.ArgumentParser(description="Train a network to correct a filter, and compare it on held-out seeds")
    parser.add_argument("--training-seeds", type=whole, nargs="+", default=[1, 2, 3], help="one network each (1 2 3)")
    parser.add_argument("--rounds", type=whole, default=90, help="rounds of a training (90)")
    parser.add_argument("--rows", type=whole, default=96, help="episodes of a round (96)")
    parser.add_argument("--batches", type=whole, default=40, help="steps of the optimizer in a round (40)")
    parser.add_argument("--seeds", type=whole, default=512, help="held-out seeds to compare on (512)")
    parser.add_argument("--out", type=Path, help="folder for the policies")
    parser.add_argument("--load", type=Path, nargs="+", help="policies to compare, instead of training")
    given = parser.parse_args()
    need("training", "torch", extra="rl")
    print(f"insenv {insenv.__version__}: {'comparison' if given.load else 'training'} on {ID}")
    if given.out:
        given.out.mkdir(parents=True, exist_ok=True)
    networks = [Asked.load(path) for path in given.load or ()]
    for seed in () if given.load else given.training_seeds:
        networks.append(train(seed, given.rounds, given.rows, given.batches))
        if given.out:
            networks[-1].save(given.out / f"corrector-{seed}.pt")
    compare(networks, HELD_OUT + np.arange(given.seeds))


def compare(networks, seeds):
    """Print the scores on held-out seeds, what the networks gain on the filter, seed by seed, and their mean."""
    policies = {"the filter as it is": Nothing(), "told the error": Told()}
    policies |= {f"network {k}": network for k, network in enumerate(networks, 1)}
    print(f"\n{len(seeds)} held-out seeds      score +- 1 s.e.  position [m]")
    scores, root = {}, np.sqrt(len(seeds))
    for name, policy in policies.items():
        scores[name], position, _ = episodes(policy, seeds)
        score, gain = scores[name], scores[name] - scores["the filter as it is"]
        more = f"  gain seed by seed {gain.mean():+.3f} +- {gain.std() / root:.3f}" if gain.any() else ""
        print(f"{name:20s} {score.mean():9.3f} +- {score.std() / root:.3f} {np.sqrt(np.mean(position**2)):9.2f}{more}")
    if len(networks) > 1:
        from scipy.stats import t

        means = np.array([scores[name].mean() for name in policies if name.startswith("network")])
        half = t.ppf(0.975, len(means) - 1) * means.std(ddof=1) / np.sqrt(len(means))
        print(f"mean of the networks {means.mean():.3f} +- {half:.3f} (95 % interval between training seeds)")


if __name__ == "__main__":
    try:
        main()
    except (InputError, OSError) as error:  # such as a missing package or file
        sys.exit(f"train_corrector.py: {error}")
