"""What the readings of a magnetometer say of the magnetometer: that it is silent or stuck, out of scale, magnetised, disturbed.

The strength of the field needs no attitude: of a calibrated magnetometer it is that of the Earth, whichever way the vehicle
turns.  With a scale factor 1 / a and a constant field h of the vehicle the readings y lie on a sphere,

    |y - h| = |m| / a

Where the stated errors do not explain the strength, h is that of the sphere through the readings, as far as their directions
tell it, and a that of its radius.  Soft iron and axes are then those of a magnetometer that nobody has calibrated on its
vehicle.  What is left are currents.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.base.remarks import Remark, declared
from insenv.core.tables import Array
from insenv.logs.disturbance import DISTURBED, LEAST, interval_of, is_stuck, lasting_of, turned_by, white_noise
from insenv.logs.recorded import Readings, RecordedLog
from insenv.sensors.magnetometer import FIELD, FIGURES, GRADES, MAGNETOMETER

_SILENT = declared(
    "magnetometer-silent",
    "{name}: {count} of {all} readings of the magnetic field are exactly 0, which is no field: they are left out",
)
_STUCK = declared(
    "magnetometer-stuck",
    "{name}: all readings of the magnetic field are the same, and the gyros turn by {turned:.0f} deg: they are left out",
)
_IMPOSSIBLE = declared(
    "magnetometer-impossible",
    "{name}: the field is {ratio:.3g} times that of the Earth, more than scale factors and the iron of a vehicle make: the "
    "magnetometer is left out",
)
_OFF = (
    "{name}: the field is {strength:.3g} uT, that of the Earth here {earth:.3g} uT, and the stated errors allow {allowed:.2g} "
    "uT (1 sigma): "
)
_STRENGTH = declared(
    "magnetometer-strength",
    _OFF
    + "a field of {field} uT is taken off and the readings are multiplied by {scale:.3g}; the field of the vehicle starts with "
    "a standard deviation of {hard:.2g} uT, soft iron and axes are those of the grade uncalibrated",
)
_UNTOLD = declared(
    "magnetometer-untold",
    _OFF
    + "the vehicle turns too little to tell its field from a scale factor, which start with standard deviations of {hard:.2g} "
    "uT and {share:.2g} %",
)
_DISTURBED = declared(
    "magnetometer-disturbed",
    "{name}: the strength of the field varies by {spread:.2g} uT beside hard and soft iron, for {time:.2g} s each time: its "
    "white noise is taken as {noise:.2g} uT instead of {stated:.2g} uT",
)
CONTRADICTED = 3.0
"""Standard deviations of the stated errors that the strength may be off by."""
WIDEST = 2.0
"""Largest scale factor, or its inverse, of a magnetometer."""
_HARD, _SOFT, _COUPLING, _NOISE = (
    f"magnetometer_{name}" for name in ("hard_iron_sigma", "soft_iron_sigma", "coupling_sigma", "noise")
)


def _uncalibrated() -> dict[str, float]:
    """Soft iron of a magnetometer that nobody has calibrated on its vehicle, by row."""
    grade = GRADES["uncalibrated"].figures
    rows = {FIGURES[name].row: FIGURES[name].to_si(value) for name, value in grade.items()}
    return {name: float(rows[name]) for name in (_SOFT, _COUPLING)}


def with_magnetometer_judged(log: RecordedLog) -> RecordedLog:
    """The log with what the readings of its magnetometer show of it, and without readings that are none."""
    instruments, stated, notes = [], dict(log.stated_errors), list(log.notes)
    turned = turned_by(log)
    for each in log.instruments:
        kept: Readings | None = each
        if each.id == MAGNETOMETER.id:
            kept, larger, said = judged(each, stated, turned)
            stated |= larger
            notes += said
        if kept is not None:
            instruments.append(kept)
    return replace(log, instruments=tuple(instruments), stated_errors=stated, notes=tuple(notes))


def judged(
    readings: Readings, stated: Mapping[str, Any], turned: float
) -> tuple[Readings | None, dict[str, Any], list[Remark]]:
    """The readings, None if they are of no use; errors that the log shows to be larger than `stated`; what is said of both.

    turned: the largest angle by which the gyros turn, rad.
    """
    silent = np.all(readings.values == 0.0, axis=1)
    said = [_SILENT.filled(name=readings.name, count=np.count_nonzero(silent), all=silent.size)] if silent.any() else []
    if silent.all():
        return None, {}, said
    readings = readings.at(~silent) if silent.any() else readings
    if is_stuck(readings, turned):
        return None, {}, [*said, _STUCK.filled(name=readings.name, turned=np.degrees(turned))]
    ratio = float(np.median(_strength(readings)) / np.linalg.norm(stated[FIELD.name]))
    if not 1.0 / WIDEST <= ratio <= WIDEST:
        return None, {}, [*said, _IMPOSSIBLE.filled(name=readings.name, ratio=ratio)]
    readings, larger, of_size = calibrated(readings, stated)
    return readings, larger, [*said, *of_size]


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
    larger = {name: max(float(stated[name]), sigma) for name, sigma in _uncalibrated().items()}
    micro = {"strength": float(np.median(strength)), "earth": earth, "allowed": allowed}
    vehicle = _of_vehicle(readings, apart)
    if vehicle is None:
        larger |= {_HARD: max(float(stated[_HARD]), apart), _SOFT: max(larger[_SOFT], apart / earth)}
        said = _UNTOLD.filled(name=readings.name, share=100.0 * larger[_SOFT], **_in_ut({**micro, "hard": larger[_HARD]}))
        return readings, larger, [said]
    field_b, sigma = vehicle
    scale = earth / float(np.median(np.linalg.norm(readings.values - field_b, axis=1)))
    larger |= {_HARD: max(float(stated[_HARD]), scale * sigma)}
    said = _STRENGTH.filled(
        name=readings.name,
        scale=scale,
        field=", ".join(f"{1e6 * each:.2g}" for each in field_b),
        **_in_ut({**micro, "hard": larger[_HARD]}),
    )
    return replace(readings, values=scale * (readings.values - field_b)), larger, [said]


def _in_ut(values: Mapping[str, float]) -> dict[str, float]:
    return {name: 1e6 * value for name, value in values.items()}


def _of_vehicle(readings: Readings, apart: float) -> tuple[Array, float] | None:
    """The field h of the vehicle (3, T, b) and the standard deviation of what is left; None if the directions tell too little.

    apart: T, what each component could be.  A sphere about h: y^2 / 2 = h . y + constant, by least squares of which the noise
    of the readings, which stands on both sides, is taken out.  A component that the directions do not tell from a scale factor
    is taken to be 0, and what is left of it as large as those that they tell.
    """
    y, interval = readings.values, interval_of(readings)
    Y, half = y - y.mean(axis=0), 0.5 * np.sum(y**2, axis=1)
    noise = float(np.mean(np.diff(y, 2, axis=0) ** 2) / 6.0) if len(y) > 2 else 0.0
    scatter, axes = np.linalg.eigh(Y.T @ Y)
    scatter = scatter - len(y) * noise
    known = scatter > len(y) * noise
    right = axes.T @ (Y.T @ (half - half.mean()) - len(y) * noise * y.mean(axis=0))
    along = np.divide(right, scatter, out=np.zeros(3), where=known)
    left = half - half.mean() - Y @ (axes @ along)
    repeated = max(lasting_of(left, interval) / interval, 1.0)
    information = np.where(known, scatter, 0.0) / (repeated * max(float(left.var()), (1e-3 * apart * apart) ** 2))
    share = information / (information + apart**-2)  # of what each axis could be, that the readings tell
    if share.sum() < 1.0:
        return None
    along = share * along
    variance = np.where(known, 1.0 / (information + apart**-2), 0.0)
    untold = (1.0 - share) * float(share @ along**2 / share.sum())
    return axes @ along, float(np.sqrt(np.mean(variance * share + untold)))


def _of_disturbance(readings: Readings, stated: Mapping[str, Any]) -> tuple[dict[str, Any], list[Remark]]:
    """A white noise with the spectrum at low frequency of what disturbs the strength."""
    strength, interval = _strength(readings), interval_of(readings)
    u = readings.values / strength[:, None]
    products = (u[:, 0] ** 2, u[:, 1] ** 2, u[:, 0] * u[:, 1], u[:, 0] * u[:, 2], u[:, 1] * u[:, 2])
    directions = np.column_stack([np.ones(len(u)), u, *products])
    left = strength - directions @ np.linalg.lstsq(directions, strength, rcond=None)[0]
    lasting, spread = lasting_of(left, interval), float(left.std())
    noise, least = white_noise(spread, lasting, interval), float(stated[_NOISE])
    if noise <= DISTURBED * least:
        return {}, []
    micro = {"spread": spread, "noise": noise, "stated": least}
    said = _DISTURBED.filled(name=readings.name, time=lasting, **{name: 1e6 * value for name, value in micro.items()})
    return {_NOISE: noise}, [said]


def _strength(readings: Readings) -> Array:
    return np.asarray(np.linalg.norm(readings.values, axis=1))
