"""Write your own estimator as an agent and compare it with baselines.

python examples/own_estimator.py
"""

import gymnasium
import numpy as np

import insenv
from insenv.attitude import numeric as attitude
from insenv.envs import agents, estimate_action
from insenv.geodesy import numeric as geodesy


class FrozenFrame:
    """Attitude from gravity, seen in the body frame that the gyros keep frozen at the start.

    In that frame the vehicle does not turn, and sway averages out. Gravity turns with the Earth: its mean shows the vertical
    at the middle of the time, and its slope, a line fitted to it, shows east. The agent works in single and vector
    environments.
    """

    def __init__(self, env):
        self.env = env.unwrapped

    def act(self, observation, info=None):
        seen = self.env.named(np.atleast_2d(observation))
        known = seen["known_latitude"], seen["known_sample_interval"]
        reported = attitude.from_euler(*np.moveaxis(seen["known_attitude"], -1, 0))
        if (seen["time"] == 0.0).all():
            rows = len(reported)
            self.turned = np.tile([1.0, 0.0, 0.0, 0.0], (rows, 1))  # present body frame to the frozen one
            self.count, self.sums = 0, np.zeros((2, rows, 3))  # of the force, and of the force times the sample number
            return self.answer(observation, reported)
        for sample in np.moveaxis(seen["imu"], 1, 0):
            half = attitude.from_rotation_vector(sample[:, 0:3] / 2.0)
            middle = attitude.multiply(self.turned, half)
            force = attitude.rotate(middle, sample[:, 3:6])
            self.turned = attitude.multiply(middle, half)
            self.sums += force, self.count * force
            self.count += 1
        return self.answer(observation, self.estimate(*known))

    def answer(self, observation, q_nb):
        return estimate_action(self.env.setup.task, q_nb if np.ndim(observation) == 2 else q_nb[0])

    def estimate(self, latitude, interval):
        mean = self.sums[0] / self.count
        slope = self.sums[1] - self.sums[0] * (self.count - 1) / 2.0
        down = -mean / np.linalg.norm(mean, axis=-1, keepdims=True)
        east = np.cross(np.cross(down, slope), down)
        east /= np.linalg.norm(east, axis=-1, keepdims=True)
        axes = np.stack([np.cross(east, down), east, down], axis=-2)  # the frozen frame to n at the middle of the time
        # since then n has turned with the Earth
        earth = geodesy.earth_rate_n(latitude) * (self.count / 2.0 * interval)[:, None]
        now = attitude.multiply(attitude.from_rotation_vector(-earth), attitude.from_dcm(axes))
        return attitude.multiply(now, self.turned)


def scores(venv, agent, seed):
    """Return the scores of one episode per row, -(m of the last estimate + share of the time used)."""
    observation, info = venv.reset(seed=seed)
    total, over = np.zeros(venv.num_envs), np.zeros(venv.num_envs, dtype=bool)
    while not over.all():
        observation, reward, terminated, truncated, info = venv.step(agent.act(observation, info))
        total += np.where(over, 0.0, reward)
        over |= terminated | truncated
    return total


if __name__ == "__main__":
    venv = gymnasium.make_vec("insenv/ShipAlignment-v0", 16, samples_per_step=200)
    print(f"insenv {insenv.__version__}: score of 16 episodes on a swaying ship, mean and standard error")
    for name, agent in (
        ("analytic", agents.make("analytic", venv)),
        ("frozen frame", FrozenFrame(venv)),
        ("q-method", agents.make("q-method", venv)),
    ):
        found = scores(venv, agent, seed=1)
        print(f"{name:14} {found.mean():7.2f} +- {found.std() / 4.0:.2f}")
