"""White noise of an inertial unit from its own log, at rest and where the vehicle moves; the unit assumed by it.

The mean rates y over averaging times tau have white noise of variance N^2 / tau. Their k-th differences have (2k)!/(k!)^2
times that, and remove a polynomial of degree k - 1: a constant rate for k = 1 (then N^2 / tau is the Allan variance), smooth
motion for a high k.

Fourth differences are used. At rest they are taken over `REST_TIMES`: slow enough for an engine's vibration to average out
and for the low-pass filter in front of many logs to be passed, fast enough for the rocking of a parked vehicle to be smooth.
The median of their sizes is insensitive to a knock on the vehicle. In motion they are taken over shorter times, in the
quietest tenth of the log. Of several averaging times the one with the largest noise counts, because a low-pass filter hides
noise at the shortest.

What an engine and the air do to a unit acts as white noise on what is computed from its samples, as far as it is faster than
they are, bends its sensors or turns them against the vehicle. In flight it is ten to a hundred times the noise at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray

from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.inertial import InertialSamples
from insenv.sensors import units
from insenv.sensors.catalogue import CLASSES
from insenv.sensors.grades import ImuGrade

ORDER = 4
REST_TIMES = (0.04, 0.08, 0.16)
"""Averaging times at rest (s)."""
MOTION_TIMES = (0.0, 0.02, 0.04, 0.08)
"""Averaging times in motion (s); 0: of one sample."""
FLYING_S = 0.04
"""The longest of them (s) of the gyros of a vehicle that wings or rotors carry: it rolls several times a second, and over
longer times its gyros measure that. What they show then grows with the time, as white noise does not."""
WINDOW_S = 2.0
QUIET = 0.1
REST_RATE = 0.02
"""Largest standard deviation of a body rate of a vehicle at rest with its motor idling (rad/s)."""
REST_FORCE = 0.5
"""Largest standard deviation of the specific force, likewise (m/s^2)."""
MOVING_SPEED = 2.0
"""Speed over the ground (m/s) from which a vehicle moves."""
LEAST_MOTION_S = 20.0
"""Time in motion (s) from which a log shows its noise there."""
_MIN_DIFFERENCES = 8  # differences below which a time is not used


def spread_of(values: Array) -> Array:
    """The standard deviation (...) of values (n, ...) about 0 that outliers do not change."""
    return np.asarray(np.median(np.abs(values), axis=0) / 0.6744897501960817)  # of |z| for a standard normal z


def noise_at_rest(increments: Array, interval: float) -> float:
    """White noise density of the noisiest axis of a unit at rest (rad/s^0.5 or m/s^1.5); 0 without scatter.

    increments (n, 3): rad or m/s, over samples of `interval` (s); 100 samples or more.
    """
    densities = [0.0]
    for tau in REST_TIMES:
        samples = _samples(tau, interval)
        differences = _differences(increments, interval, samples)
        if len(differences) >= _MIN_DIFFERENCES or not densities[1:]:
            sizes = spread_of(differences) if len(differences) else np.zeros(3)
            densities.append(float(sizes.max() * np.sqrt(samples * interval)))
    return max(densities)


def noise_in_motion(
    increments: Array, interval: float, moving: NDArray[np.bool_] | None = None, longest: float = MOTION_TIMES[-1]
) -> float:
    """The same of a vehicle that moves: of its quietest tenth, which manoeuvres disturb least.

    moving (n,): the samples that count; None: all.  longest: averaging time (s) up to which `MOTION_TIMES` are used.
    """
    windows = [part for part in _windows(len(increments), interval) if moving is None or moving[part].all()]
    densities = [0.0]
    for tau in (tau for tau in MOTION_TIMES if tau <= longest):
        samples = _samples(tau, interval)
        differences = [_differences(increments[part], interval, samples) for part in windows]
        if differences and len(differences[0]) >= _MIN_DIFFERENCES:
            sizes = [np.sqrt(np.mean(each**2, axis=0)) for each in differences]
            densities.append(float(np.quantile(sizes, QUIET, axis=0).max() * np.sqrt(samples * interval)))
    return max(densities)


def _windows(count: int, interval: float) -> list[slice]:
    length = min(max(round(WINDOW_S / interval), 6 * _MIN_DIFFERENCES), count)
    return [slice(i, i + length) for i in range(0, count - length + 1, length)]


def shaken(rate_ib_b: Array, specific_force_b: Array) -> bool:
    """Whether samples (n, 3), rad/s and m/s^2, scatter more than those of a vehicle at rest with its motor idling."""
    return bool(rate_ib_b.std(axis=0).max() > REST_RATE or specific_force_b.std(axis=0).max() > REST_FORCE)


def in_motion(samples: InertialSamples, time: Array, speed: Array) -> NDArray[np.bool_]:
    """Which samples (n,) are of a vehicle that moves; none if too few are.

    time (m,) s, speed (m,) m/s: over the ground, empty where nothing shows it.  By the speed, or else by the scatter of the
    samples, as of a vehicle that hovers.
    """
    interval = float(np.median(samples.dt))
    if speed.size:
        moving = np.interp(samples.imu_time, time, speed) > MOVING_SPEED
        if samples.dt[moving].sum() >= LEAST_MOTION_S:
            return moving
    moving = np.zeros(len(samples.dt), dtype=bool)
    for part in _windows(len(samples.dt), interval):
        dt = samples.dt[part, None]
        moving[part] = shaken(samples.delta_angle[part] / dt, samples.delta_velocity[part] / dt)
    return moving if samples.dt[moving].sum() >= LEAST_MOTION_S else np.zeros_like(moving)


def densities_in_motion(samples: InertialSamples, moving: NDArray[np.bool_], flies: bool) -> dict[str, float]:
    """White noise densities of gyros and accelerometers (SI) by row, over the `moving` samples (n,).

    flies: whether wings or rotors carry the vehicle.
    """
    interval, longest = float(np.median(samples.dt)), FLYING_S if flies else MOTION_TIMES[-1]
    return {
        "angle_random_walk": noise_in_motion(samples.delta_angle, interval, moving, longest),
        "velocity_random_walk": noise_in_motion(samples.delta_velocity, interval, moving),
    }


def _samples(tau: float, interval: float) -> int:
    return max(round(tau / interval), 1)


def _differences(increments: Array, interval: float, samples: int) -> Array:
    """Differences of the mean rates over `samples` samples, scaled to the standard deviation of one mean rate."""
    count = len(increments) // samples
    means = increments[: count * samples].reshape(count, samples, -1).sum(axis=1) / (samples * interval)
    if count <= ORDER:
        return np.zeros((0, increments.shape[1]))
    return np.diff(means, ORDER, axis=0) / np.sqrt(comb(2 * ORDER, ORDER))


# An inertial unit whose grade the log does not state: its noise from the log, its biases by the class of such a noise.
#
# Noise says little about biases: modern MEMS gyros are as quiet as tactical ones and drift a hundred times as much. So the
# class is one coarser than the one that the noise suggests, and biases, scale factors and misalignments are the largest of that
# class and all finer ones.
# A log with less noise than any unit of the catalogue is simulated, rounded or smoothed; it is treated as the coarsest class.

MARGIN = 1.25
"""A class covers noise up to this much above its own."""
MIN_NOISE_SHARE = 0.1
"""A noise below this part of the finest class's says nothing of the unit."""
_REST_SAMPLES = 100
_LARGEST = (
    "gyro_bias_sigma_deg_h", "gyro_scale_factor_sigma_ppm", "gyro_misalignment_sigma_urad", "gyro_g_sensitivity_deg_h_g",
    "accel_bias_sigma_ug", "accel_scale_factor_sigma_ppm", "accel_misalignment_sigma_urad",
)  # fmt: skip
_ASSUMED = declared(
    "unit-assumed",
    "the log gives no grade of its inertial unit: white noise is {source} ({arw} deg/sqrt(h), {vrw} m/s/sqrt(h)), everything "
    "else is assumed to be that of class {name} (biases {gyro_bias} deg/h, {accel_bias} mg, 1 sigma); the key `grade` or "
    "[estimator.ID] replaces that",
)


