"""The fixes of a GNSS receiver as measurements of the error states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_NOISE = 1e-4
"""Smallest standard deviation of a fix, m and m/s: that of a receiver without errors."""


@dataclass(frozen=True)
class Fixes:
    """A receiver: when it measures, when it delivers, and how well.

    interval, latency: inertial samples.  offset: time from an epoch to its sample, s.  lever_arm (3): b, m.
    position, velocity (3): standard deviations of white noise in n, with the share of outliers as lost fixes; m and m/s,
    infinite where there is no measurement.  outages (k, 2): begin and end, s.  sample_interval: s.
    """

    interval: int
    latency: int
    offset: float
    lever_arm: Array
    position: Array
    velocity: Array
    outages: Array
    sample_interval: float

    def samples(self, count: int) -> NDArray[np.int64]:
        """0, the samples of all epochs and deliveries up to `count`, and `count`, rising."""
        epochs = np.arange(self.interval, count + 1, self.interval)
        found = np.unique(np.concatenate([[0, count], epochs, epochs + self.latency]))
        return found[found <= count].astype(np.int64)

    def measured(self, sample: int) -> bool:
        """Whether the sample is that of an epoch which gives a fix."""
        if sample % self.interval:
            return False
        time = sample * self.sample_interval - self.offset + 1e-6
        return not bool(np.any((time >= self.outages[:, 0]) & (time < self.outages[:, 1])))


def fixes_of(rows: Mapping[str, Any], sample_interval: float) -> Fixes | None:
    """The receiver of a plant's parameters by row name (SI); None if there is none."""
    if "gnss_interval" not in rows:
        return None
    good = 1.0 - float(rows["gnss_outlier_probability"])  # a detected outlier is a fix that is missing
    share = np.inf if good <= 0.0 else 1.0 / np.sqrt(good)
    position, velocity = (
        np.maximum(np.broadcast_to(np.asarray(rows[name], dtype=float), 3), LEAST_NOISE)
        for name in ("gnss_position_noise", "gnss_velocity_noise")
    )
    has_velocity = float(rows["gnss_has_velocity"]) != 0.0
    return Fixes(
        interval=round(float(rows["gnss_interval"]) / sample_interval),
        latency=round(float(rows["gnss_latency"]) / sample_interval),
        offset=float(rows["gnss_epoch_offset"]),
        lever_arm=np.asarray(rows["antenna_lever_arm_b"], dtype=float),
        position=position * share,
        velocity=velocity if has_velocity else np.full(3, np.inf),
        outages=np.stack([np.ravel(rows["gnss_outage_start"]), np.ravel(rows["gnss_outage_end"])], axis=1).astype(float),
        sample_interval=sample_interval,
    )
