"""An inertial unit whose grade the log does not state: its noise from the log, its biases by the class of such a noise.

Noise says little about biases: modern MEMS gyros are as quiet as tactical ones and drift a hundred times as much. So the
class is one coarser than the one that the noise suggests, and biases, scale factors and misalignments are the largest of that
class and all finer ones.
A log with less noise than any unit of the catalogue is simulated, rounded or smoothed; it is treated as the coarsest class.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from insenv.base.remarks import Remark, declared
from insenv.logs.inertial import InertialSamples
from insenv.logs.noise import noise_at_rest, noise_in_motion
from insenv.sensors import units
from insenv.sensors.catalogue import CLASSES
from insenv.sensors.grades import ImuGrade

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
