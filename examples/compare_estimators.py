"""Two estimators on the same 64 ships at once: heading error over time, beside the limit.

python examples/compare_estimators.py
"""

import gymnasium
import numpy as np

from insenv.envs import agents

ROWS, SEED = 64, 100
rms = {}
for id in ("q-method", "gyrocompass"):
    venv = gymnasium.make_vec("insenv/ShipAlignment-v0", ROWS, samples_per_step=1000, heading_deg=(0.0, 360.0))
    agent = agents.make(id, venv)
    observation, info = venv.reset(seed=SEED)
    errors = []
    for _ in range(60):  # 300 s
        observation, _, _, _, info = venv.step(agent.act(observation, info))
        errors.append(np.degrees(info["error"][:, 2]))
    rms[id] = np.sqrt(np.mean(np.square(errors), axis=1))

print("heading error, RMS over", ROWS, "ships, deg")
print("time, s  " + "  ".join(f"{id:>12}" for id in rms))
for step in (11, 23, 35, 47, 59):
    print(f"{5 * step:7d}  " + "  ".join(f"{values[step]:12.4f}" for values in rms.values()))
print(f"limit at the end: {np.degrees(info['limit'][0, 2]):.4f} (1 sigma)")
