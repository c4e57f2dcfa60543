"""A fixed place: the unit is known not to move, though it may turn, as on a turntable; or its vehicle is parked.

Unlike `zero_velocity`, which finds rest by itself and needs a unit that does not turn, this is knowledge: whoever names the aid
says that it holds throughout. The unit must be at the centre of the turns.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from insenv.core.elementary import maximum, select
from insenv.core.tables import Row, Table
from insenv.estimators.fusion.aid import Aid, Spread, waited
from insenv.estimators.fusion.error_state import sigma_row
from insenv.estimators.parts.rows import STANDING_SIGMA

HELD = 60.0
"""s: an error of the specific force that linearisation leaves out lasts about as long as an orientation.

The measurement counts it as white noise of the velocity that it makes in this time, so that repetitions do not average it out.
"""

SHAKEN = float(STANDING_SIGMA["standing_sigma"].start)
"""m/s: `in_place_sigma` of a vehicle, which its engine, wind and people shake, other than a turntable."""


def _variance(p: Any, x: Any, u: Any, spread: Spread) -> Any:
    """Variances (3, m^2/s^2): `in_place_sigma`, or what linearisation leaves out if that is more.

    The accelerometer bias b acts in axes that are wrong by the heading error psi_D: psi x (C_wb b) is a product of two errors,
    which a linearised filter neglects, and each turn of the unit changes it.
    """
    omitted = spread("attitude")[2] * ca.sum1(spread("accel_bias")) / 3 * HELD**2
    return ca.repmat(maximum(p.in_place_sigma**2, omitted), 3, 1)


AID = Aid(
    id="in_place",
    title="a fixed place",
    size=3,
    what="no velocity, at any time, also in turns",
    causes="whether the unit stays where it is, and whether it is at the centre of its turns",
    unit="m/s",
    residual=lambda p, seen, u: seen.velocity_w,
    variance=_variance,
    due=lambda p, x, u: select(waited(x.in_place_since, u, p.in_place_interval), 1.0, 0.0),
    parameters=Table((
        sigma_row("in_place_sigma", "Velocity of a unit that stays where it is", "m/s", start=0.001),
        Row("in_place_interval", "Time between uses of it", "s", start=0.2, lower=0.0, upper=3600.0),
    )),
)  # fmt: skip
