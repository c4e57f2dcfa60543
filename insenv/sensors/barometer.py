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

from typing import Any

from insenv.core.elementary import exp
from insenv.core.model import Values
from insenv.core.tables import Row, Table
from insenv.geodesy import STANDARD_GRAVITY
from insenv.sensors.figures import Figure, Grade, by_name
from insenv.sensors.instrument import Column, Estimated, Instrument, Lag, Term, constant, drift, white

TIME_CONSTANT = Row("barometer_lag", "Time constant with which the shown height follows", "s", lower=0.0, upper=1e3)
TERMS = (
    white("barometer_noise", "barometer noise", "White noise of a height", "m", normals=(1,)),
    constant(
        "barometer_bias", "bias", "barometer bias", "Constant error: weather, calibration", "m", value="barometer_turn_on",
        states=(Estimated("barometer_bias", "constant height error of the barometer"),), normals=(0,),
    ),
    drift(
        "barometer_drift", "drift", "barometer drift", "Slowly changing error", "m",
        states=(Estimated("barometer_drift", "slowly varying height error of the barometer"),), normals=(1, 0),
    ),
    constant(
        "barometer_scale_factor", "scale_factor", "barometer scale factor",
        "Error per height above the start: air warmer or colder than the standard",
        states=(Estimated("barometer_scale", "height error of the barometer per height above the start"),), normals=(2,),
    ),
    Term(
        "speed_error", "barometer dynamic pressure", "constant",
        fixed=Row("barometer_speed_error", "Share of the dynamic pressure that is taken for static pressure", lower=-10.0,
                  upper=10.0),
        stated=(Row("barometer_speed_error", "Share of the dynamic pressure that is taken for static pressure, 1 sigma",
                    lower=0.0, upper=1e12),),
    ),
)  # fmt: skip


def _ram(share: Any, motion: Any) -> Any:
    """Height (m) by which dynamic pressure at the static port lowers what is shown."""
    return share * (0.5 / STANDARD_GRAVITY) * motion.speed_squared


def _measure(motion: Any, e: Values, p: Values) -> dict[str, Any]:
    height = motion.height + e.lag + (e.bias + e.drift) + e.scale_factor * motion.climbed - _ram(e.speed_error, motion)
    return {"barometer_height": height + e.noise}


def _lag_start(p: Values) -> dict[str, Any]:
    lag = p.barometer_lag
    remaining = (lag > 0.0) * exp(-p.sample_interval / (lag + (lag == 0.0)))
    return {
        "barometer_kept": remaining,
        "barometer_falling": (1.0 - remaining) * lag / p.sample_interval,
        "barometer_last_height": p.start_height,
    }


def _lag_sample(p: Values, x: Values) -> dict[str, Any]:
    rise = x.height - x.barometer_last_height
    return {
        "barometer_behind": x.barometer_kept * x.barometer_behind - x.barometer_falling * rise,
        "barometer_last_height": x.height,
    }


LAG = Lag(
    "lag",
    state=Table((
        Row("barometer_behind", "Followed height minus true height", "m"),
        Row("barometer_kept", "Part of the lag that is left after a sample"),
        Row("barometer_falling", "Change of the lag per change of height over a sample"),
        Row("barometer_last_height", "True height at the end of the sample before", "m"),
    )),
    start=_lag_start,
    sample=_lag_sample,
    value=lambda x: x.barometer_behind,
    estimate=lambda motion, p: p.barometer_lag * motion.velocity_down,
)  # fmt: skip

FIGURES: dict[str, Figure] = {
    "noise_m": Figure("barometer_noise", "m"),
    "bias_m": Figure("barometer_bias", "m"),
    "bias_sigma_m": Figure("barometer_bias_sigma", "m"),
    "drift_sigma_m": Figure("barometer_drift_sigma", "m"),
    "drift_time_s": Figure("barometer_drift_time", "s"),
    "scale_factor_percent": Figure("barometer_scale_factor", "%"),
    "scale_factor_sigma_percent": Figure("barometer_scale_factor_sigma", "%"),
    "speed_error_percent": Figure("barometer_speed_error", "%"),
    "lag_s": Figure("barometer_lag", "s"),
    "quantum_m": Figure("barometer_quantum", "m"),
}

_WEATHER = "insenv's choice: the weather, not a matter of the sensor; 0.24 hPa, 1 sigma, at 8.4 m per hPa"
_AIR = "insenv's choice: air temperature known to 6 K, 2 % of 288 K"

GRADES = by_name(
    Grade("perfect", "No errors"),
    Grade.of(
        "ms5611",
        "MS5611, a barometer of autopilots and flight recorders",
        noise_m=(0.10, "TE MS5611-01BA03 data sheet: resolution 0.012 mbar rms at the highest oversampling; 8.4 cm per Pa"),
        bias_sigma_m=(6.3, "Same data sheet: +-1.5 mbar at 25 deg C, read as 2 sigma: 6.3 m"),
        drift_sigma_m=(2.0, _WEATHER),
        drift_time_s=(7200.0, _WEATHER),
        scale_factor_sigma_percent=(2.0, _AIR),
        lag_s=(0.06, "Delay that ArduPilot's EKF3 assumes of a barometer: 60 ms"),
    ),
    Grade.of(
        "dps310",
        "DPS310, a consumer barometer",
        noise_m=(0.05, "Infineon DPS422 data sheet, alike: precision +-5 cm"),
        bias_sigma_m=(4.2, "Same data sheet: absolute accuracy +-1 hPa, read as 2 sigma: 4.2 m"),
        drift_sigma_m=(2.0, _WEATHER),
        drift_time_s=(7200.0, _WEATHER),
        scale_factor_sigma_percent=(2.0, _AIR),
    ),
)

BAROMETER = Instrument(
    "barometer",
    title="Barometer",
    called="the barometer",
    what="height",
    causes="the air pressure or the height to which it is set, a port that sees the wind, and its bias and drift sigmas",
    values=(
        Row("barometer_height", "Height above the WGS-84 ellipsoid by the pressure of the air", "m", lower=-1e5, upper=1e6),
    ),
    terms=TERMS,
    measure=_measure,
    holds=("vertical",),
    parameters=(TIME_CONSTANT,),
    stated=(TIME_CONSTANT,),
    exact=lambda motion, e, p: {"barometer_height_true": motion.height},
    exact_rows=(Row("barometer_height_true", "True height above the ellipsoid at the epoch of the measurement", "m"),),
    totals=((Row("barometer_bias_true", "Bias and drift together at the latest epoch", "m"), lambda e, p: e.bias + e.drift),),
    quantum=Row("barometer_quantum", "Step in which the height is shown, 0 for none", "m", lower=0.0),
    lag=LAG,
    aid_parameters=("barometer_noise", "barometer_speed_error", "barometer_lag", "barometer_drift_time"),
    least_sigma={"barometer_height": 0.01},
    lasting=lambda motion, p: (_ram(p.barometer_speed_error, motion) ** 2, p.barometer_drift_time),
    columns=(Column("height", "barometer_height", "height by the air pressure [m], up positive", offset="height_offset_m"),),
    figures=FIGURES,
    grades=GRADES,
    grade="ms5611",
    interval_s=0.05,
)
