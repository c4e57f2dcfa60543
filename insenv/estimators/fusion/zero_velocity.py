"""Zero velocity: the vehicle is known, or seen (`insenv.estimators.parts.standing`), to be at rest."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from insenv.core.elementary import select
from insenv.core.model import Step
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, waited
from insenv.estimators.parts import rows, standing

AT_EACH_SAMPLE = Aid(
    id="zero_velocity",
    title="zero velocity",
    size=3,
    what="three components, while the vehicle is at rest",
    causes="whether the vehicle stands still there (a log's `standing`, standing_rate, standing_force) and standing_sigma",
    unit="m/s",
    holds=("horizontal",),
    residual=lambda p, seen, u: seen.velocity_w,
    variance=lambda p, x, u, spread: ca.repmat(p.standing_sigma**2, 3, 1),
    due=lambda p, x, u: u.standing,
    inputs=rows.STANDING_INPUT,
    parameters=standing.PARAMETERS,
    state=standing.STATE,
    watch=lambda p, x, u, delta_angle, delta_velocity, change_w: standing.watched(
        p, x, delta_angle, delta_velocity, change_w, u.dt
    ),
    steps={"still": Step(standing.found, when="still_due")},
    wakes="still_due",
    flag="standing_now",
)
"""A vehicle known to be at rest has a zero velocity at each sample."""
AID = replace(
    AT_EACH_SAMPLE,
    due=lambda p, x, u: select(u.standing * waited(x.zero_velocity_since, u, p.standing_interval), 1.0, 0.0),
    parameters=standing.PARAMETERS
    + Table((
        Row("standing_interval", "Time between zero velocities of a vehicle known to be at rest", "s", start=0.2,
            lower=0.0, upper=3600.0),
    )),
)  # fmt: skip
"""It has one every `standing_interval`."""
