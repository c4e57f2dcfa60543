"""What is known of a vehicle that stays in place: it rests, or it sways about a place.

At rest the velocity is measured as 0.  A moored ship cannot be said to stand still: its heave moves it by metres.  What is
known is that its displacement from an unknown place is a sum of oscillations, of which the frequencies are known, and
neither amplitude nor phase on any axis.  On the known axes alone the sway would be a compass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv.evaluation.limits.states import Source, constants
from insenv.evaluation.limits.steps import REST_MPS

Array = NDArray[np.float64]

REST_SIGMA = 1e-5
"""Standard deviation of the velocity of a vehicle at rest, m/s, in each step."""
SWAY_SIGMA = 1e-4
"""Standard deviation of the displacement of a moored vehicle from its place and sway, m, in each step."""
PLACE_SIGMA = 100.0
"""Standard deviation of the place of a mooring, m: nothing is known of it but the initial position."""
_ANGLES, _DISPLACEMENTS = ("roll", "pitch", "yaw"), ("north", "east", "down")
_LEAST_LENGTH, _LEAST_ANGLE = 1e-4, 1e-4
"""Smallest amplitudes, m and rad, of a frequency that counts as sway."""


@dataclass(frozen=True)
class Mooring:
    """A sway: angular frequencies (k,), rad/s, and the standard deviation of each sinusoid's coefficients, m."""

    frequencies: Array
    sigma: float

    def sources(self) -> tuple[Source, Source]:
        """The place (3), and the coefficients of cosine and sine by frequency and axis n (k x 2 x 3)."""
        count = 6 * len(self.frequencies)
        return constants("place", np.full(3, PLACE_SIGMA**2)), constants("sway", np.full(count, self.sigma**2))

    def rows(self, time: Array) -> Array:
        """The displacement by the states of `sources`, (m, 3, 3 + 6 k), at times (m,)."""
        angle = time[:, None] * self.frequencies
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(len(time), 1, -1, 1)
        axes = np.eye(3)
        sway = (waves * axes[:, None]).reshape(len(time), 3, -1)
        return np.concatenate([np.broadcast_to(axes, (len(time), 3, 3)), sway], axis=2)


def mooring_of(rows: Mapping[str, Any]) -> Mooring | None:
    """The sway of a vehicle that stays in place, from a plant's parameters by row name (SI); None if it rests.

    Frequencies are those of all its sinusoids (rows ``*_angular_frequency`` and ``*_amplitude``), of rotations too: a ship
    that rolls at a frequency moves at it.  Without that frequency the limit would distinguish accelerometer biases, which turn
    with the ship, from tilts, which do not.
    """
    arm = float(np.linalg.norm(rows.get("imu_lever_arm_b", 0.0)))
    moved: dict[float, float] = {}  # sum of the amplitudes, m, by angular frequency
    turned: dict[float, float] = {}  # the same, rad
    for name, value in rows.items():
        bank = name.removesuffix("_angular_frequency")
        if bank == name:
            continue
        frequencies = np.atleast_1d(np.asarray(value, dtype=float))
        for motion in (*_ANGLES, *_DISPLACEMENTS):
            amplitude = rows.get(f"{motion}_amplitude" if bank == motion else f"{bank}_{motion}_amplitude", 0.0)
            sizes = np.abs(np.broadcast_to(amplitude, frequencies.shape)).tolist()
            for frequency, size in zip(frequencies.tolist(), sizes, strict=True):
                turns = motion in _ANGLES
                turned[frequency] = turned.get(frequency, 0.0) + (size if turns else 0.0)
                moved[frequency] = moved.get(frequency, 0.0) + (arm * size if turns else size)
    if np.sqrt(sum((w * length) ** 2 for w, length in moved.items()) / 2.0) < REST_MPS / 2:
        return None
    swaying = [w for w, length in moved.items() if length > _LEAST_LENGTH or turned[w] > _LEAST_ANGLE]
    return Mooring(np.array(sorted(swaying)), float(np.linalg.norm(list(moved.values()))))
