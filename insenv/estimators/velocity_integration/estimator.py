"""The estimator `velocity-integration`: by the velocity of GNSS, or by a Doppler log where GNSS gives none."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from insenv import geodesy
from insenv.base.remarks import declared
from insenv.estimators.contract import Choices, Drive, Estimator
from insenv.estimators.knowledge import Knowledge
from insenv.estimators.parts.finding import Finding, Reached
from insenv.estimators.velocity_integration.source import FIXES, LARGEST_LINEAR, LOG
from insenv.estimators.velocity_integration.wahba import VelocityIntegration

FIX_NOISE = 0.05  # m/s, once a second: typical of receivers that measure velocity by Doppler shift
OLDEST = 1.0
"""s: of a measurement, over which acceleration and angular acceleration are taken as constant.

Heading errors of a ship in waves are as stated with 1 s, and four to seven times as large with 3 s.
"""
SHORTEST, LONGEST = 5.0, 3600.0  # s of memory

BY_FIXES, BY_LOG = VelocityIntegration(FIXES), VelocityIntegration(LOG)


def available(sensors: Collection[str], fix_velocity: bool, known: Knowledge) -> VelocityIntegration | None:
    """The alignment that these sensors allow, or None; a log that shows the velocity through water that flows allows none."""
    if "gnss" in sensors and fix_velocity:
        return BY_FIXES
    return BY_LOG if "dvl" in sensors and known.rows.get("dvl_current_sigma", 0.0) == 0 else None


def memory_time(gyro_bias: float, angle_random_walk: float) -> float:
    """Memory (s) that balances the noise of fixes and the drift of the gyros (rad/s, rad/s^0.5), `SHORTEST` to `LONGEST`.

    Over a time T a drift b bends alpha by g b t^2 / 2, of which a straight line leaves g b T^2 / (12 sqrt 5) rms. Noise of
    density S in the fixes leaves S / sqrt(T) of a mean. A random walk bends alpha 1.29 times as much as a drift of its
    mean rate. Exponential weights of memory m spread as equal ones over sqrt(12) m.
    """
    bend = geodesy.NOMINAL_GRAVITY / (12 * math.sqrt(5))
    by_bias = (FIX_NOISE / max(bend * gyro_bias, 1e-30)) ** 0.4
    by_walk = (FIX_NOISE / max(1.29 * bend * angle_random_walk, 1e-30)) ** 0.5
    return min(max(min(by_bias, by_walk) / math.sqrt(12), SHORTEST), LONGEST)


def gyro_bias_of(known: Knowledge) -> float:
    """Standard deviation (rad/s) of the gyro bias: that which a rest has left, or that of the data sheet."""
    return known.gyro_bias_error or known.sensors.gyro_bias_sigma


def prepare(way: VelocityIntegration, known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known."""
    bias = gyro_bias_of(known)
    endless = way.source.by_earth_rate(bias, known.latitude)
    memory = LONGEST if endless else memory_time(bias, known.sensors.angle_random_walk)
    return {**known.rows_of(way.parameters), "memory_time": memory}


_NO_ATTITUDE = declared("no-attitude", "no attitude was found: this alignment needs {needs}, at least three of them")
_NO_HEADING = declared("heading-unknown", "the heading is unknown at the end: {shows}")
_HEADING_REACHED = declared("heading-found", "heading found after {time} s, to {sigma} deg (1 sigma), {means}")


def findings(way: VelocityIntegration, parameters: Mapping[str, Any]) -> tuple[Finding | Reached, ...]:
    """What is said of a run that has not found the attitude, or its heading, at its end, and when the heading is known."""
    row, heading = "attitude_sigma", _NO_HEADING.filled(shows=way.source.shows_heading(parameters))
    return (
        Finding(row, _NO_ATTITUDE.filled(needs=way.source.needs), scale=(LARGEST_LINEAR, np.inf, np.inf)),
        Finding(row, heading, scale=(np.inf, np.inf, LARGEST_LINEAR)),
        Reached(row, _HEADING_REACHED.filled(means=way.source.means), np.full(3, LARGEST_LINEAR)),
    )


def _estimator(way: VelocityIntegration) -> Estimator:
    return Estimator(
        way.model,
        kind="alignment",
        sensors=(way.source.sensor,),
        motion="moving",
        fix_velocity=way is BY_FIXES,
        prepare=partial(prepare, way),
        findings=partial(findings, way),
        max_measurement_age_s=OLDEST,
        adapt=_adapted,
    )


def _adapted(known: Knowledge, drive: Drive, choices: Choices) -> Estimator:
    way = available(drive.sensors, drive.fix_velocity, known)
    if way is not None:
        return _BY_WAY[way]
    fixes = f"the fixes of {drive.where} have no velocity" if "gnss" in drive.sensors else f"{drive.where} has no [gnss]"
    log = "and there is no [dvl]"
    if "dvl" in drive.sensors:
        current = known.rows.get("dvl_current_sigma", 0.0)
        log = f"and its Doppler log is through water that flows, with a current of {current:.3g} m/s"
    return replace(
        ESTIMATOR, missing_sensors=f"the velocity of GNSS or of a Doppler log that tracks the ground: {fixes}, {log}"
    )


_BY_WAY = {way: _estimator(way) for way in (BY_FIXES, BY_LOG)}
ESTIMATOR = _BY_WAY[BY_FIXES]
