"""Barometer: height by the pressure of the air.

At an epoch, with the true height h, that at the start h0, and the speed v:

    y = h + lag + bias + drift + k_h (h - h0) - k_v v^2 / (2 g) + noise w,   rounded to the quantum

The lag is that of a first-order low-pass of the height with the time constant T, e' = -e / T - h', stepped exactly for a
height that is linear over a sample.  The bias is constant (the weather, the calibration), the drift a first-order Gauss-Markov
process. k_h: air warmer or colder than the standard atmosphere by dT makes heights above the start wrong by dT / 288 K.  k_v:
the share of the dynamic pressure that the port takes for static pressure; without wind, v is the speed over the ground.  The
height is that above the ellipsoid: the difference to mean sea level is part of the bias.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from insenv.base.toml import Number, key
from insenv.core.elementary import exp
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors import units
from insenv.sensors.contract import ErrorSource, Sensor
from insenv.sensors.figures import Figure, FiguresSection, Grade, TimedSection, by_name, figures_section
from insenv.sensors.imu import normals
from insenv.sensors.imu_tables import HUGE
from insenv.sensors.instruments import BAROMETER
from insenv.sensors.sampled import QUANTUM_SIGMA, Motion, Sampled, gauss_markov, root_sum, rounded

PARAMETERS = Table((
    Row("barometer_noise", "White noise of a height, standard deviation", "m", lower=0.0),
    Row("barometer_bias", "Constant error, fixed part", "m"),
    Row("barometer_bias_sigma", "Constant error, 1 sigma of the part drawn at the start", "m", lower=0.0),
    Row("barometer_drift_sigma", "Slowly changing error (Gauss-Markov), standard deviation", "m", lower=0.0),
    Row("barometer_drift_time", "Slowly changing error (Gauss-Markov), correlation time", "s", start=600.0, lower=1e-3,
        upper=HUGE),
    Row("barometer_scale_factor", "Error per height above the start, fixed part"),
    Row("barometer_scale_factor_sigma", "Error per height above the start, 1 sigma of the part drawn at the start", lower=0.0),
    Row("barometer_speed_error", "Share of the dynamic pressure that is taken for static pressure", lower=-10.0, upper=10.0),
    Row("barometer_lag", "Time constant with which the shown height follows", "s", lower=0.0, upper=1e3),
    Row("barometer_quantum", "Step in which the height is shown, 0 for none", "m", lower=0.0),
))  # fmt: skip

STATE = Table((
    Row("barometer_bias_true", "Bias and drift together at the latest epoch", "m"),
    Row("barometer_scale_factor_true", "Error per height above the start"),
    Row("barometer_turn_on", "Bias, fixed and drawn", "m"),
    Row("barometer_drift", "Drift at the latest epoch", "m"),
    Row("barometer_behind", "Followed height minus true height", "m"),
    Row("barometer_kept", "Part of the lag that is left after a sample"),
    Row("barometer_falling", "Change of the lag per change of height over a sample"),
    Row("barometer_last_height", "True height at the end of the sample before", "m"),
))  # fmt: skip


def _start(p: Values, r: Any) -> dict[str, Any]:
    n = normals(r)
    lag = p.barometer_lag
    kept = (lag > 0.0) * exp(-p.sample_interval / (lag + (lag == 0.0)))
    bias = p.barometer_bias + p.barometer_bias_sigma * n[0]
    drift = p.barometer_drift_sigma * n[1]
    return {
        "barometer_turn_on": bias,
        "barometer_drift": drift,
        "barometer_bias_true": bias + drift,
        "barometer_scale_factor_true": p.barometer_scale_factor + p.barometer_scale_factor_sigma * n[2],
        "barometer_kept": kept,
        "barometer_falling": (1.0 - kept) * lag / p.sample_interval,
        "barometer_last_height": p.start_height,
    }


def _sample(p: Values, x: Values, u: Values) -> dict[str, Any]:
    rise = x.height - x.barometer_last_height
    return {
        "barometer_behind": x.barometer_kept * x.barometer_behind - x.barometer_falling * rise,
        "barometer_last_height": x.height,
    }


def _measure(p: Values, x: Values, r: Any, motion: Motion) -> dict[str, Any]:
    n = normals(r)
    drift = gauss_markov(x.barometer_drift, p.barometer_drift_sigma, p.barometer_drift_time, p.barometer_interval, n[0])
    bias = x.barometer_turn_on + drift
    climbed = x.barometer_scale_factor_true * (x.height - p.start_height)
    ram = p.barometer_speed_error * (0.5 / STANDARD_GRAVITY) * ca.sumsqr(x.velocity_n)
    shown = x.height + x.barometer_behind + bias + climbed - ram + p.barometer_noise * n[1]
    return {
        "barometer_height": rounded(shown, p.barometer_quantum),
        "barometer_height_true": x.height,
        "barometer_bias_true": bias,
        "barometer_drift": drift,
    }


def _told(rows: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "barometer_noise": root_sum(rows["barometer_noise"], QUANTUM_SIGMA * rows["barometer_quantum"]),
        "barometer_bias_sigma": root_sum(rows["barometer_bias"], rows["barometer_bias_sigma"]),
        "barometer_drift_sigma": rows["barometer_drift_sigma"],
        "barometer_drift_time": rows["barometer_drift_time"],
        "barometer_scale_factor_sigma": root_sum(rows["barometer_scale_factor"], rows["barometer_scale_factor_sigma"]),
        "barometer_speed_error": root_sum(rows["barometer_speed_error"]),
        "barometer_lag": rows["barometer_lag"],
    }


ERRORS = (
    ErrorSource("barometer noise", ("barometer_noise",)),
    ErrorSource("barometer bias", ("barometer_bias", "barometer_bias_sigma")),
    ErrorSource("barometer drift", ("barometer_drift_sigma",)),
    ErrorSource("barometer scale factor", ("barometer_scale_factor", "barometer_scale_factor_sigma")),
    ErrorSource("barometer dynamic pressure", ("barometer_speed_error",)),
    ErrorSource("barometer lag", ("barometer_lag",)),
    ErrorSource("barometer rounding", ("barometer_quantum",)),
)

EQUATIONS = Sampled(
    BAROMETER,
    parameters=PARAMETERS,
    state=STATE,
    exact=Table((Row("barometer_height_true", "True height above the ellipsoid at the epoch of the measurement", "m"),)),
    measure=_measure,
    uniforms=2,
    truth=("barometer_bias_true", "barometer_scale_factor_true"),
    told=_told,
    errors=ERRORS,
    start=_start,
    start_uniforms=4,
    sample=_sample,
)

FIGURES: dict[str, Figure] = {
    "noise_m": Figure("barometer_noise", "m"),
    "bias_m": Figure("barometer_bias", "m"),
    "bias_sigma_m": Figure("barometer_bias_sigma", "m"),
    "drift_sigma_m": Figure("barometer_drift_sigma", "m"),
    "drift_time_s": Figure("barometer_drift_time", "s"),
    "scale_factor_percent": Figure("barometer_scale_factor", "%", units.percent_to_one),
    "scale_factor_sigma_percent": Figure("barometer_scale_factor_sigma", "%", units.percent_to_one),
    "speed_error_percent": Figure("barometer_speed_error", "%", units.percent_to_one),
    "lag_s": Figure("barometer_lag", "s"),
    "quantum_m": Figure("barometer_quantum", "m"),
}

_WEATHER = "insenv's choice: the weather, not a matter of the sensor; 0.24 hPa, 1 sigma, at 8.4 m per hPa"
_AIR = "insenv's choice: air temperature known to 6 K, 2 % of 288 K"

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade(
        "ms5611",
        "MS5611, a barometer of autopilots and flight recorders",
        {
            "noise_m": "TE MS5611-01BA03 data sheet: resolution 0.012 mbar rms at the highest oversampling; 8.4 cm per Pa",
            "bias_sigma_m": "Same data sheet: +-1.5 mbar at 25 deg C, read as 2 sigma: 6.3 m",
            "drift_sigma_m": _WEATHER,
            "drift_time_s": _WEATHER,
            "scale_factor_sigma_percent": _AIR,
            "lag_s": "Delay that ArduPilot's EKF3 assumes of a barometer: 60 ms",
        },
        {
            "noise_m": 0.10,
            "bias_sigma_m": 6.3,
            "drift_sigma_m": 2.0,
            "drift_time_s": 7200.0,
            "scale_factor_sigma_percent": 2.0,
            "lag_s": 0.06,
        },
    ),
    Grade(
        "dps310",
        "DPS310, a consumer barometer",
        {
            "noise_m": "Infineon DPS422 data sheet, alike: precision +-5 cm",
            "bias_sigma_m": "Same data sheet: absolute accuracy +-1 hPa, read as 2 sigma: 4.2 m",
            "drift_sigma_m": _WEATHER,
            "drift_time_s": _WEATHER,
            "scale_factor_sigma_percent": _AIR,
        },
        {
            "noise_m": 0.05,
            "bias_sigma_m": 4.2,
            "drift_sigma_m": 2.0,
            "drift_time_s": 7200.0,
            "scale_factor_sigma_percent": 2.0,
        },
    ),
)  # fmt: skip

if TYPE_CHECKING:
    BarometerFigures = FiguresSection
else:
    BarometerFigures = figures_section("BarometerFigures", PARAMETERS, GRADES, FIGURES, "ms5611")


class BarometerSection(BarometerFigures, TimedSection):
    """The barometer."""

    sensor: ClassVar[Sensor] = EQUATIONS.sensor()

    interval_s: Number = key(0.05, "interval between measurements, a whole number of samples", "s", gt=0, le=3600)

    def rows(self, rate_hz: float) -> dict[str, Any]:
        """Parameter rows (SI) for samples at `rate_hz`.  Raises `InputError` for times that do not fit the samples."""
        return {**self.timing(rate_hz), **self.error_rows()}
