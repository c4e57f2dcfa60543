"""The data sheet of an inertial unit, to which estimators are tuned, from the unit's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np

from insenv.core.tables import Vector
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors import units
from insenv.sensors.imu_tables import FLICKER_SIGMA, FLICKER_TIMES

_power = np.float_power  # the C library's, as of Python's floats; that of NumPy's ** may differ in the last bit


PROPORTIONAL = {triad: (f"{triad}_scale", f"{triad}_misalignment") for triad in ("gyro", "accel")}
"""By triad, its errors in proportion to its own increments: states of a filter, whose fields below are ``NAME_sigma``."""
MOTION_ERRORS = {"gyro": "rotation_error", "accel": "thrust_error"}
"""By triad, the name of those errors together in `Knowledge` and among the parameters of estimators."""


@dataclass(frozen=True)
class ImuDataSheet:
    """Data sheet of the inertial unit, SI: the numbers that estimators are tuned by.

    angle_random_walk rad/s^0.5, velocity_random_walk m/s^1.5; gyro_bias_sigma rad/s, accel_bias_sigma m/s^2; correlation
    times s.  These biases contain what gravity makes of the g-sensitivity, and of the scale factor and the misalignment of the
    accelerometers.  bare_*: the same without, for a filter that estimates those; 0: not stated.
    *_scale_sigma, *_misalignment_sigma: 1; gyro_g_sensitivity_sigma rad s/m; 0: none, or not stated.  *_scale_time: correlation
    time of both, s; 0: constant.
    standing_*: the white noises at rest, where vibration makes those in motion larger; 0: as those.
    """

    angle_random_walk: float = 1e-6
    velocity_random_walk: float = 1e-4
    gyro_bias_sigma: float = 1e-7
    accel_bias_sigma: float = 1e-3
    gyro_correlation_time: float = 3600.0
    accel_correlation_time: float = 3600.0
    bare_gyro_bias_sigma: float = 0.0
    bare_accel_bias_sigma: float = 0.0
    bare_gyro_correlation_time: float = 3600.0
    bare_accel_correlation_time: float = 3600.0
    gyro_scale_sigma: float = 0.0
    accel_scale_sigma: float = 0.0
    gyro_misalignment_sigma: float = 0.0
    accel_misalignment_sigma: float = 0.0
    gyro_g_sensitivity_sigma: float = 0.0
    gyro_scale_time: float = 0.0
    accel_scale_time: float = 0.0
    standing_angle_random_walk: float = 0.0
    standing_velocity_random_walk: float = 0.0


def imu_data_sheet(rows: Mapping[str, Any], in_place: bool) -> ImuDataSheet:
    """Data sheet of a unit with these parameter rows (SI): `data_sheets` of one unit."""
    sheets = data_sheets({name: np.asarray(value)[None] for name, value in rows.items()}, in_place)
    return ImuDataSheet(**{name: float(values[0]) for name, values in sheets.items()})


def data_sheets(rows: Mapping[str, Any], in_place: bool) -> dict[str, Vector]:
    """Data sheets of k units with these parameter rows (SI, (k, ...)): statistics, not the values drawn for a run.

    Returns the fields of `ImuDataSheet` by name, (k,) each.

    Standard deviation of the bias, largest axis: the fixed, turn-on and in-run parts, and the effect of gravity
    through g-sensitivity (gyros) and misalignment (accelerometers).  For a moving vehicle also the accelerometers'
    scale factor; for one in place and nearly level it affects only the vertical axis.  Thermal errors count with the largest
    distance from the temperature of reference, and a ramp with what it makes in an hour.  Correlation time: the driving
    noise of a first-order Gauss-Markov process with this standard deviation is that of the in-run part, the bias
    random walk, of the slow processes of the flicker noise and, with one hour, of the parts that depend on motion.  It is
    `CONSTANT` for a bias that does not change.  The fast processes of the flicker noise, which no filter can follow, count
    as white noise of the same density at low frequency.
    """
    gravity, count = STANDARD_GRAVITY, len(next(iter(rows.values()), (0,)))

    def largest(*names: str) -> list[Vector]:
        none = np.zeros(count)
        return [np.abs(rows[name]).reshape(count, -1).max(axis=1) if name in rows else none for name in names]

    notes: dict[str, Vector] = {}
    off, change, ramp, constant = _course(rows, count)
    for triad, white, floor in (("gyro", "angle_random_walk", 1e-9), ("accel", "velocity_random_walk", 1e-7)):
        time, noise, flickering, coupled, scale = largest(
            f"{triad}_instability_time", white, f"{triad}_flicker", f"{triad}_misalignment_sigma", f"{triad}_scale_factor_sigma"
        )
        slope, scale_slope = largest(f"{triad}_temperature_slope", f"{triad}_scale_factor_slope")
        scale = np.hypot(scale, scale_slope * (off + ramp))
        if triad == "gyro":
            motion = gravity * largest("gyro_g_sensitivity")[0]
        else:
            motion = gravity * (coupled if in_place else np.maximum(coupled, scale))
        figures = largest(*(f"{triad}_{name}" for name in ("bias", "bias_sigma", "instability_sigma", "rate_random_walk")))
        bias, bias_sigma, in_run, walk, motion, part = _power(np.array([*figures, motion, FLICKER_SIGMA * flickering]), 2)
        variance = bias + bias_sigma + in_run + motion
        drive = 2 * in_run / np.maximum(time, 1e-3) + walk + 2 * motion / units.HOUR
        warm, warming, ramped = _power(np.array([slope * off, slope * change, slope * ramp]), 2)
        variance, drive = variance + warm + ramped, drive + 2 * warming / constant + 2 * ramped / units.HOUR
        fast = np.zeros(count)
        for correlation in FLICKER_TIMES:
            if correlation < SLOW:
                fast = fast + 2 * part * correlation
            else:
                variance, drive = variance + part, drive + 2 * part / correlation
        notes[white] = np.maximum(list(map(hypot, noise.tolist(), _power(fast, 0.5).tolist())), floor)
        bare = variance - motion, drive - 2 * motion / units.HOUR
        for prefix, square_sum, driving in (("", variance, drive), ("bare_", *bare)):
            sigma = np.maximum(_power(np.maximum(square_sum, 0.0), 0.5), floor)
            square = _power(sigma, 2)
            notes[f"{prefix}{triad}_bias_sigma"] = sigma
            notes[f"{prefix}{triad}_correlation_time"] = 2 * square / np.maximum(driving, 2 * square / CONSTANT)
        notes[f"{triad}_scale_sigma"], notes[f"{triad}_misalignment_sigma"] = scale, coupled
        notes[f"{triad}_scale_time"] = largest(f"{triad}_scale_factor_time")[0]
    notes["gyro_g_sensitivity_sigma"] = largest("gyro_g_sensitivity")[0]
    notes |= {f"standing_{white}": np.zeros(count) for white in ("angle_random_walk", "velocity_random_walk")}
    return notes


def _course(rows: Mapping[str, Any], count: int) -> tuple[Vector, Vector, Vector, Vector]:
    """Largest distance from the temperature of reference, change by warming up, change by the ramp in an hour (K), and the
    time constant of warming up (s); (k,) each."""

    def of(name: str, otherwise: float) -> Vector:
        return np.broadcast_to(np.asarray(rows.get(f"imu_temperature_{name}", otherwise), dtype=float), count)

    initial, final, reference = (of(name, 293.15) for name in ("initial", "final", "reference"))
    off = np.maximum(np.abs(initial - reference), np.abs(final - reference))
    return off, np.abs(final - initial), np.abs(of("ramp", 0.0)) * units.HOUR, of("time", 600.0)


def motion_errors(sheets: Mapping[str, Any]) -> dict[str, Any]:
    """The `MOTION_ERRORS`, 1 sigma; sheets: fields of `ImuDataSheet` by name."""
    return {
        name: np.hypot(*(sheets[f"{error}_sigma"] for error in PROPORTIONAL[triad])) for triad, name in MOTION_ERRORS.items()
    }


CONSTANT = 1e9
"""Correlation time (s) of a bias that does not change."""
SLOW = 100.0
"""Correlation time (s) from which a process of the flicker noise is one of the bias."""
