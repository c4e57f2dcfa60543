"""Heading of two antennas: the azimuth of their baseline.

    azimuth of C_nb d + offset      d the baseline in b; the offset is what an error of d across it does

A baseline that is seen within 17 deg of the vertical has no useful azimuth and is not used.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv import attitude
from insenv.core.elementary import atan2, select, wrap_angle
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, gate_row, noise_variance
from insenv.estimators.fusion.error_state import ErrorState
from insenv.estimators.fusion.navigation import Navigation
from insenv.estimators.parts import strapdown
from insenv.estimators.parts.kalman import correlated_again
from insenv.sensors.instruments import HEADING

_TOLD = HEADING.told
FLATTEST = 0.3
"""Least horizontal part of the baseline, of its length."""


def _length2(p: Any) -> Any:
    return ca.sumsqr(p.heading_baseline_b) + 1e-12


OFFSET = ErrorState(
    Row("heading_offset", "Estimated azimuth error of the antenna baseline in the body", "rad", (1,)),
    sigma="heading_baseline_sigma",
    rows=Table((_TOLD["heading_baseline_sigma"], _TOLD["heading_baseline_b"])),
    started_sigma=lambda p: p.heading_baseline_sigma / ca.sqrt(_length2(p)),
)
STATES = (OFFSET,)


def _residual(p: Any, seen: Navigation, u: Any) -> Any:
    baseline = seen.C_nw @ (seen.axes(u.heading_age) @ p.heading_baseline_b)
    return wrap_angle(atan2(baseline[1], baseline[0]) + seen.value(OFFSET.name, 0.0) - u.heading_azimuth)


def _present(p: Any, x: Any, u: Any) -> Any:
    baseline = strapdown.C_nw(x.q_ew) @ (attitude.to_dcm(x.q_wb) @ p.heading_baseline_b)
    return select(ca.sumsqr(baseline[:2]) > FLATTEST**2 * _length2(p), 1.0, 0.0)


AID = Aid(
    id="heading",
    title="the two-antenna heading",
    size=1,
    what="azimuth",
    causes="the baseline's direction in the body, its length, and the stated sigma of the azimuth",
    unit="rad",
    residual=_residual,
    variance=lambda p, x, u, spread: noise_variance(u.heading_azimuth_sigma, 1e-4),
    due=lambda p, x, u: u.heading_new,
    sensors=("heading",),
    inputs=HEADING.measurement,
    parameters=Table((
        _TOLD["heading_baseline_b"], _TOLD["heading_wander_sigma"], _TOLD["heading_wander_time"], gate_row("heading"),
    )),
    present=_present,
    age=lambda u: u.heading_age,
    gate="heading_gate",
    correlated=lambda p, x, since: correlated_again(
        ca.sumsqr(p.heading_wander_sigma[:2]) / 2 / _length2(p), since, p.heading_wander_time
    ),
)  # fmt: skip
