"""Write your own estimator as an agent and compare it with a baseline.

python examples/own_estimator.py
"""

import numpy as np

from insenv.attitude import numeric as attitude
from insenv.envs import AlignmentEnv, agents, estimate_action
from insenv.geodesy import numeric as geodesy


class TwoVectors:
    """Attitude from the averages of gravity and Earth rate over all samples, for a vehicle that does not move."""

    def __init__(self, env):
        self.env = env.unwrapped

    def act(self, observation, info):
        seen = self.env.named(observation)
        if seen["time"] == 0.0:
            self.force, self.rate = np.zeros(3), np.zeros(3)
        self.force += seen["imu"][:, 3:6].sum(axis=0)
        self.rate += seen["imu"][:, 0:3].sum(axis=0)
        if not self.force.any():
            return estimate_action(self.env.setup.task, np.array([1.0, 0.0, 0.0, 0.0]))
        earth_rate_n = geodesy.earth_rate_n(seen["known_latitude"])
        down_n, north_n = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        down_b = -self.force / np.linalg.norm(self.force)
        east_b = np.cross(down_b, self.rate)
        east_b /= np.linalg.norm(east_b)
        axes_n = np.column_stack([north_n, np.cross(down_n, earth_rate_n) / np.linalg.norm(earth_rate_n[:2]), down_n])
        axes_b = np.column_stack([np.cross(east_b, down_b), east_b, down_b])
        return estimate_action(self.env.setup.task, attitude.from_dcm(axes_n @ axes_b.T))


def score(env, agent, seeds):
    """Return the mean return of the episodes and the RMS of the heading error at their ends (deg)."""
    returns, errors = [], []
    for seed in seeds:
        observation, info = env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, info = env.step(agent.act(observation, info))
            total, over = total + reward, terminated or truncated
        returns.append(total)
        errors.append(np.degrees(info["error"][2]))
    return np.mean(returns), np.sqrt(np.mean(np.square(errors)))


for scenario in ("static-ecef", "ship-swaying"):
    env = AlignmentEnv(scenario, samples_per_step=200)
    for name, agent in (("two vectors", TwoVectors(env)), ("q-method", agents.make("q-method", env))):
        mean, rms = score(env, agent, range(2))
        print(f"{scenario:14} {name:12} return {mean:7.3f}   heading error at the end {rms:8.4f} deg")
