"""Align a ship under way from an unknown heading, and start a filter with GNSS and a Doppler log from that attitude.

python examples/align_then_navigate.py
"""

from dataclasses import replace

import numpy as np

import insenv

log = insenv.record("ship-at-sea", duration_s=450.0)

aligned = insenv.replay(log, "velocity-integration").results[0]
row = np.searchsorted(aligned.time, 225.0)
fix = np.searchsorted(log.gnss.time, aligned.time[row])
roll, pitch, heading = np.degrees(insenv.attitude.numeric.to_euler(aligned.outputs["q_nb"][row]))
sigma = np.degrees(aligned.outputs["attitude_sigma"][row])
print(f"heading at 225 s: error {aligned.errors['heading_deg'][row]:+.2f} deg, stated {sigma[2]:.2f} deg")

# Position and velocity are those of the antenna, 13 m away: their sigmas contain that
start = {
    "start_s": aligned.time[row],
    "roll_deg": roll,
    "pitch_deg": pitch,
    "heading_deg": heading,
    "tilt_sigma_deg": max(sigma[:2]),
    "heading_sigma_deg": sigma[2],
    "latitude_deg": np.degrees(log.gnss.latitude[fix]),
    "longitude_deg": np.degrees(log.gnss.longitude[fix]),
    "height_m": log.gnss.height[fix],
    "velocity_mps": log.gnss.velocity_n[fix],
    "position_sigma_m": (20.0, 20.0, 20.0),
    "velocity_sigma_mps": (1.0, 1.0, 1.0),
}
initial = log.description.initial.model_copy(update=start)
description = log.description.model_copy(update={"initial": initial, "estimator": {}})  # all aids
report = insenv.replay(replace(log, description=description), "fusion", start="stated")
fused = report.results[0]
print(f"heading at 450 s: error {fused.errors['heading_deg'][-1]:+.2f} deg, stated {fused.sigma['heading_deg'][-1]:.2f} deg")
print(*fused.health.lines, sep="\n")
