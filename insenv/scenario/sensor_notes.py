"""The data sheet of an inertial unit, to which estimators are tuned, from the unit's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot
from typing import Any

import numpy as np

from insenv.estimators import SensorNotes
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors import flicker, units


def sensor_notes(rows: dict[str, Any], in_place: bool) -> SensorNotes:
    """Data sheet of a unit with these parameter rows (SI): statistics, not the values drawn for a run.

    Standard deviation of the bias, largest axis: the fixed, turn-on and in-run parts, and the effect of gravity
    through g-sensitivity (gyros) and misalignment (accelerometers).  For a moving vehicle also the accelerometers'
    scale factor; for one in place and nearly level it affects only the vertical axis.  Correlation time: the driving
    noise of a first-order Gauss-Markov process with this standard deviation is that of the in-run part, the bias
    random walk, of the slow processes of the flicker noise and, with one hour, of the parts that depend on motion.  It is
    `CONSTANT` for a bias that does not change.  The fast processes of the flicker noise, which no filter can follow, count
    as white noise of the same density at low frequency.
    """
    gravity = STANDARD_GRAVITY
    notes: dict[str, float] = {}
    for triad, white, floor in (("gyro", "angle_random_walk", 1e-9), ("accel", "velocity_random_walk", 1e-7)):
        largest = {name: float(np.max(np.abs(rows.get(f"{triad}_{name}", 0.0)))) for name in _NOTED}
        if triad == "gyro":
            motion = gravity * float(np.max(np.abs(rows.get("gyro_g_sensitivity", 0.0))))
        else:
            motion = gravity * max(largest["misalignment_sigma"], 0.0 if in_place else largest["scale_factor_sigma"])
        in_run = largest["instability_sigma"]
        variance = largest["bias"] ** 2 + largest["bias_sigma"] ** 2 + in_run**2 + motion**2
        drive = (
            2 * in_run**2 / max(largest["instability_time"], 1e-3)
            + largest["rate_random_walk"] ** 2
            + 2 * motion**2 / units.HOUR
        )
        fast = 0.0
        part = (flicker.SIGMA * largest["flicker"]) ** 2
        for time in flicker.TIMES:
            if time < SLOW:
                fast += 2 * part * time
            else:
                variance, drive = variance + part, drive + 2 * part / time
        notes[white] = max(hypot(float(np.max(np.abs(rows.get(white, 0.0)))), fast**0.5), floor)
        bare_drive = drive - 2 * motion**2 / units.HOUR
        for prefix, own, driving in (("", variance, drive), ("bare_", variance - motion**2, bare_drive)):
            sigma = max(max(own, 0.0) ** 0.5, floor)
            notes[f"{prefix}{triad}_bias_sigma"] = sigma
            notes[f"{prefix}{triad}_correlation_time"] = 2 * sigma**2 / max(driving, 2 * sigma**2 / CONSTANT)
        notes[f"{triad}_scale_sigma"] = largest["scale_factor_sigma"]
        notes[f"{triad}_misalignment_sigma"] = largest["misalignment_sigma"]
    notes["gyro_g_sensitivity_sigma"] = float(np.max(np.abs(rows.get("gyro_g_sensitivity", 0.0))))
    return SensorNotes(**notes)


def motion_error(rows: Mapping[str, Any], triad: str) -> float:
    """Scale factor and misalignment of a triad ("gyro", "accel"), 1 sigma, from a unit's rows: error per measured motion."""
    sigmas = (rows.get(f"{triad}_{name}", 0.0) for name in ("scale_factor_sigma", "misalignment_sigma"))
    return float(np.hypot(*(np.max(np.abs(sigma)) for sigma in sigmas)))


CONSTANT = 1e9
"""Correlation time (s) of a bias that does not change."""
SLOW = 100.0
"""Correlation time (s) from which a process of the flicker noise is one of the bias."""
_NOTED = (
    "bias", "bias_sigma", "instability_sigma", "instability_time", "rate_random_walk", "flicker", "scale_factor_sigma",
    "misalignment_sigma",
)  # fmt: skip
