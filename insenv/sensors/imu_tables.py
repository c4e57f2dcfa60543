"""Rows of the inertial sensor's parameters and state, generated in the same way for the gyro and the accelerometer triad."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt
from typing import Any

import casadi as ca
import numpy as np

from insenv.core.elementary import exp
from insenv.core.tables import Array, Row, Table
from insenv.sensors.contract import HUGE

# Flicker noise of a bias: its Allan deviation has a floor, the "bias instability" of a data sheet.
#
# A spectrum S(f) = h / f (one-sided) has the Allan deviation sqrt(2 ln 2 h) at every averaging time. A sum of first-order
# Gauss-Markov processes of equal variance s^2, whose correlation times are spaced by a factor r, has the spectrum
# s^2 / (ln r f) between the inverses of its shortest and longest time, and so the floor
#
#     s sqrt(2 ln 2 / ln r)
#
# With one process a decade from 4 to 40000 s the Allan deviation lies within -8 and +1 % of the floor from 10 s to 50000 s.
# Below, it falls; the white noise of every real unit covers that part.
#
# Source: Keshner, "1/f noise", Proc. IEEE 70 (1982), 212-218: flicker noise as relaxation processes, one per decade; its
# Allan deviation: IEEE Std 952-1997, annex C.

FLICKER_TIMES = (4.0, 40.0, 400.0, 4000.0, 40000.0)
"""Correlation times of the processes, s."""
FLICKER_PARTS = len(FLICKER_TIMES)
FLICKER_SIGMA = sqrt(log(FLICKER_TIMES[1] / FLICKER_TIMES[0]) / (2.0 * log(2.0)))
"""Standard deviation of each process over the floor of their sum's Allan deviation."""


def advanced_flicker(parts: Any, floor: Any, h: Any, normals: Any, first: Any) -> Any:
    """The processes (3 x FLICKER_PARTS) after `h` seconds, stepped exactly; stationary from the first time on.

    parts: before. floor (3): of the Allan deviation, in the unit of the bias. normals: 3 FLICKER_PARTS standard normals.
    first: 1 at the first time, else 0.
    """
    columns = []
    for i, time in enumerate(FLICKER_TIMES):
        decay = (1.0 - first) * exp(-h / time)
        drive = FLICKER_SIGMA * floor * ca.sqrt((1.0 - decay) * (1.0 + decay))
        columns.append(decay * parts[:, i] + drive * normals[3 * i : 3 * i + 3])
    return ca.horzcat(*columns)


COUPLINGS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
"""Row and column of the axis couplings xy, xz, yx, yz, zx, zy, the order of the elements of a misalignment."""


@dataclass(frozen=True)
class Triad:
    """Three orthogonal sensors of one kind, with the units of what they measure.

    name: prefix of its rows; what: name in the meanings of the rows; increment, rate: units of the increment and of the
        rate; white, white_unit: the row of its white noise and its unit.
    """

    name: str
    what: str
    increment: str
    rate: str
    white: str
    white_unit: str

    def _row(self, name: str, meaning: str, unit: str, shape: tuple[int, ...] = (3,), **more: Any) -> Row:
        return Row(f"{self.name}_{name}", f"{self.what} {meaning}", unit, shape, "s" if shape else "", **more)

    def parameters(self) -> tuple[Row, ...]:
        """Parameter rows, all in sensor axes and with start values that mean "no error"."""
        row, unit, drawn = self._row, self.rate, "1 sigma of the part drawn at the start"
        pairs = "axis couplings xy, xz, yx, yz, zx, zy (measuring axis first)"
        markov = "in-run bias (Gauss-Markov)"
        return (
            row("bias", "turn-on bias, fixed part", unit),
            row("bias_sigma", f"turn-on bias, {drawn}", unit, lower=0.0),
            Row(self.white, f"{self.what} white noise density", self.white_unit, (3,), "s", lower=0.0),
            row("instability_sigma", f"{markov}, standard deviation", unit, lower=0.0),
            row("instability_time", f"{markov}, correlation time", "s", start=3600.0, lower=1e-3, upper=HUGE),
            row("rate_random_walk", "bias random walk density", f"{unit}/sqrt(s)", lower=0.0),
            row("flicker", "in-run bias with a flicker spectrum, floor of its Allan deviation", unit, lower=0.0),
            row("scale_factor", "scale factor error, fixed part", "1"),
            row("scale_factor_sigma", f"scale factor error, {drawn}", "1", lower=0.0),
            row("misalignment", f"misalignment, fixed part, {pairs}", "rad", (6,)),
            row("misalignment_sigma", f"misalignment, {drawn}, {pairs}", "rad", (6,), lower=0.0),
            row(
                "scale_factor_time",
                "scale factor and misalignment, correlation time of the drawn parts; 0: constant",
                "s",
                (),
                lower=0.0,
                upper=HUGE,
            ),
            row("temperature_slope", "bias per kelvin from the reference temperature", f"{unit}/K"),
            row("scale_factor_slope", "scale factor error per kelvin from the reference temperature", "1/K"),
            row("quantum", "increment of one count, 0 for none", self.increment, (), lower=0.0),
            row("range", "full scale", unit, (), start=HUGE, lower=1e-9, upper=HUGE),
        )

    def state(self) -> tuple[Row, ...]:
        """State rows; other models use ``*_bias_true``."""
        row, unit = self._row, self.rate
        identity = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        in_force, step = "total bias over the latest sample", "bias, change per sample until the next drift update"
        matrix = "errors of scale, alignment and mounting: transforms body increments to sensed ones"
        return (
            Row(f"{self.name}_bias_true", f"{self.what} {in_force}", unit, (3,), "b"),
            row("bias_s", in_force, unit),
            Row(f"{self.name}_bias_step_b", f"{self.what} {step}", unit, (3,), "b"),
            row("bias_step_s", step, unit),
            row("bias_turn_on", "turn-on bias, fixed and drawn", unit),
            row("instability", "in-run bias at the next drift update", unit),
            row("walk", "bias random walk at the next drift update", unit),
            row("flicker_parts", "flicker noise at the next drift update, its processes", unit, (3, FLICKER_PARTS)),
            row("error_matrix", matrix, "1", (3, 3), start=identity),
            row("drawn_matrix", "drawn parts of scale factor and misalignment at the next drift update", "1", (3, 3)),
            row("residual", "part of a count carried to the next sample", self.increment),
        )