@dataclass(frozen=True)
class AssumedUnit:
    """What is assumed of an unknown unit: its grade, the remark that says so, and the class of the catalogue."""

    grade: ImuGrade
    remark: Remark
    name: str


def assumed_unit(samples: InertialSamples, rest: tuple[float, float] | None) -> AssumedUnit:
    """The assumption for the unit of a log.  rest: start and end (s) of the time at rest, if one is known."""
    gyro, accel, where = _measured(samples, rest)
    finest = CLASSES[-1].parameters()
    lowest = [MIN_NOISE_SHARE * finest[name] for name in ("angle_random_walk", "velocity_random_walk")]
    measured = gyro >= lowest[0] and accel >= lowest[1]
    place = 0
    if measured:
        place = max(min(_class("angle_random_walk", gyro), _class("velocity_random_walk", accel)) - 1, 0)
    assumed = CLASSES[place]
    largest = {name: max(float(getattr(grade, name)) for grade in CLASSES[place:]) for name in _LARGEST}
    gyro_bias, accel_bias = largest["gyro_bias_sigma_deg_h"], largest["accel_bias_sigma_ug"]
    noise = assumed.parameters()
    if measured:
        noise |= {"angle_random_walk": gyro, "velocity_random_walk": accel}
    arw, vrw = noise["angle_random_walk"] / units.deg_sqrt_h_to_rad_sqrt_s(1.0), noise["velocity_random_walk"] * units.HOUR**0.5
    unit = assumed.changed(
        name="",
        title="",
        sources={},
        gyro_arw_deg_sqrt_h=float(arw),
        accel_vrw_ug_sqrt_hz=0.0,
        accel_vrw_m_s_sqrt_h=float(vrw),
        **largest,
    )
    source = f"the log's own {where}" if measured else f"that of class {assumed.name!r}, because the log has less than any unit"
    said = _ASSUMED.filled(
        source=source,
        arw=_round(float(arw)),
        vrw=_round(float(vrw)),
        name=repr(assumed.name),
        gyro_bias=_round(gyro_bias),
        accel_bias=_round(accel_bias / 1000),
    )
    return AssumedUnit(unit, said, assumed.name)


def _measured(samples: InertialSamples, rest: tuple[float, float] | None) -> tuple[float, float, str]:
    """Noise densities of gyros and accelerometers (SI), and where they are from."""
    interval = float(np.median(samples.dt))
    if rest is not None:
        still = (samples.imu_time >= rest[0]) & (samples.imu_time <= rest[1])
        if np.count_nonzero(still) >= _REST_SAMPLES:
            angle, velocity = samples.delta_angle[still], samples.delta_velocity[still]
            return noise_at_rest(angle, interval), noise_at_rest(velocity, interval), "at rest"
    angle, velocity = samples.delta_angle, samples.delta_velocity
    return noise_in_motion(angle, interval), noise_in_motion(velocity, interval), "in its quietest tenth"


def _round(value: float) -> str:
    """Two significant digits."""
    return f"{float(f'{value:.2g}'):g}"


def _class(row: str, noise: float) -> int:
    """Place of the finest class with at least this noise; of the coarsest, if none has."""
    for place in reversed(range(len(CLASSES))):
        if MARGIN * float(np.max(CLASSES[place].parameters()[row])) >= noise:
            return place
    return 0
