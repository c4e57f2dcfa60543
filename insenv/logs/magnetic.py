"""What the readings of a magnetometer say of the magnetometer: that it is silent, out of scale, magnetised, or disturbed.

The strength of the field needs no attitude: of a calibrated magnetometer it is that of the Earth, whichever way the vehicle
turns.  With a scale factor 1/a and a constant field h of the vehicle it depends on the direction u of the field in the body:

    |y| = |m| / a + h . u

A strength that the stated errors do not explain is taken for a scale factor as far as it is the same in all directions that the
log has, and for a field of the vehicle as far as it is not or the directions do not tell.  Soft iron and axes are then those of
a magnetometer that nobody has calibrated on its vehicle.  What is left are currents.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.recorded import Readings
from insenv.sensors.magnetometer import FIELD, FIGURES, GRADES, MAGNETOMETER

_SILENT = declared(
    "magnetometer-silent",
    "{name}: {count} of {all} readings of the magnetic field are exactly 0, which is no field: they are left out",
)
_STRENGTH = declared(
    "magnetometer-strength",
    "{name}: the field is {strength:.3g} uT, that of the Earth here {earth:.3g} uT, and the stated errors allow {allowed:.2g} "
    "uT (1 sigma): the readings are multiplied by {scale:.3g}, the field of the vehicle starts with a standard deviation of "
    "{hard:.2g} uT, and soft iron and axes are those of the grade uncalibrated",
)
_DISTURBED = declared(
    "magnetometer-disturbed",
    "{name}: the strength of the field varies by {spread:.2g} uT beside hard and soft iron, for {time:.2g} s each time: its "
    "white noise is taken as {noise:.2g} uT instead of {stated:.2g} uT",
)
CONTRADICTED = 3.0
"""Standard deviations of the stated errors that the strength may be off by."""
WIDEST = 2.0
"""Largest scale factor, or its inverse, of a magnetometer; beyond, the unit is not the declared one."""
LEAST = 50
"""Readings that show anything."""
DISTURBED = 1.5
"""Ratio to the stated noise from which a variation of the strength is a disturbance."""
LONGEST_S = 30.0
"""Time over which the variations of the strength are compared with themselves, s."""
_HARD, _SOFT, _COUPLING, _NOISE = (
    f"magnetometer_{name}" for name in ("hard_iron_sigma", "soft_iron_sigma", "coupling_sigma", "noise")
)


def _uncalibrated() -> dict[str, float]:
    """Soft iron of a magnetometer that nobody has calibrated on its vehicle, by row."""
    grade = GRADES["uncalibrated"].figures
    rows = {FIGURES[name].row: FIGURES[name].to_si(value) for name, value in grade.items()}
    return {name: float(rows[name]) for name in (_SOFT, _COUPLING)}


def without_silence(readings: Sequence[Readings]) -> tuple[list[Readings], list[Remark]]:
    """The readings without magnetic fields of 0, which a logger writes for a magnetometer that is off or does not answer."""
    answered, remarks = [], []
    for each in readings:
        silent = np.full(len(each.time), each.id == MAGNETOMETER.id) & np.all(each.values == 0.0, axis=1)
        if silent.any():
            remarks.append(_SILENT.filled(name=each.name, count=np.count_nonzero(silent), all=silent.size))
        if not silent.all():
            answered.append(each.at(~silent) if silent.any() else each)
    return answered, remarks


def calibrated(readings: Readings, stated: Mapping[str, Any]) -> tuple[Readings, dict[str, Any], list[Remark]]:
    """The readings of a magnetometer in the scale of the Earth's field, and what they show of its errors.

    Returns the readings, the stated errors (SI, by row) that the log shows to be larger than `stated`, and what is said of
    them.
    """
    if len(readings.time) < LEAST:
        return readings, {}, []
    readings, of_strength, out_of_scale = _of_strength(readings, stated)
    noise, disturbed = _of_disturbance(readings, stated)
    return readings, {**of_strength, **noise}, [*out_of_scale, *disturbed]


def _of_strength(readings: Readings, stated: Mapping[str, Any]) -> tuple[Readings, dict[str, Any], list[Remark]]:
    strength, earth = _strength(readings), float(np.linalg.norm(stated[FIELD.name]))
    apart = float(np.median(np.abs(strength - earth)))
    errors = (stated[_HARD], stated[_SOFT] * earth, stated["magnetic_field_sigma"], stated["magnetometer_drift_sigma"])
    allowed = float(np.sqrt(sum(np.max(np.square(each)) for each in errors)))
    if apart <= CONTRADICTED * allowed:
        return readings, {}, []
    usual, hard = _fitted(readings.values / strength[:, None], strength, apart, _interval(readings))
    scale = earth / usual
    if not 1.0 / WIDEST <= scale <= WIDEST:
        return readings, {}, []
    sigma = max(float(stated[_HARD]), scale * hard)
    micro = {"strength": float(np.median(strength)), "earth": earth, "allowed": allowed, "hard": sigma}
    said = _STRENGTH.filled(name=readings.name, scale=scale, **{name: 1e6 * value for name, value in micro.items()})
    of_iron = {name: max(float(stated[name]), sigma) for name, sigma in _uncalibrated().items()}
    return replace(readings, values=scale * readings.values), {_HARD: sigma, **of_iron}, [said]


def _fitted(u: Array, strength: Array, apart: float, interval: float) -> tuple[float, float]:
    """The strength (T) without the field of the vehicle, and the root mean square (T) of that field's components.

    u (n, 3): directions of the field in the body; strength (n,), T; apart: T, what each component could be.  A component that
    the directions do not tell from a scale factor is taken to be as large as those that they tell; if they tell none, as
    `apart`.
    """
    U, usual = u - u.mean(axis=0), float(strength.mean())
    left = strength - usual - U @ np.linalg.lstsq(U, strength - usual, rcond=None)[0]
    variance = max(float(left.var()), (1e-3 * apart) ** 2)
    scatter, axes = np.linalg.eigh(U.T @ U)
    scatter = np.maximum(scatter - len(u) * variance / usual**2, 0.0)  # the noise turns the direction too
    weight = 1.0 / (variance * max(_lasting(left, interval) / interval, 1.0))
    covariance = axes @ np.diag(1.0 / (weight * scatter + apart**-2)) @ axes.T
    turning = axes @ np.diag(1.0 * (scatter > 0.0)) @ axes.T
    field_b = covariance @ turning @ (U.T @ (strength - usual)) * weight
    told = np.clip(1.0 - np.diag(covariance) / apart**2, 0.0, 1.0)
    untold = max(1.0 - told.sum(), 0.0)  # of one component
    square = (told @ field_b**2 + untold * apart**2) / (told.sum() + untold)
    return usual - float(u.mean(axis=0) @ field_b), float(np.sqrt(square))


def _of_disturbance(readings: Readings, stated: Mapping[str, Any]) -> tuple[dict[str, Any], list[Remark]]:
    """A white noise with the spectrum at low frequency of what disturbs the strength.

    Variations with the standard deviation s that last for a time T (the integral of their autocorrelation, on both sides of 0)
    have at low frequency the spectrum of a white noise with the standard deviation s sqrt(T / interval).
    """
    strength, interval = _strength(readings), _interval(readings)
    u = readings.values / strength[:, None]
    products = (u[:, 0] ** 2, u[:, 1] ** 2, u[:, 0] * u[:, 1], u[:, 0] * u[:, 2], u[:, 1] * u[:, 2])
    directions = np.column_stack([np.ones(len(u)), u, *products])
    left = strength - directions @ np.linalg.lstsq(directions, strength, rcond=None)[0]
    lasting, spread = _lasting(left, interval), float(left.std())
    noise, least = spread * float(np.sqrt(max(lasting / interval, 1.0))), float(stated[_NOISE])
    if noise <= DISTURBED * least:
        return {}, []
    micro = {"spread": spread, "noise": noise, "stated": least}
    said = _DISTURBED.filled(name=readings.name, time=lasting, **{name: 1e6 * value for name, value in micro.items()})
    return {_NOISE: noise}, [said]


def _lasting(values: Array, interval: float) -> float:
    """The time (s) that variations (n,) last: the integral of their autocorrelation until it vanishes, on both sides of 0."""
    power = np.abs(np.fft.rfft(values - values.mean(), 2 * len(values))) ** 2
    correlation = np.fft.irfft(power)[: min(round(LONGEST_S / interval), len(values) // 2) + 1]
    if correlation[0] <= 0.0:
        return 0.0
    below = np.flatnonzero(correlation <= 0.0)
    until = below[0] if below.size else len(correlation)
    return interval * float(1.0 + 2.0 * correlation[1:until].sum() / correlation[0])


def _strength(readings: Readings) -> Array:
    return np.asarray(np.linalg.norm(readings.values, axis=1))


def _interval(readings: Readings) -> float:
    return max(float(np.median(np.diff(readings.time))), 1e-3)
