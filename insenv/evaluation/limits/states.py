"""The error sources of a plant as states of the optimal filter: variances, drives, and how they enter the navigation errors.

A source without variance has no state.  A fixed error (a bias that the data sheet of a scenario gives as a number) counts as
one standard deviation of the ensemble of units, as a drawn one does.  Not counted, because they can only add to the error:
quantization, the range of the sensors, lost samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insenv import attitude
from insenv.core.tables import Array
from insenv.evaluation.limits.steps import REST_MPS, Steps
from insenv.sensors.imu_tables import FLICKER_PARTS, FLICKER_SIGMA, FLICKER_TIMES

LEAST_ANGLE_NOISE, LEAST_VELOCITY_NOISE = 1e-9, 1e-7
"""White noise of a unit without any, rad/s^0.5 and m/s^1.5, which keeps the recursion regular."""
_OFF_DIAGONAL = (1, 2, 3, 5, 6, 7)
"""Places of the axis couplings xy, xz, yx, yz, zx, zy in a 3 x 3 matrix by rows."""
_TRIADS = (("gyro", 0), ("accel", 1))


@dataclass(frozen=True)
class Source:
    """k states of one kind.

    name: of the kind.  triad: 0 gyros, 1 accelerometers, 2 both, None neither.  place (k,): which of the kind's components
    the states are.  variance (k,): at time 0.  walk (k,): variance per second of a random walk.  time (k,): correlation time
    of a stationary Gauss-Markov process, s; infinite: none.
    """

    name: str
    triad: int | None
    place: NDArray[np.int64]
    variance: Array
    walk: Array
    time: Array


@dataclass(frozen=True)
class Unit:
    """The inertial unit, with the gravity that it measures: its sources, its white noise and its temperature.

    noise (2, 3): white noise of gyros (rad/s^0.5) and accelerometers (m/s^1.5), s.  C_bs (3, 3): from sensor to body axes.
    temperatures: initial, final and reference temperature (K), time constant (s) and ramp (K/s).
    """

    sources: tuple[Source, ...]
    noise: Array
    C_bs: Array
    temperatures: tuple[float, ...]


def unit_of(rows: Mapping[str, Any]) -> Unit:
    """The inertial unit of a plant's parameters by row name (SI)."""

    def row(name: str, size: int) -> Array:
        return np.broadcast_to(np.asarray(rows.get(name, 0.0), dtype=float).ravel(), size)

    sources: list[Source | None] = []
    shortest = 0.5 * float(rows.get("drift_interval", 1.0))  # the plant interpolates between values this far apart, twice
    for name, triad in _TRIADS:
        turn_on = row(f"{name}_bias", 3) ** 2 + row(f"{name}_bias_sigma", 3) ** 2
        sources.append(source("bias", triad, turn_on, walk=row(f"{name}_rate_random_walk", 3) ** 2))
        times = np.maximum(row(f"{name}_instability_time", 3), shortest)
        sources.append(source("in-run bias", triad, row(f"{name}_instability_sigma", 3) ** 2, time=times))
        floor = FLICKER_SIGMA * row(f"{name}_flicker", 3)
        sources += [
            source(f"flicker {part}", triad, floor**2, time=np.full(3, FLICKER_TIMES[part])) for part in range(FLICKER_PARTS)
        ]
        sources.append(source("thermal bias", triad, row(f"{name}_temperature_slope", 3) ** 2))
        sources.append(source("thermal scale factor", triad, row(f"{name}_scale_factor_slope", 3) ** 2))
        matrix = np.zeros(9)
        matrix[[0, 4, 8]] = row(f"{name}_scale_factor", 3) ** 2 + row(f"{name}_scale_factor_sigma", 3) ** 2
        matrix[list(_OFF_DIAGONAL)] = row(f"{name}_misalignment", 6) ** 2 + row(f"{name}_misalignment_sigma", 6) ** 2
        sources.append(source("matrix", triad, matrix))
    sources.append(source("g-sensitivity", 0, row("gyro_g_sensitivity", 9) ** 2))
    sources.append(source("gravity", None, row("gravity_disturbance_n", 3) ** 2))
    sources.append(source("mounting", 2, row("mounting_error", 3) ** 2 + row("mounting_error_sigma", 3) ** 2))
    q_bs = np.asarray(rows.get("q_bs", (1.0, 0.0, 0.0, 0.0)), dtype=float)
    white = [
        np.maximum(np.abs(row("angle_random_walk", 3)), LEAST_ANGLE_NOISE),
        np.maximum(np.abs(row("velocity_random_walk", 3)), LEAST_VELOCITY_NOISE),
    ]
    usual = {"initial": 293.15, "final": 293.15, "reference": 293.15, "time": 600.0, "ramp": 0.0}
    return Unit(
        sources=tuple(source for source in sources if source is not None),
        noise=np.array(white),
        C_bs=attitude.numeric.to_dcm(q_bs / np.linalg.norm(q_bs)),
        temperatures=tuple(float(rows.get(f"imu_temperature_{name}", value)) for name, value in usual.items()),
    )


