"""A plain env.step loop: an agent aligns a swaying ship and declares when it is aligned.

python examples/env_loop.py
"""

import gymnasium
import numpy as np

import insenv
from insenv.envs import agents

env = gymnasium.make("insenv/ShipAlignment-v0", samples_per_step=200, heading_deg=(0.0, 360.0))
agent = agents.make("qakf-improved", env, declare_after_s=240.0)

observation, info = env.reset(seed=7)
score, over = 0.0, False
while not over:
    action = agent.act(observation, info)  # the agent uses the observation only; the info contains the truth
    observation, reward, terminated, truncated, info = env.step(action)
    score, over = score + reward, terminated or truncated

error, limit = np.degrees(info["error"]), np.degrees(info["limit"])
print(f"insenv {insenv.__version__}: aligned after {env.unwrapped.named(observation)['time']:.0f} s, score {score:.3f}")
print(f"heading error {error[2]:+.4f} deg, limit {limit[2]:.4f} deg (1 sigma, at the end of the full time)")
