"""`recorded_log`: the one builder of a `RecordedLog`, from what a file of any format holds and the description of the log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from insenv.base.errors import InputError
from insenv.base.remarks import Remark
from insenv.core.tables import Array
from insenv.logs import instruments
from insenv.logs.description import AnyLog, LogDescription
from insenv.logs.inertial import InertialSamples
from insenv.logs.recorded import GnssFixes, Readings, RecordedLog, Reference, Source
from insenv.logs.rest import rest_until
from insenv.logs.units import year_of_unix
from insenv.sensors.contract import Place
from insenv.sensors.gnss import COMMON

LEFT_OUT = 1
"""Samples before start_s with which it leaves nothing out: a time that is printed rounded may lie behind the first sample."""


def recorded_log(
    imu: InertialSamples,
    gnss: GnssFixes | None,
    reference: Reference | None,
    readings: Sequence[Readings],
    *,
    description: LogDescription,
    lever_arm_b: Array,
    sources: Sequence[Source],
    notes: Sequence[Remark],
    unit: Mapping[str, Any] | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    unix: float | None = None,
) -> RecordedLog:
    """The log, with the end of the time at rest as it shows it and the stated errors of its instruments.

    The arguments are the fields of `RecordedLog`; unix: Unix time (s) of one of its moments, None if it states none.

    Raises `InputError` for a magnetometer without a place.
    """
    place = place_of(gnss, description)
    if place is not None and unix is not None:
        place = replace(place, year=year_of_unix(unix))
    stated = {} if gnss is None or description.gnss is None else description.gnss.stated_errors()
    for each in readings:
        stated |= instruments.stated_errors(each.id, getattr(description, each.id, None), place)
    log = RecordedLog(
        **vars(imu),
        gnss=gnss,
        lever_arm_b=lever_arm_b,
        reference=reference,
        sources=tuple(sources),
        notes=tuple(notes),
        description=_with_rest(description, imu, gnss),
        unit=unit,
        settings=settings or {},
        instruments=tuple(readings),
        stated_errors=stated,
    )
    return replace(log, stated_errors=stated | _assumed_delay(log) | _in_common(log))


LATE = 0.1
"""s: 1 sigma of the time of validity of fixes in logs of low cost, which stamp a fix when it arrives."""
LOW_COST = float(np.radians(100.0 / 3600.0))
"""rad/s: gyro bias, 1 sigma, of the units in such logs; and more."""


def _assumed_delay(log: RecordedLog) -> dict[str, Any]:
    section = log.description.gnss
    if log.gnss is None or (section is not None and section.delay_sigma_s is not None):
        return {}
    return {"gnss_delay_sigma": LATE} if log.sensors(in_place=True).gyro_bias_sigma >= LOW_COST else {}


WHOLE = 1.001
"""Ratio of a part to the whole that rounding explains."""


def check_wander(key: str, stated: Any, position_sigma: Array | None) -> None:
    """Raise `InputError` for a slow part of an error (m, 3), stated under `key`, that is larger than the whole (fixes, 3)."""
    if position_sigma is None or stated is None:
        return
    usual, wander = np.median(position_sigma, axis=0), np.broadcast_to(stated, 3)
    for axis, name in enumerate(("north", "east", "down")):
        if wander[axis] > WHOLE * usual[axis]:
            raise InputError(
                f"{key} = {wander[axis]:g} m {name}: allowed is up to position_sigma, {usual[axis]:.3g} m, the "
                "whole error of a fix: with a white part w, position_sigma is sqrt(wander_sigma_m^2 + w^2)"
            )


SLOW_SHARE = 0.95
"""Part of the stated sigma of a fix that others have in common unless the description says how much changes slowly: nearly all
of the error of a receiver (orbits, clocks, atmosphere, multipath) is there a second later.  Without it 100 fixes of 1 m would
make a position of 0.1 m."""


def _in_common(log: RecordedLog) -> dict[str, Any]:
    section = log.description.gnss
    if log.gnss is None or section is None or section.wander_sigma_m is not None:
        return {}
    return {COMMON.name: SLOW_SHARE * np.median(log.gnss.position_sigma, axis=0)}


def place_of(gnss: GnssFixes | None, description: AnyLog) -> Place | None:
    """The first fix, or the stated place; None if neither is there."""
    initial = description.initial
    if gnss is not None:
        return Place(float(gnss.latitude[0]), float(gnss.longitude[0]), float(gnss.height[0]))
    if initial.latitude_deg is not None and initial.longitude_deg is not None:
        return Place(math.radians(initial.latitude_deg), math.radians(initial.longitude_deg), initial.height_m or 0.0)
    return None


def span_of(imu: InertialSamples) -> tuple[float, float]:
    """The times (s) of the first and the last sample."""
    return float(imu.imu_time[0]), float(imu.imu_time[-1])


def overlaps(series: GnssFixes | Reference | Readings, span: tuple[float, float]) -> bool:
    """Whether a series has times between two others (s), or on both sides of them."""
    return bool(series.time[-1] >= span[0] and series.time[0] <= span[1])


def _with_rest(description: LogDescription, imu: InertialSamples, gnss: GnssFixes | None) -> LogDescription:
    """The description with the end of the time at rest, as the log shows it if the description does not state it."""
    initial = description.initial
    if initial.static_until_s is not None:
        return description
    dt = imu.dt[:, None]
    until = rest_until(imu.imu_time, imu.delta_angle / dt, imu.delta_velocity / dt, gnss, initial.static_from_s)
    if until is None:
        return description
    return description.model_copy(update={"initial": initial.model_copy(update={"static_until_s": until})})