def wander_of(rows: Mapping[str, Any]) -> Source | None:
    """The slowly varying error of the fixes (n, m), from a plant's parameters by row name; None if there is none."""
    sigma = np.broadcast_to(np.asarray(rows.get("gnss_wander_sigma", 0.0), dtype=float), 3)
    return source("wander", None, sigma**2, time=np.full(3, float(rows.get("gnss_wander_time", 1.0))))


def receiver_of(rows: Mapping[str, Any]) -> tuple[Source | None, Source | None]:
    """The errors of the lever arm (b, m) and of the delay (s) of a receiver."""

    def square(name: str, size: int) -> Array:
        pair = (np.asarray(rows.get(f"{name}_{part}", 0.0), dtype=float) for part in ("error", "sigma"))
        return np.asarray(sum(np.broadcast_to(each, size) ** 2 for each in pair))

    return source("lever arm", None, square("antenna_lever_arm", 3)), source("delay", None, square("gnss_delay", 1))


def constants(name: str, variance: Array) -> Source:
    """States that do not change, such as the place of a mooring; `variance` (k,) > 0."""
    made = source(name, None, variance)
    assert made is not None
    return made


def source(
    name: str, triad: int | None, variance: Array, walk: Array | None = None, time: Array | None = None
) -> Source | None:
    """The states of one kind, those of its components (k,) that vary; None if none does."""
    walk = np.zeros_like(variance) if walk is None else walk
    time = np.full_like(variance, np.inf) if time is None else time
    (place,) = np.nonzero((variance > 0.0) | (walk > 0.0))
    return Source(name, triad, place, variance[place], walk[place], time[place]) if place.size else None


def entering(source: Source, unit: Unit, steps: Steps, force: Array) -> Array:
    """How the states enter over each step (m, 6, k): integrals of the gyros' error (rad) and of that of the accelerometers
    (m/s) in n, by state.

    force (m, 3, 3, 3): as `Steps.force`; at rest that of gravity alone.
    """
    columns = np.zeros((len(steps.time), 6, source.place.size))
    if source.name == "gravity":  # the estimate lacks it
        columns[:, 3:] = -np.eye(3)[:, source.place] * steps.length[:, None, None]
    if source.triad is None:
        return columns
    for triad in (0, 1) if source.triad == 2 else (source.triad,):
        increments = steps.angle if triad == 0 else force
        columns[:, 3 * triad : 3 * triad + 3] = _columns(source, unit, steps, increments, force)
    return columns


def _columns(source: Source, unit: Unit, steps: Steps, increments: Array, force: Array) -> Array:
    if source.name in ("bias", "in-run bias") or source.name.startswith("flicker"):
        columns = steps.C_ns
    elif source.name == "thermal bias":
        columns = steps.C_ns * _warmth(unit, steps)
    elif source.name == "thermal scale factor":
        columns = increments.reshape(-1, 3, 9)[:, :, [0, 4, 8]] * _warmth(unit, steps)
    elif source.name == "matrix":
        columns = increments.reshape(-1, 3, 9)
    elif source.name == "g-sensitivity":
        columns = force.reshape(-1, 3, 9)
    else:  # mounting: the increments d are sensed as d + d x e
        columns = np.einsum("mnkj,kjl->mnl", increments, _CROSS)
    return np.asarray(columns[:, :, source.place])


def _warmth(unit: Unit, steps: Steps) -> Array:
    """Temperature of the unit in the middle of each step above that of reference, K (m, 1, 1)."""
    initial, final, reference, constant, ramp = unit.temperatures
    middle = steps.time - steps.length / 2
    warmth = final + ramp * middle + (initial - final) * np.exp(-middle / constant) - reference
    return np.asarray(warmth)[:, None, None]


_CROSS = np.zeros((3, 3, 3))
"""(d x e)_k = sum over j and l of _CROSS[k, j, l] d_j e_l."""
for _k, _j, _l in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_k, _j, _l], _CROSS[_k, _l, _j] = 1.0, -1.0


# What is known of a vehicle that stays in place: it rests, or it sways about a place.
#
# At rest the velocity is measured as 0.  A moored ship cannot be said to stand still: its heave moves it by metres.  What is
# known is that its displacement from an unknown place is a sum of oscillations, of which the frequencies are known, and
# neither amplitude nor phase on any axis.  On the known axes alone the sway would be a compass.

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