GYRO = Triad("gyro", "Gyro", "rad", "rad/s", "angle_random_walk", "rad/s^0.5")
ACCEL = Triad("accel", "Accelerometer", "m/s", "m/s^2", "velocity_random_walk", "m/s^1.5")

_KELVIN: dict[str, Any] = {"start": 293.15, "lower": 1.0, "upper": 1000.0}

IMU_PARAMETERS = Table((
    *GYRO.parameters(),
    Row("gyro_g_sensitivity", "Gyro bias per specific force", "(rad/s)/(m/s^2)", (3, 3), "s"),
    *ACCEL.parameters(),
    Row(
        "q_bs",
        "Nominal mounting: transforms sensor to body components, and is used to output body axes",
        "1",
        (4,),
        "b",
        start=(1.0, 0.0, 0.0, 0.0),
        lower=-1.0,
        upper=1.0,
    ),
    Row(
        "mounting_error",
        "Rotation vector from the nominal to the actual sensor axes, fixed part",
        "rad",
        (3,),
        "s",
    ),
    Row(
        "mounting_error_sigma",
        "Rotation vector of the mounting, 1 sigma of the part drawn at the start",
        "rad",
        (3,),
        "s",
        lower=0.0,
    ),
    Row("imu_temperature_reference", "Temperature at which the thermal errors are zero", "K", **_KELVIN),
    Row("imu_temperature_initial", "Sensor temperature at the start", "K", **_KELVIN),
    Row("imu_temperature_final", "Sensor temperature after warming up, without the ramp", "K", **_KELVIN),
    Row("imu_temperature_ramp", "Steady change of the sensor temperature with its surroundings", "K/s"),
    Row("imu_temperature_time", "Time constant of warming up", "s", start=600.0, lower=1e-3, upper=HUGE),
    Row("imu_drop_probability", "Probability that a sample is lost", lower=0.0, upper=1.0),
    Row(
        "drift_interval",
        "Time between updates of the slow errors, which vary linearly in between",
        "s",
        start=1.0,
        lower=1e-4,
        upper=3600.0,
    ),
))  # fmt: skip

IMU_STATE = Table((
    Row("delta_angle", "Measured angle increment over the sample; 0 if it was lost", "rad", (3,), "b"),
    Row(
        "delta_velocity",
        "Measured specific-force increment over the sample; 0 if it was lost",
        "m/s",
        (3,),
        "b",
    ),
    Row("imu_valid", "1 if the sample arrived, 0 if it was lost", lower=0.0, upper=1.0, flag=True),
    *GYRO.state(),
    *ACCEL.state(),
    Row("gyro_g_matrix", "Gyro bias per specific force in body axes", "(rad/s)/(m/s^2)", (3, 3), "s"),
    Row("C_bs", "Nominal mounting: transforms sensor to body components", "1", (3, 3), "b"),
    Row("C_sb_true", "Actual mounting: transforms body to sensor components", "1", (3, 3), "s"),
    Row("imu_temperature", "Sensor temperature", "K", **_KELVIN),
    Row("imu_temperature_target", "Sensor temperature after warming up, with the ramp", "K", **_KELVIN),
    Row("imu_temperature_step", "Sensor temperature, change per sample until the next drift update", "K"),
    Row("drift_counter", "Samples since the latest drift update", start=HUGE),
    Row("drift_due", "1 on a sample that ends with a drift update", lower=0.0, upper=1.0),
))  # fmt: skip


# The thermal errors of a triad as a calibration states them, removed from its increments: the inverse of the sensor's model.
#
# With warmth T - T_0 above the temperature of reference, in sensor axes (`insenv.sensors.imu`):
#
#     y = (1 + k (T - T_0)) d + b (T - T_0) dt


def without_thermal_errors(increments: Array, dt: Array, warmth: Array, bias_slope: Array, scale_slope: Array) -> Array:
    """Increments (n, 3) of a triad without its thermal errors.

    increments (n, 3), rad or m/s, s; dt (n,), s; warmth (n,), K; bias_slope (3,), rad/s/K or m/s^2/K; scale_slope (3,), 1/K.
    """
    bias = (warmth * dt)[:, None] * bias_slope
    return np.asarray((increments - bias) / (1.0 + warmth[:, None] * scale_slope))
