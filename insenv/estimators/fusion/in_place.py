"""A fixed place: the unit is known not to move, though it may turn, as on a turntable.

Unlike `zero_velocity`, which finds rest by itself and needs a unit that does not turn, this is knowledge: whoever names the aid
says that it holds throughout. The unit must be at the centre of the turns.
"""

from __future__ import annotations

import casadi as ca

from insenv.core.elementary import select
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.contract import Aid, sigma_row, waited

AID = Aid(
    id="in_place",
    title="a fixed place",
    size=3,
    what="no velocity, at any time, also in turns",
    causes="whether the unit stays where it is, and whether it is at the centre of its turns",
    unit="m/s",
    residual=lambda p, seen, u: seen.velocity_w,
    variance=lambda p, x, u, spread: ca.repmat(p.in_place_sigma**2, 3, 1),
    due=lambda p, x, u: select(waited(x.in_place_since, u, p.in_place_interval), 1.0, 0.0),
    parameters=Table((
        sigma_row("in_place_sigma", "Velocity of a unit that stays where it is", "m/s", start=0.001),
        Row("in_place_interval", "Time between uses of it", "s", start=0.2, lower=0.0, upper=3600.0),
    )),
)  # fmt: skip
